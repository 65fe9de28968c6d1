"""Class probabilities of all cells for one disease, and the estimates with the least expected loss."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import exp, log, product
from sensors.scoring.score import PAPER_WEIGHTS
from wbf_mission.addons.epidemic.features import (
    N_FEATURES,
    N_LOCAL,
    REACH,
    SEEN_SUSCEPTIBLE,
    UNKNOWN,
    cells_in_reach,
    inner,
    local_features,
    padded_codes,
)
from wbf_mission.addons.epidemic.network import FieldClassifier
from wbf_mission.addons.epidemic.store import network_for
from wbf_mission.addons.epidemic.training import TrainingTask, classes_of

CLASS_VALUES = np.array([1.0, 0.5, 0.0])
"""Values of the classes susceptible, infected and removed."""


def least_loss_value(
    probabilities: NDArray[np.floating], asymmetry: float = PAPER_WEIGHTS.too_healthy[0]
) -> NDArray[np.float64]:
    """Return the estimate that minimises the expected loss of the score.

    The loss is ``a (v - e)^2`` if the estimate v is above the truth e, else ``(e - v)^2``. The best estimate
    is an expectile (Newey & Powell 1987), the solution of::

        a sum_{e < v} p_e (v - e) = sum_{e > v} p_e (e - v)

    For the values 1, 0.5 and 0, the solution has a closed form above 0.5, and another one below 0.5.

    `probabilities`, float[..., 3], are for the classes susceptible, infected and removed.

    >>> least_loss_value(np.array([[1, 0, 0], [0.9, 0.1, 0], [0, 0.5, 0.5], [0, 0, 1]])).round(3).tolist()
    [1.0, 0.737, 0.045, 0.0]
    """
    susceptible, infected, removed = np.moveaxis(np.asarray(probabilities, np.float64), -1, 0)
    upper = (susceptible + 0.5 * asymmetry * infected) / (susceptible + asymmetry * (infected + removed))
    lower = (susceptible + 0.5 * infected) / (susceptible + infected + asymmetry * removed)
    return np.where(upper >= 0.5, upper, lower)


def expected_loss(
    probabilities: NDArray[np.floating], value: NDArray[np.floating], too_healthy: float, too_sick: float
) -> NDArray[np.float64]:
    """Return the expected loss of estimated values: the mean over the classes, weighted by probability.

    >>> p = np.array([[0.0, 1, 0], [0.5, 0, 0.5]])
    >>> expected_loss(p, np.array([0.7, 0.1]), 10.0, 1.0).round(3).tolist()
    [0.4, 0.455]
    """
    susceptible, infected, removed = np.moveaxis(np.asarray(probabilities, np.float64), -1, 0)
    of_infected = np.where(value > CLASS_VALUES[1], too_healthy, too_sick)
    loss: NDArray[np.float64] = too_sick * susceptible * (value - CLASS_VALUES[0]) ** 2
    loss += of_infected * infected * (value - CLASS_VALUES[1]) ** 2
    loss += too_healthy * removed * (value - CLASS_VALUES[2]) ** 2
    return loss


def standard_deviation(probabilities: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the standard deviation of a cell's true value, given class probabilities, float[..., 3].

    >>> standard_deviation(np.array([[1.0, 0, 0], [0.5, 0, 0.5]])).tolist()
    [0.0, 0.5]
    """
    p = np.asarray(probabilities, np.float64)
    mean = product(p, CLASS_VALUES)
    return np.sqrt(np.maximum(product(p, CLASS_VALUES**2) - mean**2, 0.0))


_EXACT = 1e-3  # Readings that differ by less than this from the value of a class certainly show the class.
_SOFT = 1e-3
_TINY = 1e-12
_CHUNK_CELLS = 1 << 16
_LONGEST_TRUST_DAYS = 1

Floats = NDArray[np.float64]
_Index = tuple[NDArray[np.intp], NDArray[np.intp]] | tuple[NDArray[np.bool_]]


class DiseaseBelief:
    """Class probabilities of all cells on one day.

    `value` is the estimate with the least expected loss; `uncertainty` is the standard deviation of the true
    value. If `whole`, as on farms of at most `WHOLE_FARM_CELLS`, every update computes all cells. `task` is a
    training task; its day does not matter.
    """

    def __init__(
        self,
        task: TrainingTask,
        *,
        too_healthy: float,
        too_sick: float,
        misreading_rate: float,
        cache: str | os.PathLike[str] | None,
    ) -> None:
        self._task = task
        self._hosts = task.hosts
        self._has_hosts = bool(task.hosts.any())
        self._costs = too_healthy, too_sick
        self._misreading_rate = misreading_rate
        self._cache = cache
        self.whole = task.whole
        self._day: int | None = None
        self._seen = 0
        self.value = np.ones(self._hosts.shape, np.float32)
        self.uncertainty = np.zeros(self._hosts.shape, np.float32)
        # On large farms, probabilities and loss are computed on demand.
        self._probabilities: NDArray[np.float32] | None = None
        self._loss: NDArray[np.float32] | None = None
        if self.whole:
            self._add_maps()

    def _add_maps(self) -> None:
        """Add maps of class probabilities, float32[3, W, H], and expected loss, with all plants healthy."""
        self._probabilities = np.zeros((len(CLASS_VALUES), *self._hosts.shape), np.float32)
        self._probabilities[0] = 1.0
        self._loss = np.zeros(self._hosts.shape, np.float32)

    def wanted(self, days: Sequence[int]) -> list[TrainingTask]:
        """Return the training tasks for some days."""
        return [replace(self._task, day=day) for day in days] if self._has_hosts else []

    def update(self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats) -> None:
        """Update `value` and `uncertainty` for `day`, given the readings.

        The arguments are all readings of the run, with NaN where the disease was not sensed. `day` is not
        earlier than any reading.
        """
        self._told = day, cells, days, values
        if not self._has_hosts:
            return
        sensed = np.isfinite(values[self._seen :]) & self._hosts[tuple(cells[self._seen :].T)]
        if day != self._day or sensed.any():
            x, y, probabilities = self._changed(day, cells, days, values)
            if self.whole:
                # Write into new maps, because earlier models keep the old maps.
                self._add_maps()
            self._take((x, y), probabilities)
        self._seen = len(values)

    def _take(self, index: _Index, probabilities: Floats) -> None:
        """Write class probabilities of some cells, and the resulting estimate, into the maps."""
        too_healthy, too_sick = self._costs
        best = least_loss_value(probabilities, too_healthy / too_sick)
        self.value[index] = best
        self.uncertainty[index] = standard_deviation(probabilities)
        if self._probabilities is not None:
            self._probabilities[:, *index] = probabilities.T
        if self._loss is not None:
            self._loss[index] = expected_loss(probabilities, best, too_healthy, too_sick)

    @property
    def probabilities(self) -> NDArray[np.float32]:
        """Class probabilities of all cells, float32[3, W, H]; land without the crop is healthy.

        On large farms the probabilities are computed on every access. Each access takes as long as an update
        with all readings.
        """
        found = self._again()._probabilities if self._probabilities is None else self._probabilities
        assert found is not None
        return found

    @property
    def loss(self) -> NDArray[np.float32]:
        """Expected loss of `value`, float32[W, H]; 0 on land without the crop.

        On large farms the first access computes the array, and later updates change it in place.
        """
        if self._loss is None:
            self._loss = self._again()._loss
        assert self._loss is not None
        return self._loss

    def _again(self) -> DiseaseBelief:
        """Return a belief with the same readings, and with maps of probabilities and loss."""
        too_healthy, too_sick = self._costs
        again = DiseaseBelief(
            self._task,
            too_healthy=too_healthy,
            too_sick=too_sick,
            misreading_rate=self._misreading_rate,
            cache=self._cache,
        )
        again._add_maps()
        again.update(*self._told)
        return again

    def _begin(self, day: int) -> None:
        """Discard everything and load the network for a new day."""
        task = replace(self._task, day=day)
        self._network = network_for(task, self._cache)
        self._codes = padded_codes(self._hosts)
        self._day = day
        if self.whole:
            x, y = np.nonzero(self._hosts)
            self._x, self._y = x, y
            self._row = np.full(self._hosts.shape, -1, np.intp)
            self._row[x, y] = np.arange(len(x))
            self._classifier = FieldClassifier(
                self._network, self._codes, x, y, task.seeds, day - task.first_day
            )
            self._prior = self._classifier.probabilities().mean(axis=0)
            return
        nothing = np.zeros((1, N_FEATURES), np.float32)
        self._prior = self._network.probabilities(nothing)[0]
        self._take((self._hosts,), self._prior[None, :].astype(np.float64))

    def _changed(
        self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
        """Return the cells (x, y) that may have changed, and their class probabilities, float64[n, 3]."""
        fresh = day != self._day
        if fresh:
            self._begin(day)
        flat, likelihood, ages, exact = self._evidence(day, cells, days, values)
        new_x, new_y = self._mark(flat, likelihood, ages)
        shape = self._hosts.shape
        x, y = cells_in_reach(new_x, new_y, shape)
        kept = self._hosts[x, y]
        x, y = x[kept], y[kept]
        if self.whole:
            self._classifier.touch(self._row[x, y])
            x, y = self._x, self._y
            around = self._classifier.probabilities()
        else:
            if fresh or not exact:
                # A new day changes the likelihoods of older readings; a new noise estimate changes them all.
                both = np.union1d(x * shape[1] + y, flat)
                x, y = (part.astype(np.intp) for part in np.divmod(both, shape[1]))
            around = self._far_field(x, y)
        probabilities = around.astype(np.float64)
        at = x * shape[1] + y
        if len(flat) and len(at):
            found = np.minimum(np.searchsorted(flat, at), len(flat) - 1)
            read = flat[found] == at
            product = (probabilities[read] + _TINY) * likelihood[found[read]]
            probabilities[read] = product / product.sum(axis=1, keepdims=True)
        return x, y, probabilities

    def _far_field(self, x: NDArray[np.intp], y: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the network's class probabilities for cells of a large farm, float32[n, 3]."""
        out = np.empty((len(x), len(CLASS_VALUES)), np.float32)
        for start in range(0, len(x), _CHUNK_CELLS):
            part = slice(start, start + _CHUNK_CELLS)
            features = np.zeros((len(x[part]), N_FEATURES), np.float32)
            features[:, :N_LOCAL] = local_features(self._codes, x[part], y[part])
            out[part] = self._network.probabilities(features)
        return out

    def _mark(
        self, flat: NDArray[np.int64], likelihood: Floats, ages: NDArray[np.int32]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Enter the likeliest class of each observed cell into the map of codes; return the changed cells.

        A plant that was healthy on an earlier day gets the code for unknown if the disease may have reached
        it from an observed sick plant, or if the reading is too old.
        """
        codes = (np.argmax(likelihood * self._prior, axis=1) + 1).astype(np.uint8)
        x, y = (part.astype(np.intp) for part in np.divmod(flat, self._hosts.shape[1]))
        old = np.flatnonzero((ages > 0) & (codes == SEEN_SUSCEPTIBLE))
        if len(old):
            from scipy.spatial import cKDTree

            sick = codes > SEEN_SUSCEPTIBLE
            places = np.stack([x, y], axis=1)
            away: Floats = np.full(len(old), np.inf)
            if sick.any():
                away = np.asarray(cKDTree(places[sick]).query(places[old], p=np.inf)[0])
            speed = self._task.parameters.infection_rule(self._hosts.shape).kernel.radius
            doubtful = (away <= speed * (ages[old] + 1)) | (ages[old] > _LONGEST_TRUST_DAYS)
            codes[old[doubtful]] = UNKNOWN
        changed = inner(self._codes)[x, y] != codes
        x, y = x[changed], y[changed]
        self._codes[x + REACH, y + REACH] = codes[changed]
        return x, y

    def _evidence(
        self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats
    ) -> tuple[NDArray[np.int64], Floats, NDArray[np.int32], bool]:
        """Return the likelihood of today's classes, given each cell's own readings.

        The results are: flat indices of the observed cells, ascending; likelihoods, float64[n, 3], up to a
        factor per cell; days since each cell's latest reading; and whether all readings are exact.
        """
        classes = classes_of(values)
        sensed = (classes >= 0) & self._hosts[cells[:, 0], cells[:, 1]]
        cells, days, values, classes = cells[sensed], days[sensed], values[sensed], classes[sensed]
        flat = cells[:, 0].astype(np.int64) * self._hosts.shape[1] + cells[:, 1]
        off = np.abs(values - CLASS_VALUES[classes])
        if self._misreading_rate == 0.0 and not (off > _EXACT).any():
            # Exact readings: only the last reading of a cell counts.
            distinct, from_end = np.unique(flat[::-1], return_index=True)
            last = len(flat) - 1 - from_end
            likelihood = self._single(day, days[last], values[last], classes[last], 0.0)
            return distinct, likelihood, day - days[last], True
        noise = float(np.sqrt(np.mean(off**2))) if len(off) else 0.0
        single = self._single(day, days, values, classes, noise)
        distinct, inverse = np.unique(flat, return_inverse=True)
        logs = log(single + _TINY)
        total = np.stack([np.bincount(inverse, of_class, len(distinct)) for of_class in logs.T], axis=1)
        latest = np.zeros(len(distinct), np.int32)
        np.maximum.at(latest, inverse, days)
        return distinct, exp(total - total.max(axis=1, keepdims=True)), day - latest, False

    def _single(
        self, day: int, days: NDArray[np.int32], values: Floats, classes: NDArray[np.int8], noise: float
    ) -> Floats:
        """Return the likelihood of each class today, given each reading alone, float64[n, 3]."""
        if noise > _EXACT:
            shown = exp(-0.5 * ((values[:, None] - CLASS_VALUES) / noise) ** 2)
        else:
            shown = np.eye(len(CLASS_VALUES))[classes]
        rate = self._misreading_rate
        likelihood: Floats = shown * (1.0 - 1.5 * rate) + 0.5 * rate * shown.sum(axis=1, keepdims=True)
        old = days != day
        if old.any():
            parameters = self._task.parameters
            ill = np.clip(1.0 - (day - days[old]) / parameters.duration_days, 0.0, 1.0)
            ill = np.where(classes[old] == 1, ill, 0.0)
            sick = np.stack([np.zeros(len(ill)), ill, 1.0 - ill], axis=1)
            healthy = self._since_healthy(day)[day - days[old]]
            likelihood[old] = np.where((classes[old] == 0)[:, None], healthy, sick)
            if noise > _EXACT or rate:
                likelihood[old] += _SOFT
        return likelihood

    def _since_healthy(self, day: int) -> Floats:
        """Return the likelihood of each class for a plant that was healthy 0, 1, ... days ago, [days, 3].

        The likelihood of a class is the fraction of today's plants of this class that became infected since
        that day. Daily new infections are assumed to grow linearly, as if an outbreak spreads at fixed speed.
        """
        new = day - np.arange(day + 1.0)
        duration = self._task.parameters.duration_days
        since = np.concatenate([[0.0], np.cumsum(new)])[: day + 1]
        ill = np.minimum(since / max(new[:duration].sum(), 1.0), 1.0)
        lost = np.maximum(since - new[:duration].sum(), 0.0) / max(new[duration:].sum(), 1.0)
        return np.stack([np.ones(day + 1), ill, np.minimum(lost, 1.0)], axis=1)
