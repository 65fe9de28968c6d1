"""Training of the networks on simulated outbreaks, and files of trained networks.

The training simulates outbreaks of the disease and observes them along random paths that end at random times.
A small network learns the class of unobserved cells from the observations around them. The simulations use
separate random streams, so that a flown environment is among them only with a probability of 2^-128.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.atomic import atomic_write, made_by_one
from geo.seeds import stream
from geo.system import user_cache_folder, warn_of_cache
from sensors.dynamics.epidemic import MAX_DAYS, NEVER, EpidemicParameters, simulate_outbreak, value_table
from sensors.errors import EstimatorError
from sensors.estimators.base import Step, no_step
from sensors.estimators.paths import random_path
from wbf_mission.addons.epidemic.chase import chasing_path
from wbf_mission.addons.epidemic.features import (
    N_CONTEXT,
    N_FEATURES,
    N_OVERALL,
    REACH,
    UNKNOWN,
    context_features,
    inner,
    local_features,
    overall_features,
    padded_codes,
)
from wbf_mission.addons.epidemic.network import FieldClassifier, Network, train

VERSION = 5
"""Version in file names; raise it with every change of the training."""
SUMS = 2
"""Version in file names; raise it with changes of the arithmetic that do not change the random draws."""
WHOLE_FARM_CELLS = 128 * 128
"""Largest farm simulated as a whole. Training for larger farms uses windows, without whole-field features."""
LAYERS = (N_FEATURES, 64, 32, 3)
FURTHER_LAYERS = (N_FEATURES + N_CONTEXT, 64, 32, 3)
_WINDOW = 64
_PATHS = 2
_LOOKS = 3
_CELLS_A_LOOK = 60
_LONGEST_SHARE = 0.45
_NEAR_PREFERENCE = 4.0
_NEAR_SIZE = 9
_WITH_SEEDS_SHARE = 0.8
_SMALLEST_TRAINING = 10
_FURTHER = 2
_JUDGED_CELLS = 6_000_000
_DAYS_TOGETHER = 8
_CHASING_SHARE = 0.35
_BEGUN_SHARE = 0.5

INCLUDED = Path(__file__).parent / "networks"
"""Networks of the Miniberry farms, which users need not train (`tools/write_networks.py`)."""

_in_memory: dict[str, Network] = {}


@dataclass(frozen=True, slots=True)
class TrainingTask:
    """Parameters of a network's training; equal tasks give equal networks.

    Parameters
    ----------
    parameters : EpidemicParameters
        The disease.
    day : int
        Day of the observations. On farms of at most `WHOLE_FARM_CELLS`, a network serves eight days from
        `first_day` on.
    outbreaks : int
        Number of simulated fields.
    epochs : int
        Number of passes over the samples.
    seed : int
        Seed of the training.
    """

    parameters: EpidemicParameters
    day: int
    outbreaks: int = 1250
    epochs: int = 6
    seed: int = 0

    def key(self, hosts: NDArray[np.bool_]) -> str:
        """Return the file name, without suffix, for the network of this task on a crop map."""
        identity = {**asdict(self), "version": VERSION, "layers": LAYERS, "shape": hosts.shape}
        if self.parameters.seed_spread_cells is None:
            # This parameter was added later: by default it must change neither the name nor the seed.
            del identity["parameters"]["seed_spread_cells"]
        digest = hashlib.sha256(json.dumps(identity, sort_keys=True).encode())
        digest.update(np.packbits(hosts).data)
        return digest.hexdigest()[:32]


def first_day(day: int, hosts: NDArray[np.bool_]) -> int:
    """Return the first of the eight days that share a network with `day`; on large farms `day` itself.

    >>> first_day(6, np.ones((30, 30), bool)), first_day(6, np.ones((300, 300), bool))
    (0, 6)
    """
    return day - day % _DAYS_TOGETHER if hosts.size <= WHOLE_FARM_CELLS else day


def network_for(
    task: TrainingTask,
    hosts: NDArray[np.bool_],
    folder: str | os.PathLike[str] | None,
) -> Network:
    """Return the network of a task, from memory, from its file, or newly trained and stored in both.

    An unusable file is replaced. If the folder is not writeable, every process trains again; this is not an
    error.
    """
    task = shared_task(task, hosts)
    network = known_network(task, hosts, folder)
    if network is None:
        with made_by_one(network_file(task, hosts, folder)):
            network = known_network(task, hosts, folder)
            if network is None:
                network = learn(task, hosts)
                keep_network(network, task, hosts, folder)
    return network


def shared_task(task: TrainingTask, hosts: NDArray[np.bool_]) -> TrainingTask:
    """Return the task with `first_day` as its day, which identifies the network."""
    if not 0 <= task.day <= MAX_DAYS:
        raise EstimatorError(f"epidemic: day {task.day} is not in 0..{MAX_DAYS}, the days of an environment")
    return replace(task, day=first_day(task.day, hosts))


def network_file(task: TrainingTask, hosts: NDArray[np.bool_], folder: str | os.PathLike[str] | None) -> Path:
    """Return the path of a shared task's network file, in `folder` or the user's cache."""
    parent = Path(folder) if folder is not None else user_cache_folder("epidemic")
    return parent / f"{task.key(hosts)}-{SUMS}.npz"


def known_network(
    task: TrainingTask, hosts: NDArray[np.bool_], folder: str | os.PathLike[str] | None
) -> Network | None:
    """Return the network of a shared task from memory or a file; None if it must be trained."""
    key = task.key(hosts)
    if key not in _in_memory:
        path = network_file(task, hosts, folder)
        network = load_network(INCLUDED / path.name) or load_network(path)
        if network is None:
            return None
        _in_memory[key] = network
    return _in_memory[key]


def keep_network(
    network: Network, task: TrainingTask, hosts: NDArray[np.bool_], folder: str | os.PathLike[str] | None
) -> None:
    """Store the network of a shared task in memory and in its file."""
    save_network(network, network_file(task, hosts, folder))
    _in_memory[task.key(hosts)] = network


def save_network(network: Network, path: Path) -> None:
    """Write a network to a file; warn if the folder is not writeable."""
    layers: dict[str, NDArray[np.float32]] = {}
    for number, stage in enumerate((network, *network.further)):
        layers |= {f"{_part(number)}weight{i}": weight for i, weight in enumerate(stage.weights)}
        layers |= {f"{_part(number)}bias{i}": bias for i, bias in enumerate(stage.biases)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, "wb") as stream_:
            np.savez(stream_, allow_pickle=False, **layers)
    except OSError as error:
        warn_of_cache(path.parent, error)


def load_network(path: Path) -> Network | None:
    """Return the network in a file; None if the file is missing or unusable."""
    try:
        with np.load(path, allow_pickle=False) as file:
            first = _read(file, 0, LAYERS)
            stages = range(1, 1 + _FURTHER if f"{_part(1)}weight0" in file.files else 1)
            further = [_read(file, number, FURTHER_LAYERS) for number in stages]
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):
        return None
    return replace(first, further=tuple(further))


def _part(number: int) -> str:
    return f"further{number}_" if number else ""


def _read(file: Mapping[str, NDArray[np.float32]], number: int, layers: Sequence[int]) -> Network:
    """Return network `number` of a file; raise ValueError or KeyError if it is unusable."""
    weights, biases = [], []
    for i, shape in enumerate(itertools.pairwise(layers)):
        weight, bias = file[f"{_part(number)}weight{i}"], file[f"{_part(number)}bias{i}"]
        good = weight.shape == shape and bias.shape == shape[1:]
        good = good and weight.dtype == bias.dtype == np.float32
        if not (good and np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ValueError(f"layer {i} is not one of {shape}")
        weights.append(weight)
        biases.append(bias)
    return Network(tuple(weights), tuple(biases))


def learn(task: TrainingTask, hosts: NDArray[np.bool_], step: Step = no_step) -> Network:
    """Return a newly trained network; `step` is called with the finished fraction, 0..1."""
    rng = stream(task.seed, "epidemic-estimator", task.key(hosts))
    whole = hosts.size <= WHOLE_FARM_CELLS
    steps = 2 + 2 * whole * _FURTHER
    done = itertools.count(1)
    looks = draw_looks(task, hosts, rng)
    samples = samples_of(looks)
    step(next(done) / steps)
    network = train(Network.draw(LAYERS, rng), *samples, epochs=task.epochs, rng=rng)
    step(next(done) / steps)
    refinement = _Refinement(looks, hosts, task.parameters.seed_count(hosts.shape))
    last = network
    for _ in range(whole * _FURTHER):
        refined = refinement.refine(last, samples[0])
        step(next(done) / steps)
        last = train(Network.draw(FURTHER_LAYERS, rng), refined, *samples[1:], epochs=task.epochs, rng=rng)
        network = replace(network, further=(*network.further, last))
        step(next(done) / steps)
    return network


def classes_of(values: NDArray[np.floating]) -> NDArray[np.int8]:
    """Return the class closest to each value: 0 susceptible, 1 infected, 2 removed; -1 for NaN.

    >>> classes_of(np.array([1.0, 0.5, 0.0, 0.8, 1.7, -0.2, np.nan])).tolist()
    [0, 1, 2, 0, 0, 2, -1]
    """
    with np.errstate(invalid="ignore"):
        nearest = np.where(values > 0.75, 0, np.where(values > 0.25, 1, 2))
    return np.where(np.isnan(values), -1, nearest).astype(np.int8)


@dataclass(frozen=True, slots=True)
class Look:
    """A partly observed field, with unobserved cells as training samples."""

    codes: NDArray[np.uint8] | None
    """Map of codes, uint8[W + 2 REACH, H + 2 REACH]; None for windows, which have no refinement networks."""
    day: int
    """Days since the network's first day."""
    overall: NDArray[np.float32]
    """Features of the whole field, float32[8]; zeros for windows."""
    chosen: NDArray[np.intp]
    """Sampled cells, intp[n, 2]."""
    features: NDArray[np.float32]
    """Features of the sampled cells, float32[n, N_FEATURES]."""
    classes: NDArray[np.int8]
    """True classes of the sampled cells, int8[n]."""
    weights: NDArray[np.float64]
    """Weights of the samples, float64[n], which make them representative of all unobserved cells."""


def draw_looks(task: TrainingTask, hosts: NDArray[np.bool_], rng: Generator) -> list[Look]:
    """Return random looks at simulated fields.

    Refinement networks evaluate all cells of each look. A training with such networks therefore has fewer
    looks, with more samples each.
    """
    field = _Fields(task, hosts, rng)
    wanted = max(task.outbreaks, _SMALLEST_TRAINING)
    most = wanted
    if field.whole:
        most = max(_SMALLEST_TRAINING, _JUDGED_CELLS // (_PATHS * _LOOKS * max(field.hosts, 1)))
    number = min(wanted, most)
    cells = -(-_CELLS_A_LOOK * wanted // number)
    found = []
    for _ in range(number):
        land, history, margin, weight = field.draw()
        for _path in range(_PATHS):
            day = int(rng.integers(0, len(field.tables)))
            truth = field.tables[day][history.view(np.uint8)]
            for codes in _along_a_path(land, truth, rng):
                chosen, counts = _choose(codes, margin, cells, rng)
                features = np.zeros((len(chosen), N_FEATURES), np.float32)
                local_features(codes, chosen[:, 0], chosen[:, 1], features)
                overall = np.zeros(N_OVERALL, np.float32)
                if field.whole:
                    overall = overall_features(codes, field.hosts, field.seeds, day)
                features[:, -N_OVERALL:] = overall
                classes = truth[chosen[:, 0], chosen[:, 1]]
                kept = codes if field.whole else None
                found.append(Look(kept, day, overall, chosen, features, classes, weight * counts))
    return found


def _along_a_path(
    land: NDArray[np.bool_], truth: NDArray[np.int8], rng: Generator
) -> Iterator[NDArray[np.uint8]]:
    """Yield maps of codes after random parts of a random path, which may chase sick plants."""
    longest = max(1, int(_LONGEST_SHARE * land.size))
    cells = random_path(land.shape, longest, rng)
    if rng.random() < _CHASING_SHARE:
        begun = cells[: 1 + int(rng.random() * _BEGUN_SHARE * len(cells))]
        cells = chasing_path(begun, truth > 0, longest, rng)
    cells = cells[land[cells[:, 0], cells[:, 1]]]
    for look in range(_LOOKS):
        # The first look is at a uniformly random time, later looks are mostly towards the path's end.
        count = int(np.ceil(len(cells) * rng.random() ** (1.0 if look == 0 else 0.3)))
        codes = padded_codes(land)
        x, y = cells[:count].T
        inner(codes)[x, y] = truth[x, y] + 1
        yield codes


def samples_of(
    looks: list[Look],
) -> tuple[NDArray[np.float32], NDArray[np.int8], NDArray[np.float32]]:
    """Return features, classes, and weights (with mean 1) of all samples in the looks."""
    weights = np.concatenate([look.weights for look in looks])
    mean = weights.mean() if len(weights) else 1.0
    features = np.concatenate([look.features for look in looks])
    classes = np.concatenate([look.classes for look in looks])
    return features, classes, (weights / mean).astype(np.float32)


class _Refinement:
    """Computes the last network's probabilities of all cells in the looks, as inputs of the next network."""

    def __init__(self, looks: list[Look], hosts: NDArray[np.bool_], seeds: int) -> None:
        self._looks = looks
        self._seeds = seeds
        self._x, self._y = np.nonzero(hosts)
        self._row = np.zeros(hosts.shape, np.intp)
        self._row[self._x, self._y] = np.arange(len(self._x))
        self._found: list[NDArray[np.float32] | None] = [None] * len(looks)

    def refine(self, last: Network, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the samples' features with the context features from network `last` appended."""
        out = np.empty((len(features), N_FEATURES + N_CONTEXT), np.float32)
        out[:, :N_FEATURES] = features
        start = 0
        for number, look in enumerate(self._looks):
            assert look.codes is not None
            classifier = FieldClassifier(last, look.codes, self._x, self._y, self._seeds, look.day)
            found = classifier.probabilities(look.overall, self._found[number])
            rows = self._row[look.chosen[:, 0], look.chosen[:, 1]]
            context = context_features(look.codes, self._x, self._y, found, self._seeds, rows)
            out[start : start + len(rows), N_FEATURES:] = context
            start += len(rows)
            self._found[number] = found
        return out


def _choose(
    codes: NDArray[np.uint8], margin: int, most: int, rng: Generator
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Sample unobserved cells, preferably near sick cells; return the cells and their sample weights."""
    from scipy import ndimage

    middle = inner(codes)[margin : codes.shape[0] - 2 * REACH - margin]
    unknown = np.argwhere(middle[:, margin : codes.shape[1] - 2 * REACH - margin] == UNKNOWN) + margin
    if len(unknown) <= most:
        return unknown, np.ones(len(unknown))
    sick = (inner(codes) == 2) | (inner(codes) == 3)
    near = ndimage.maximum_filter(sick.view(np.uint8), size=_NEAR_SIZE, mode="constant")
    preference = np.where(near[unknown[:, 0], unknown[:, 1]] > 0, _NEAR_PREFERENCE, 1.0)
    share = preference / preference.sum()
    chosen = rng.choice(len(unknown), most, p=share)
    return unknown[chosen], 1.0 / (most * share[chosen])


class _Fields:
    """Simulator of fields: the whole farm, or windows of a large farm with their share of the seeds."""

    def __init__(self, task: TrainingTask, hosts: NDArray[np.bool_], rng: Generator) -> None:
        self.whole = hosts.size <= WHOLE_FARM_CELLS
        self._ranks = np.cumsum(np.count_nonzero(hosts, axis=1))
        self.hosts = int(self._ranks[-1])
        self.seeds = task.parameters.seed_count(hosts.shape)
        self._land = hosts
        self._rng = rng
        self._parameters = task.parameters.on_window(hosts.shape, self.seeds)
        self._last_day = min(task.day + _DAYS_TOGETHER - 1, MAX_DAYS) if self.whole else task.day
        days = range(task.day, self._last_day + 1)
        self.tables = [classes_of(value_table(self._parameters, day)) for day in days]

    def draw(self) -> tuple[NDArray[np.bool_], NDArray[np.int8], int, float]:
        """Return a field: host cells, days of infection, margin without samples, and sample weight.

        `tables` map the days of infection, read as unsigned bytes, to the classes on each day.
        """
        if self.whole:
            return self._land, self._simulate(self._land, self.seeds), 0, 1.0
        rng = self._rng
        land = self._window()
        expected = self.seeds * np.count_nonzero(land) / self.hosts
        none = math.exp(-expected)
        if rng.random() >= _WITH_SEEDS_SHARE:
            return land, np.full(land.shape, NEVER, np.int8), REACH, none / (1.0 - _WITH_SEEDS_SHARE)
        # Outbreaks are rare on large farms. Windows with an outbreak are drawn more often, but weigh less.
        # Seeds are arrivals of a Poisson process, given a first arrival before time 1.
        first = -math.log1p(-float(rng.random()) * (1.0 - none)) / max(expected, 1e-300)
        later = int(rng.poisson(expected * max(0.0, 1.0 - first)))
        weight = (1.0 - none) / _WITH_SEEDS_SHARE
        return land, self._simulate(land, 1 + later), REACH, weight

    def _window(self) -> NDArray[np.bool_]:
        """Return a random window that contains a random host cell."""
        rank = int(self._rng.integers(0, self.hosts))
        x = int(np.searchsorted(self._ranks, rank, side="right"))
        row = np.flatnonzero(self._land[x])
        y = int(row[self._rng.integers(0, len(row))])
        corner = [
            int(np.clip(centre - self._rng.integers(0, _WINDOW), 0, max(0, side - _WINDOW)))
            for centre, side in zip((x, y), self._land.shape, strict=True)
        ]
        return self._land[corner[0] : corner[0] + _WINDOW, corner[1] : corner[1] + _WINDOW]

    def _simulate(self, land: NDArray[np.bool_], seeds: int) -> NDArray[np.int8]:
        return simulate_outbreak(land, replace(self._parameters, seeds=seeds), self._last_day, self._rng)
