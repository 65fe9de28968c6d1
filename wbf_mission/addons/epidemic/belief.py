"""Class probabilities of all cells for one disease, updated with new readings."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import exp, log
from wbf_mission.addons.epidemic.expected import (
    CLASS_VALUES,
    expected_loss,
    least_loss_value,
    standard_deviation,
)
from wbf_mission.addons.epidemic.features import (
    N_FEATURES,
    REACH,
    SEEN_SUSCEPTIBLE,
    UNKNOWN,
    cells_in_reach,
    inner,
    local_features,
    padded_codes,
)
from wbf_mission.addons.epidemic.network import FieldClassifier, Network
from wbf_mission.addons.epidemic.training import (
    WHOLE_FARM_CELLS,
    TrainingTask,
    classes_of,
    first_day,
    network_for,
)

EXACT = 1e-3
"""A reading closer than this to the value of a class shows the class with certainty."""

_UNREAD = -1


class LastReadings:
    """Class and day of the last reading of each cell.

    Readings of cells without the disease's crop are ignored. `exact` is whether each reading had the value of
    a class.

    Examples
    --------
    >>> last = LastReadings(np.ones((2, 3), np.bool_))
    >>> last.follow(np.array([[1, 0], [0, 2], [1, 0]]), np.array([6, 6, 7]), np.array([1.0, 0.5, 0.0]))
    >>> [part.tolist() for part in last.known()], last.exact
    ([[2, 3], [1, 2], [6, 7]], True)
    """

    def __init__(self, hosts: NDArray[np.bool_]) -> None:
        self.exact = True
        self._hosts = hosts
        self._classes = np.full(hosts.size, _UNREAD, np.int8)
        self._days = np.zeros(hosts.size, np.int32)
        self._followed = 0

    def follow(
        self, cells: NDArray[np.integer], days: NDArray[np.integer], values: NDArray[np.float64]
    ) -> None:
        """Add the new readings if all readings were exact.

        The arguments are all readings of the run in order, with NaN where the disease was not sensed.
        """
        new = slice(self._followed, None)
        self._followed = len(values)
        if not self.exact:
            return
        x, y = cells[new].T
        classes = classes_of(values[new])
        sensed = (classes >= 0) & self._hosts[x, y]
        x, y, classes = x[sensed], y[sensed], classes[sensed]
        self.exact = not (np.abs(values[new][sensed] - CLASS_VALUES[classes]) > EXACT).any()
        flat = x.astype(np.int64) * self._hosts.shape[1] + y
        # The last reading of a cell overwrites earlier ones.
        self._classes[flat] = classes
        self._days[flat] = days[new][sensed]

    def known(self) -> tuple[NDArray[np.int64], NDArray[np.int8], NDArray[np.int32]]:
        """Return flat indices of cells with readings, ascending, and class and day of the last reading."""
        flat = np.flatnonzero(self._classes != _UNREAD)
        return flat, self._classes[flat], self._days[flat]


_SOFT = 1e-3
_TINY = 1e-12
_CHUNK_CELLS = 1 << 16
_LONGEST_TRUST_DAYS = 1

Floats = NDArray[np.float64]
_Index = tuple[NDArray[np.intp], NDArray[np.intp]] | tuple[NDArray[np.bool_]]


class DiseaseBelief:
    """Class probabilities of all cells on one day.

    `value` is the estimate of least expected loss, and `uncertainty` the standard deviation of the true
    value. `whole`: every update computes all cells, on farms of at most `WHOLE_FARM_CELLS`.
    """

    def __init__(
        self,
        hosts: NDArray[np.bool_],
        task: TrainingTask,
        *,
        too_healthy: float,
        too_sick: float,
        misreading_rate: float,
        cache: str | os.PathLike[str] | None,
    ) -> None:
        self._hosts = hosts
        self._task = task
        self._costs = too_healthy, too_sick
        self._misreading_rate = misreading_rate
        self._cache = cache
        self._host_count = int(np.count_nonzero(hosts))
        self._seeds = task.parameters.seed_count(hosts.shape)
        self.whole = hosts.size <= WHOLE_FARM_CELLS
        self._day: int | None = None
        self._seen = 0
        self._last = LastReadings(hosts)
        self.value = np.ones(hosts.shape, np.float32)
        self.uncertainty = np.zeros(hosts.shape, np.float32)
        # Large farms compute probabilities and loss on demand.
        self._probabilities = self._certain() if self.whole else None
        self._loss = np.zeros(hosts.shape, np.float32) if self.whole else None

    def wanted(self, days: Sequence[int]) -> list[tuple[TrainingTask, NDArray[np.bool_]]]:
        """Return the training tasks for some days, each with the crop map."""
        if not self._host_count:
            return []
        return [(replace(self._task, day=day), self._hosts) for day in days]

    def update(self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats) -> None:
        """Update `value` and `uncertainty` to `day` and the readings.

        The arguments are all readings of the run, with NaN where the disease was not sensed. `day` is not
        earlier than any reading.
        """
        if not self._host_count:
            return
        sensed = np.isfinite(values[self._seen :]) & self._hosts[tuple(cells[self._seen :].T)]
        if day == self._day and not sensed.any():
            self._seen = len(values)
            return
        x, y, probabilities = self._changed(day, cells, days, values)
        if self.whole:
            # Allocate new arrays, because earlier models keep the old ones.
            self._probabilities, self._loss = self._certain(), np.zeros(self._hosts.shape, np.float32)
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

    def probabilities(
        self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats
    ) -> NDArray[np.float32]:
        """Return the class probabilities of all cells, float32[3, W, H]; land without the crop is healthy.

        The arguments must be those of the last `update`. On large farms the call takes as long as an update
        with all readings.
        """
        if self._probabilities is not None:
            return self._probabilities
        again = self._again()
        again._probabilities = self._certain()
        again.update(day, cells, days, values)
        return again._probabilities

    def expected_loss(
        self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats
    ) -> NDArray[np.float32]:
        """Return the expected loss of `value`, float32[W, H]; 0 on land without the crop.

        The arguments must be those of the last `update`. On large farms the first call allocates the array,
        and later updates change it in place.
        """
        if self._loss is None:
            again = self._again()
            again._loss = np.zeros(self._hosts.shape, np.float32)
            again.update(day, cells, days, values)
            self._loss = again._loss
        return self._loss

    def _certain(self) -> NDArray[np.float32]:
        """Return class probabilities, float32[3, W, H], with every plant healthy."""
        out = np.zeros((len(CLASS_VALUES), *self._hosts.shape), np.float32)
        out[0] = 1.0
        return out

    def _again(self) -> DiseaseBelief:
        too_healthy, too_sick = self._costs
        return DiseaseBelief(
            self._hosts,
            self._task,
            too_healthy=too_healthy,
            too_sick=too_sick,
            misreading_rate=self._misreading_rate,
            cache=self._cache,
        )

    def _begin(self, day: int) -> None:
        """Discard everything and load the network for a new day."""
        self._network: Network = network_for(replace(self._task, day=day), self._hosts, self._cache)
        self._codes = padded_codes(self._hosts)
        self._day = day
        if self.whole:
            x, y = np.nonzero(self._hosts)
            self._x, self._y = x, y
            self._row = np.full(self._hosts.shape, -1, np.intp)
            self._row[x, y] = np.arange(len(x))
            self._classifier = FieldClassifier(
                self._network, self._codes, x, y, self._seeds, day - first_day(day, self._hosts)
            )
            self._prior = self._classifier.probabilities().mean(axis=0)
            return
        nothing = np.zeros((1, N_FEATURES), np.float32)
        self._prior = self._network.probabilities(nothing)[0]
        self._take((self._hosts,), self._prior[None, :].astype(np.float64))

    def _changed(
        self, day: int, cells: NDArray[np.int32], days: NDArray[np.int32], values: Floats
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
        """Return the cells (x, y) with possible changes, and their class probabilities, float64[n, 3]."""
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
                # A new day changes the likelihoods of older readings, a new noise estimate all likelihoods.
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
            local_features(self._codes, x[part], y[part], features)
            out[part] = self._network.probabilities(features)
        return out

    def _mark(
        self, flat: NDArray[np.int64], likelihood: Floats, ages: NDArray[np.int32]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Enter the likeliest class of observed cells into the map of codes; return the changed cells.

        A plant observed as healthy on an earlier day becomes unknown if the disease may have reached it from
        an observed sick plant, or if the reading is too old.
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
        factor per cell; days since each cell's latest reading; and whether readings are taken as the truth.
        """
        if self._misreading_rate == 0.0:
            self._last.follow(cells, days, values)
            if self._last.exact:
                distinct, classes, days = self._last.known()
                exactly = CLASS_VALUES[classes]
                return distinct, self._single(day, days, exactly, classes, 0.0), day - days, True
        classes = classes_of(values)
        sensed = (classes >= 0) & self._hosts[cells[:, 0], cells[:, 1]]
        cells, days, values, classes = cells[sensed], days[sensed], values[sensed], classes[sensed]
        flat = cells[:, 0].astype(np.int64) * self._hosts.shape[1] + cells[:, 1]
        off = np.abs(values - CLASS_VALUES[classes])
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
        if noise > EXACT:
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
            if noise > EXACT or rate:
                likelihood[old] += _SOFT
        return likelihood

    def _since_healthy(self, day: int) -> Floats:
        """Return the likelihood of each class for a plant that was healthy 0, 1, ... days ago, [days, 3].

        The likelihood of a class is the fraction of its plants that became infected since that day. Daily new
        infections are assumed to grow linearly in time, as in an outbreak that spreads at constant speed.
        """
        new = day - np.arange(day + 1.0)
        duration = self._task.parameters.duration_days
        since = np.concatenate([[0.0], np.cumsum(new)])[: day + 1]
        ill = np.minimum(since / max(new[:duration].sum(), 1.0), 1.0)
        lost = np.maximum(since - new[:duration].sum(), 0.0) / max(new[duration:].sum(), 1.0)
        return np.stack([np.ones(day + 1), ill, np.minimum(lost, 1.0)], axis=1)
