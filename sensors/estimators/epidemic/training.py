"""Learning class probabilities from simulated outbreaks, and keeping what was learned.

Outbreaks of the disease's own model are drawn, observed along random paths that end at random times, and a
small network learns the class of cells that were not observed from what is known around them. The seeds of
these outbreaks are streams of their own: no environment that is flown is ever among them, except by a chance
of 2^-128.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.atomic import atomic_write
from geo.seeds import stream
from geo.user_cache import user_cache_folder, warn_of_cache
from sensors.dynamics.epidemic import MAX_DAYS, EpidemicParameters
from sensors.dynamics.outbreak import simulate_outbreak, value_table
from sensors.errors import EstimatorError
from sensors.estimators.base import Step, no_step
from sensors.estimators.epidemic.context import N_CONTEXT, context_features
from sensors.estimators.epidemic.features import (
    N_FEATURES,
    UNKNOWN,
    inner,
    local_features,
    overall_features,
    padded_codes,
    set_overall,
)
from sensors.estimators.epidemic.judge import FieldJudge
from sensors.estimators.epidemic.network import Network, train
from sensors.estimators.epidemic.paths import random_path
from sensors.estimators.epidemic.rings import REACH

VERSION = 3
"""Part of the names of files; it has to grow with every change of the training."""
WHOLE_FARM_CELLS = 128 * 128
"""On farms with more cells the training sees windows; features of the whole field are not used."""
LAYERS = (N_FEATURES, 64, 32, 3)
FURTHER_LAYERS = (N_FEATURES + N_CONTEXT, 64, 32, 3)
_WINDOW = 64
_WAYS = 2
_LOOKS = 3
_CELLS_A_LOOK = 60
_LONGEST_SHARE = 0.45
_NEAR_PREFERENCE = 4.0
_NEAR_SIZE = 9
_WITH_SEEDS_SHARE = 0.8
_SMALLEST_TRAINING = 10
_FURTHER = 2
_FURTHER_CELLS = 1_300_000

_in_memory: dict[str, Network] = {}


@dataclass(frozen=True, slots=True)
class TrainingTask:
    """What a network is trained for; equal tasks give equal networks.

    Parameters
    ----------
    parameters : EpidemicParameters
        The disease.
    day : int
        Day of the observations.
    outbreaks : int
        Number of simulated fields.
    epochs : int
        Passes of the training over the samples.
    seed : int
        Of the training.
    """

    parameters: EpidemicParameters
    day: int
    outbreaks: int = 1000
    epochs: int = 6
    seed: int = 0

    def key(self, hosts: NDArray[np.bool_]) -> str:
        """Return a name for the network of this task on this crop map."""
        told = {**asdict(self), "version": VERSION, "layers": LAYERS, "shape": hosts.shape}
        digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode())
        digest.update(np.packbits(hosts).data)
        return digest.hexdigest()[:32]


def cache_folder(folder: str | os.PathLike[str] | None) -> Path:
    """Return the folder of trained networks: the given one, or one below XDG_CACHE_HOME or ~/.cache."""
    return Path(folder) if folder is not None else user_cache_folder("epidemic")


def network_for(
    task: TrainingTask,
    hosts: NDArray[np.bool_],
    folder: str | os.PathLike[str] | None,
    step: Step = no_step,
) -> Network:
    """Return the network of a task: from memory, from its file, or trained now and kept in both.

    A file that cannot be read, or is not what its name claims, is replaced; a folder that cannot be written
    to costs a training in every process, not an error.

    `step` is called with the part that is learned, 0..1, unless there is a network already.

    Raises
    ------
    EstimatorError
        If the day is beyond what the model of the environment allows.
    """
    if not 0 <= task.day <= MAX_DAYS:
        msg = f"epidemic: day {task.day} is not in 0..{MAX_DAYS}, the days of an environment"
        raise EstimatorError(msg)
    key = task.key(hosts)
    if key not in _in_memory:
        path = cache_folder(folder) / f"{key}.npz"
        network = load_network(path)
        if network is None:
            step(0.0)
            network = learn(task, hosts, step)
            save_network(network, path)
        _in_memory[key] = network
    return _in_memory[key]


def save_network(network: Network, path: Path) -> None:
    """Write a network, or leave it if the folder cannot be written to."""
    layers: dict[str, NDArray[np.float32]] = {}
    for number, one in enumerate((network, *network.further)):
        layers |= {f"{_part(number)}weight{i}": weight for i, weight in enumerate(one.weights)}
        layers |= {f"{_part(number)}bias{i}": bias for i, bias in enumerate(one.biases)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path, "wb") as stream_:
            np.savez(stream_, allow_pickle=False, **layers)
    except OSError as error:
        warn_of_cache(path.parent, error)


def load_network(path: Path) -> Network | None:
    """Read a network; None if there is none that can be used."""
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
    """Take one network from a file, or raise a ValueError or KeyError."""
    weights, biases = [], []
    for i, shape in enumerate(itertools.pairwise(layers)):
        weight, bias = file[f"{_part(number)}weight{i}"], file[f"{_part(number)}bias{i}"]
        good = weight.shape == shape and bias.shape == shape[1:]
        good = good and weight.dtype == bias.dtype == np.float32
        if not (good and np.isfinite(weight).all() and np.isfinite(bias).all()):
            msg = f"layer {i} is not one of {shape}"
            raise ValueError(msg)
        weights.append(weight)
        biases.append(bias)
    return Network(tuple(weights), tuple(biases))


def learn(task: TrainingTask, hosts: NDArray[np.bool_], step: Step = no_step) -> Network:
    """Simulate, observe and train; `step` is called with the part that is done, 0..1."""
    from threadpoolctl import threadpool_limits

    rng = stream(task.seed, "epidemic-estimator", task.key(hosts))
    # One BLAS thread: the sums do not depend on the number of cores then.
    with threadpool_limits(1, user_api="blas"):
        whole = hosts.size <= WHOLE_FARM_CELLS
        steps = 2 + whole * (1 + 2 * _FURTHER)
        done = itertools.count(1)
        samples = draw_samples(task, hosts, rng)
        step(next(done) / steps)
        network = train(Network.draw(LAYERS, rng), *samples, epochs=task.epochs, rng=rng)
        step(next(done) / steps)
        if not whole:
            return network
        looks = _draw_looks(task, hosts, rng)
        step(next(done) / steps)
        for _ in range(_FURTHER):
            samples = _refine_samples(network, looks, hosts, task.parameters.seed_count(hosts.shape))
            step(next(done) / steps)
            last = train(Network.draw(FURTHER_LAYERS, rng), *samples, epochs=task.epochs, rng=rng)
            network = replace(network, further=(*network.further, last))
            step(next(done) / steps)
        return network


def classes_of(values: NDArray[np.floating]) -> NDArray[np.int8]:
    """Return the class nearest to each value: 0 susceptible, 1 infected, 2 removed; -1 for NaN.

    >>> classes_of(np.array([1.0, 0.5, 0.0, 0.8, 1.7, -0.2, np.nan])).tolist()
    [0, 1, 2, 0, 0, 2, -1]
    """
    with np.errstate(invalid="ignore"):
        nearest = np.where(values > 0.75, 0, np.where(values > 0.25, 1, 2))
    return np.where(np.isnan(values), -1, nearest).astype(np.int8)


def draw_samples(
    task: TrainingTask, hosts: NDArray[np.bool_], rng: Generator
) -> tuple[NDArray[np.float32], NDArray[np.int8], NDArray[np.float32]]:
    """Draw cells that were not observed, with what was known around them.

    Returns
    -------
    features : float32[n, N_FEATURES]
    classes : int8[n]
        The truth.
    weights : float32[n]
        How much each counts, so that together they stand for all cells not observed at the looks; mean 1.
    """
    field = _Fields(task, hosts, rng)
    features: list[NDArray[np.float32]] = []
    classes: list[NDArray[np.int8]] = []
    weights: list[NDArray[np.float64]] = []
    for _ in range(max(task.outbreaks, _SMALLEST_TRAINING)):
        land, truth, margin, weight = field.draw()
        for codes in _looks(land, truth, rng):
            chosen, counts = _choose(codes, margin, _CELLS_A_LOOK, rng)
            features.append(field.features(codes, chosen))
            classes.append(truth[chosen[:, 0], chosen[:, 1]])
            weights.append(weight * counts)
    return np.concatenate(features), np.concatenate(classes), _with_mean_one(weights)


def _looks(land: NDArray[np.bool_], truth: NDArray[np.int8], rng: Generator) -> Iterator[NDArray[np.uint8]]:
    """Yield what is known of a field (codes) at some times along random paths."""
    for _way in range(_WAYS):
        cells = random_path(land.shape, max(1, int(_LONGEST_SHARE * land.size)), rng)
        cells = cells[land[cells[:, 0], cells[:, 1]]]
        for look in range(_LOOKS):
            # The first looks are spread over the whole path, the later ones lie towards its end.
            count = int(np.ceil(len(cells) * rng.random() ** (1.0 if look == 0 else 0.3)))
            codes = padded_codes(land)
            x, y = cells[:count].T
            inner(codes)[x, y] = truth[x, y] + 1
            yield codes


def _with_mean_one(weights: list[NDArray[np.float64]]) -> NDArray[np.float32]:
    together = np.concatenate(weights)
    mean = together.mean() if len(together) else 1.0
    return (together / mean).astype(np.float32)


@dataclass(frozen=True, slots=True)
class _Look:
    """What is known of the farm at some time, the cells to learn from, their classes and weights."""

    codes: NDArray[np.uint8]
    chosen: NDArray[np.intp]
    classes: NDArray[np.int8]
    weights: NDArray[np.float64]


def _draw_looks(task: TrainingTask, hosts: NDArray[np.bool_], rng: Generator) -> list[_Look]:
    """Draw looks at the farm: on larger ones fewer with more cells each, as all cells have to be judged."""
    field = _Fields(task, hosts, rng)
    wanted = max(task.outbreaks, _SMALLEST_TRAINING)
    most = max(_SMALLEST_TRAINING, _FURTHER_CELLS // (_WAYS * _LOOKS * max(field.hosts, 1)))
    number = min(wanted, most)
    cells = -(-_CELLS_A_LOOK * wanted // number)
    found = []
    for _ in range(number):
        land, truth, margin, weight = field.draw()
        for codes in _looks(land, truth, rng):
            chosen, counts = _choose(codes, margin, cells, rng)
            found.append(_Look(codes, chosen, truth[chosen[:, 0], chosen[:, 1]], weight * counts))
    return found


def _refine_samples(
    network: Network, looks: list[_Look], hosts: NDArray[np.bool_], seeds: int
) -> tuple[NDArray[np.float32], NDArray[np.int8], NDArray[np.float32]]:
    """Return samples like `draw_samples`, with what a network believes of all cells in further columns."""
    x, y = np.nonzero(hosts)
    row = np.zeros(hosts.shape, np.intp)
    row[x, y] = np.arange(len(x))
    samples = []
    for look in looks:
        believed = FieldJudge(network, look.codes, x, y, seeds).probabilities()
        rows = row[look.chosen[:, 0], look.chosen[:, 1]]
        features = np.zeros((len(rows), N_FEATURES), np.float32)
        local_features(look.codes, x[rows], y[rows], features)
        set_overall(features, overall_features(look.codes, len(x), seeds))
        context = context_features(look.codes, x, y, believed, seeds, rows)
        samples.append(np.concatenate([features, context], axis=1))
    classes = np.concatenate([look.classes for look in looks])
    return np.concatenate(samples), classes, _with_mean_one([look.weights for look in looks])


def _choose(
    codes: NDArray[np.uint8], margin: int, most: int, rng: Generator
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Choose cells not observed, preferably near sick ones, and say for how many each stands."""
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
    """Draws simulated fields: the farm, or on large farms windows of it with their share of the seeds."""

    def __init__(self, task: TrainingTask, hosts: NDArray[np.bool_], rng: Generator) -> None:
        self.whole = hosts.size <= WHOLE_FARM_CELLS
        self._ranks = np.cumsum(np.count_nonzero(hosts, axis=1))
        self.hosts = int(self._ranks[-1])
        self.seeds = task.parameters.seed_count(hosts.shape)
        self._land = hosts
        self._day = task.day
        self._rng = rng
        size = task.parameters.kernel_size
        if size is None:
            size = task.parameters.infection_rule(hosts.shape).kernel.size
        # Seeds and kernel follow from the farm's width, which a window does not have.
        self._parameters = replace(task.parameters, seeds=self.seeds, kernel_size=size)
        self._classes = classes_of(value_table(self._parameters, task.day))

    def draw(self) -> tuple[NDArray[np.bool_], NDArray[np.int8], int, float]:
        """Return cells with the crop, their classes, a margin to leave out, and the weight of this field."""
        if self.whole:
            return self._land, self._simulate(self._land, self.seeds), 0, 1.0
        rng = self._rng
        land = self._window()
        expected = self.seeds * np.count_nonzero(land) / self.hosts
        none = float(np.exp(-expected))
        if rng.random() >= _WITH_SEEDS_SHARE:
            return land, np.zeros(land.shape, np.int8), REACH, none / (1.0 - _WITH_SEEDS_SHARE)
        # Outbreaks are rare on a large farm: windows with at least one are drawn oftener and count less.
        # Their number is that of the arrivals of a Poisson process that has its first arrival before time 1.
        first = -np.log1p(-float(rng.random()) * (1.0 - none)) / max(expected, 1e-300)
        later = int(rng.poisson(expected * max(0.0, 1.0 - first)))
        weight = (1.0 - none) / _WITH_SEEDS_SHARE
        return land, self._simulate(land, 1 + later), REACH, weight

    def features(self, codes: NDArray[np.uint8], cells: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return what is known around some cells, float32[n, N_FEATURES]."""
        out = np.zeros((len(cells), N_FEATURES), np.float32)
        local_features(codes, cells[:, 0], cells[:, 1], out)
        if self.whole:
            set_overall(out, overall_features(codes, self.hosts, self.seeds))
        return out

    def _window(self) -> NDArray[np.bool_]:
        """Cut a window with a random cell of the crop somewhere in it."""
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
        onset = simulate_outbreak(land, replace(self._parameters, seeds=seeds), self._day, self._rng)
        return self._classes[onset.view(np.uint8)]
