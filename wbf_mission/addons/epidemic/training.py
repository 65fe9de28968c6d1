"""Training of the networks on simulated outbreaks.

The training simulates outbreaks of the disease and observes them along random paths that end at random times.
A small network learns the class of unobserved cells from the observations around them. The simulations use
separate random streams, so that a flown environment is among them only with a probability of 2^-128.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.seeds import stream
from sensors.dynamics.epidemic import MAX_DAYS, NEVER, EpidemicParameters, simulate_outbreak, value_table
from sensors.errors import EstimatorError
from sensors.estimators.base import Step, no_step
from sensors.estimators.paths import random_path
from wbf_mission.addons.epidemic.chase import chasing_path
from wbf_mission.addons.epidemic.features import (
    N_CONTEXT,
    N_FEATURES,
    N_LOCAL,
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
"""Version in the keys of networks; raise it with every change of the training."""
WHOLE_FARM_CELLS = 128 * 128
"""Largest farm (cells) simulated as a whole. Larger farms use windows, without whole-field features."""
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
FURTHER = 2
_JUDGED_CELLS = 6_000_000
_DAYS_TOGETHER = 8
_CHASING_SHARE = 0.35
_BEGUN_SHARE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class TrainingTask:
    """Parameters of a network's training; tasks with equal keys give equal networks.

    On farms of at most `WHOLE_FARM_CELLS`, eight days share a network.
    """

    parameters: EpidemicParameters
    hosts: NDArray[np.bool_]  # Crop map, bool[W, H].
    day: int  # Day of the observations.
    outbreaks: int = 1250  # Number of simulated fields.
    epochs: int = 6  # Number of passes over the samples.
    seed: int = 0

    @property
    def whole(self) -> bool:
        """Whether the training simulates the whole farm, not windows of it."""
        return self.hosts.size <= WHOLE_FARM_CELLS

    @property
    def first_day(self) -> int:
        """First of the days that share this network.

        >>> [TrainingTask(None, np.ones((side, side), bool), 6).first_day for side in (30, 300)]
        [0, 6]
        """
        return self.day - self.day % _DAYS_TOGETHER if self.whole else self.day

    @property
    def seeds(self) -> int:
        """Number of seeds (first infections) of the disease on the farm."""
        return self.parameters.seed_count(self.hosts.shape)

    @property
    def key(self) -> str:
        """File name of the network, without suffix; EstimatorError if environments have no such day."""
        if not 0 <= self.day <= MAX_DAYS:
            raise EstimatorError(
                f"epidemic: day {self.day} is not in 0..{MAX_DAYS}, the days of an environment"
            )
        parameters = asdict(self.parameters)
        if self.parameters.seed_spread_cells is None:
            # This parameter was added later: its default must change neither the file name nor the seed.
            del parameters["seed_spread_cells"]
        identity = {
            "parameters": parameters,
            "day": self.first_day,
            "outbreaks": self.outbreaks,
            "epochs": self.epochs,
            "seed": self.seed,
            "version": VERSION,
            "layers": LAYERS,
            "shape": self.hosts.shape,
        }
        digest = hashlib.sha256(json.dumps(identity, sort_keys=True).encode())
        digest.update(np.packbits(self.hosts).data)
        return digest.hexdigest()[:32]


def learn(task: TrainingTask, step: Step = no_step) -> Network:
    """Return a newly trained network; `step` is called with the finished fraction, 0..1."""
    rng = stream(task.seed, "epidemic-estimator", task.key)
    further = FURTHER if task.whole else 0
    steps, done = 2 + 2 * further, itertools.count(1)
    looks = draw_looks(task, rng)
    inputs, classes, weights = samples_of(looks)
    step(next(done) / steps)
    network = last = Network.draw(LAYERS, rng)
    train(last, inputs, classes, weights, epochs=task.epochs, rng=rng)
    step(next(done) / steps)
    found: list[NDArray[np.float32] | None] = [None] * len(looks)
    for _ in range(further):
        refined = _with_context(task, looks, inputs, last, found)
        step(next(done) / steps)
        last = Network.draw(FURTHER_LAYERS, rng)
        train(last, refined, classes, weights, epochs=task.epochs, rng=rng)
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


def draw_looks(task: TrainingTask, rng: Generator) -> list[Look]:
    """Return partly observed simulated fields (looks).

    Refinement networks evaluate all cells of each look. To save time, a training with such networks has fewer
    looks, and more samples in each look.
    """
    field = _Fields(task, rng)
    wanted = number = max(task.outbreaks, _SMALLEST_TRAINING)
    if task.whole:
        most = _JUDGED_CELLS // (_PATHS * _LOOKS * max(field.hosts, 1))
        number = min(wanted, max(_SMALLEST_TRAINING, most))
    cells = -(-_CELLS_A_LOOK * wanted // number)
    found = []
    for _ in range(number):
        land, history, margin, weight = field.draw()
        for _path in range(_PATHS):
            day = int(rng.integers(0, len(field.tables)))
            truth = field.tables[day][history.view(np.uint8)]
            for codes in _along_a_path(land, truth, rng):
                chosen, counts = _choose(codes, margin, cells, rng)
                x, y = chosen.T
                overall = np.zeros(N_OVERALL, np.float32)
                if task.whole:
                    overall = overall_features(codes, field.hosts, task.seeds, day)
                features = np.empty((len(chosen), N_FEATURES), np.float32)
                features[:, :N_LOCAL] = local_features(codes, x, y)
                features[:, N_LOCAL:] = overall
                kept = codes if task.whole else None
                found.append(Look(kept, day, overall, chosen, features, truth[x, y], weight * counts))
    return found


def _along_a_path(
    land: NDArray[np.bool_], truth: NDArray[np.int8], rng: Generator
) -> Iterator[NDArray[np.uint8]]:
    """Yield maps of codes after random parts of a random path, which may follow sick plants."""
    longest = max(1, int(_LONGEST_SHARE * land.size))
    cells = random_path(land.shape, longest, rng)
    if rng.random() < _CHASING_SHARE:
        begun = cells[: 1 + int(rng.random() * _BEGUN_SHARE * len(cells))]
        cells = chasing_path(begun, truth > 0, longest, rng)
    cells = cells[land[cells[:, 0], cells[:, 1]]]
    for look in range(_LOOKS):
        # The first look has the path up to a uniformly random point; later looks usually have most of the
        # path.
        count = int(np.ceil(len(cells) * rng.random() ** (1.0 if look == 0 else 0.3)))
        codes = padded_codes(land)
        x, y = cells[:count].T
        inner(codes)[x, y] = truth[x, y] + 1
        yield codes


def samples_of(
    looks: list[Look],
) -> tuple[NDArray[np.float32], NDArray[np.int8], NDArray[np.float32]]:
    """Return features, classes and weights of all samples of the looks; the weights are scaled to mean 1."""
    weights = np.concatenate([look.weights for look in looks])
    mean = weights.mean() if len(weights) else 1.0
    features = np.concatenate([look.features for look in looks])
    classes = np.concatenate([look.classes for look in looks])
    return features, classes, (weights / mean).astype(np.float32)


def _with_context(
    task: TrainingTask,
    looks: list[Look],
    features: NDArray[np.float32],
    last: Network,
    found: list[NDArray[np.float32] | None],
) -> NDArray[np.float32]:
    """Return the features of the samples, followed by the context features from network `last`.

    `found` has each look's probabilities of all cells by the previous network, and on return by `last`.
    """
    x, y = np.nonzero(task.hosts)
    row = np.zeros(task.hosts.shape, np.intp)
    row[x, y] = np.arange(len(x))
    out = np.empty((len(features), N_FEATURES + N_CONTEXT), np.float32)
    out[:, :N_FEATURES] = features
    start = 0
    for number, look in enumerate(looks):
        assert look.codes is not None
        classifier = FieldClassifier(last, look.codes, x, y, task.seeds, look.day)
        now = found[number] = classifier.probabilities(look.overall, found[number])
        rows = row[look.chosen[:, 0], look.chosen[:, 1]]
        end = start + len(rows)
        out[start:end, N_FEATURES:] = context_features(look.codes, x, y, now, task.seeds, rows)
        start = end
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
    """Simulates fields: the whole farm, or windows of a large farm with a proportional number of seeds."""

    def __init__(self, task: TrainingTask, rng: Generator) -> None:
        self._ranks = np.cumsum(np.count_nonzero(task.hosts, axis=1))
        self.hosts = int(self._ranks[-1])
        self._task, self._land, self._rng = task, task.hosts, rng
        self._parameters = task.parameters.on_window(task.hosts.shape, task.seeds)
        further = _DAYS_TOGETHER - 1 if task.whole else 0
        self._last_day = min(task.first_day + further, MAX_DAYS)
        days = range(task.first_day, self._last_day + 1)
        self.tables = [classes_of(value_table(self._parameters, day)) for day in days]

    def draw(self) -> tuple[NDArray[np.bool_], NDArray[np.int8], int, float]:
        """Return a field: host cells, days of infection, width of the margin without samples, sample weight.

        `tables` map days of infection, as unsigned bytes, to the classes on each day.
        """
        if self._task.whole:
            return self._land, self._simulate(self._land, self._task.seeds), 0, 1.0
        rng = self._rng
        land = self._window()
        expected = self._task.seeds * np.count_nonzero(land) / self.hosts
        none = math.exp(-expected)
        if rng.random() >= _WITH_SEEDS_SHARE:
            return land, np.full(land.shape, NEVER, np.int8), REACH, none / (1.0 - _WITH_SEEDS_SHARE)
        # Outbreaks are rare on large farms. Windows with an outbreak are drawn more often, but weigh less.
        # The seeds are the arrivals of a Poisson process whose first arrival is before time 1.
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
