"""The epidemic of a disease: the SIRV status of cells, the step of one day, and whole outbreaks.

The status of a cell is 0 if the cell is susceptible (S), k > 0 if infected (I) with k days remaining, -1 if
removed (R) and -2 if immune (V: another crop, or no plants). A day has three steps:

1. The remaining days of infected cells decrease by one; cells with no remaining day become removed.
2. The infected neighbours of each susceptible cell are counted, weighted by a distance kernel.
3. Each susceptible cell becomes infected with a probability that depends on its count.

An infection lasts a fixed number of days. Thus a cell's status on every day follows from its onset, the day
on which the cell was infected. One byte per cell stores the whole history of a disease.

There are two rules for the infection probability p. The rule ``"count"`` of the Waterberry Farms code rounds
the count down to n, and p = 1 - (1 - p_t)^n. The rule ``"kernel"`` of the paper's text does not round the
count: p = min(1, p_t * count). There the count is the convolution of infected cells with a distance kernel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.linear_algebra import exp
from geo.seeds import stream
from geo.texts import unknown
from sensors.dynamics.infection import DistanceKernel, InfectionFront, make_kernel
from sensors.errors import EnvironmentDataError

SUSCEPTIBLE = 0
REMOVED = -1
IMMUNE = -2
MAX_DAYS = 126
"""Largest number of days of an infection or an environment; status and onset are stored as int8."""
NEVER = -1
"""Onset of a cell that was never infected."""
NO_HOST = -2
"""Onset of a cell that cannot be infected."""
_STRIP_ROWS = 64  # Hosts are listed for this many rows at a time, which takes 2.5 MB on Waterberry
_VALUES = {SUSCEPTIBLE: 1.0, REMOVED: 0.0, IMMUNE: 1.0}

Draws = Callable[[NDArray[np.intp]], NDArray[np.float64]] | NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class InfectionRule:
    """Rule that gives the infection probability of a cell for its weighted count of infected neighbours.

    Parameters
    ----------
    likelihood : float
        p_t, the infection probability of a cell whose count is 1.
    rounded : bool
        True for the rule ``"count"``, which rounds counts down; False for the rule ``"kernel"``.
    """

    kernel: DistanceKernel
    likelihood: float
    duration_days: int
    rounded: bool = True

    def probability(self, total: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the infection probabilities of cells from their counts, in units of the kernel.

        The computation only adds, multiplies and divides, which IEEE 754 defines to the last bit. Comparisons
        with random draws thus have the same result on every machine.
        """
        if not self.rounded:
            return np.minimum(total / self.kernel.unit * self.likelihood, 1.0)
        spared = [1.0]
        for _ in range(self.kernel.total // self.kernel.unit):
            spared.append(spared[-1] * (1.0 - self.likelihood))
        table: NDArray[np.float64] = 1.0 - np.array(spared)
        return table[total // self.kernel.unit]


@dataclass(frozen=True, slots=True)
class EpidemicParameters:
    """Parameters of the epidemic of a disease.

    Parameters
    ----------
    likelihood : float
        p_t, probability in 0..1 that one infected orthogonal neighbour infects a cell within a day.
    duration_days : int
        Duration of an infection.
    seed_duration_days : int
        Duration of the infections that begin on day 0.
    seeds : int, optional
        Number of infected cells on day 0. The default is 3 per 30 cells of the farm's width, at least 3.
    kernel_size : int, optional
        Side of the square of neighbours, an odd number of cells. The default is ``2 * int(sqrt(width) / 6) +
        3``, at most 11.
    kernel_shape : {"inverse-square", "exponential", "gaussian"}
        See `sensors.dynamics.infection.make_kernel`.
    kernel_length_cells : float
        Length of the exponential and Gaussian shapes, cells.
    rule : {"count", "kernel"}
        Infection rule; see the module's docstring.
    seed_spread_cells : float, optional
        Standard deviation (cells) of the seeds about the first seed, for a disease introduced at one point.
        By default seeds are uniform over the farm.

    Raises
    ------
    EnvironmentDataError
        If a value is out of its range.
    """

    kind: ClassVar[str] = "disease"

    likelihood: float
    duration_days: int
    seed_duration_days: int = 5
    seeds: int | None = None
    kernel_size: int | None = None
    kernel_shape: str = "inverse-square"
    kernel_length_cells: float = 1.0
    rule: Literal["count", "kernel"] = "count"
    seed_spread_cells: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.likelihood <= 1.0:
            raise EnvironmentDataError(f"epidemic: likelihood {self.likelihood} is not a probability in 0..1")
        for name in ("duration_days", "seed_duration_days"):
            days = getattr(self, name)
            if not 1 <= days <= MAX_DAYS:
                raise EnvironmentDataError(f"epidemic: {name} {days} is not in 1..{MAX_DAYS}")
        if self.seeds is not None and self.seeds < 0:
            raise EnvironmentDataError(f"epidemic: seeds {self.seeds} is negative")
        if self.rule not in ("count", "kernel"):
            raise EnvironmentDataError(f"epidemic: {unknown('rule', self.rule, ('count', 'kernel'))}")
        spread = self.seed_spread_cells
        if spread is not None and not 0.0 < spread < math.inf:
            raise EnvironmentDataError(f"epidemic: seed_spread_cells {spread} is not a positive number")
        size = 3 if self.kernel_size is None else self.kernel_size
        make_kernel(self.kernel_shape, size, self.kernel_length_cells)

    def seed_count(self, shape: tuple[int, int]) -> int:
        """Return the number of seeds, the cells infected on day 0, on a farm of this shape (cells).

        >>> [TYLCV.seed_count((w, w)) for w in (10, 30, 100, 6000)]
        [3, 3, 9, 600]
        """
        return self.seeds if self.seeds is not None else 3 * max(shape[0] // 30, 1)

    def infection_rule(self, shape: tuple[int, int]) -> InfectionRule:
        """Return the infection rule for a farm of this shape (cells).

        >>> [TYLCV.infection_rule((w, w)).kernel.size for w in (10, 30, 100, 6000)]
        [3, 3, 5, 11]
        """
        size = self.kernel_size
        if size is None:
            size = min(11, 2 * int(math.sqrt(shape[0]) / 6.0) + 3)
        kernel = make_kernel(self.kernel_shape, size, self.kernel_length_cells)
        return InfectionRule(kernel, self.likelihood, self.duration_days, self.rule == "count")

    def on_window(self, shape: tuple[int, int], seeds: int) -> EpidemicParameters:
        """Return the parameters for simulating only a window of a farm of this shape (cells).

        The kernel keeps its size on the whole farm; the width of the window might give a smaller kernel.

        >>> TYLCV.on_window((100, 100), seeds=2).kernel_size
        5
        """
        return replace(self, seeds=seeds, kernel_size=self.infection_rule(shape).kernel.size)


TYLCV = EpidemicParameters(likelihood=0.25, duration_days=5)
"""Tomato yellow leaf curl virus on tomatoes, with the parameters of the Waterberry Farms code."""
CCR = EpidemicParameters(likelihood=0.15, duration_days=10)
"""Charcoal rot on strawberries, with the parameters of the Waterberry Farms code."""


def age(status: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the status of all cells a day later if no cell becomes infected.

    Examples
    --------
    >>> age(np.array([[5, 1, 0, -1, -2]], np.int8)).tolist()
    [[4, -1, 0, -1, -2]]
    """
    return np.where(status > 1, status - 1, np.where(status == 1, REMOVED, status)).astype(np.int8)


def step(status: NDArray[np.int8], draws: Draws, rule: InfectionRule) -> NDArray[np.int8]:
    """Return the status of all cells a day later in a new array.

    `draws` are random numbers in [0, 1). They are an array with a number for each cell, or a function that
    returns a number for each given flat index. The function is called once, with the cells that may become
    infected (ascending, C order). A cell with probability p and draw u becomes infected if p > u. Cells that
    are infected on immune land infect their neighbours too.

    Examples
    --------
    >>> status = np.zeros((3, 3), np.int8)
    >>> status[1, 1] = 5
    >>> step(status, np.full((3, 3), 0.2), TYLCV.infection_rule((3, 3))).tolist()
    [[0, 5, 0], [5, 4, 5], [0, 5, 0]]
    """
    aged = age(status)
    front = InfectionFront(aged == SUSCEPTIBLE, rule.kernel)
    front.infect(np.flatnonzero(aged > 0))
    aged.reshape(-1)[_newly_infected(front, draws, rule)] = rule.duration_days
    return aged


def _newly_infected(front: InfectionFront, draws: Draws, rule: InfectionRule) -> NDArray[np.intp]:
    """Draw the cells that become infected within a day."""
    cells, total = front.exposed()
    probability = rule.probability(total)
    possible = probability > 0.0
    cells, probability = cells[possible], probability[possible]
    uniform = draws(cells) if callable(draws) else draws.reshape(-1)[cells]
    return cells[probability > uniform]


def draw_seeds(
    susceptible: NDArray[np.bool_], count: int, rng: Generator, spread_cells: float | None = None
) -> NDArray[np.intp]:
    """Draw the seeds, the cells infected on day 0, as ascending flat indices in C order.

    Seeds are uniform over the susceptible cells. With `spread_cells`, only the first seed is uniform, and the
    other seeds are normally distributed about the first. Seeds may coincide.
    """
    if spread_cells is not None:
        return _draw_cluster(susceptible, count, rng, spread_cells)
    per_row = np.count_nonzero(susceptible, axis=1)
    last_rank = np.cumsum(per_row)
    hosts = int(last_rank[-1]) if last_rank.size else 0
    if hosts == 0:
        return np.empty(0, np.intp)
    draws = np.sort(rng.integers(0, hosts, count))
    ranks = draws[np.diff(draws, prepend=-1) > 0]
    edges = np.append(last_rank - per_row, hosts)[[*range(0, len(susceptible), _STRIP_ROWS), -1]]
    cells = [np.empty(0, np.intp)]
    for strip, (first, last) in enumerate(pairwise(np.searchsorted(ranks, edges).tolist())):
        if first < last:
            rows = slice(strip * _STRIP_ROWS, (strip + 1) * _STRIP_ROWS)
            hosts_there = np.flatnonzero(susceptible[rows]) + rows.start * susceptible.shape[1]
            cells.append(hosts_there[ranks[first:last] - edges[strip]])
    return np.concatenate(cells)


def _draw_cluster(
    susceptible: NDArray[np.bool_], count: int, rng: Generator, spread_cells: float
) -> NDArray[np.intp]:
    first = draw_seeds(susceptible, min(count, 1), rng)
    if first.size == 0:
        return first
    hosts = np.flatnonzero(susceptible)
    x, y = np.divmod(hosts, susceptible.shape[1])
    x0, y0 = divmod(int(first[0]), susceptible.shape[1])
    weight = np.cumsum(exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2.0 * spread_cells**2)))
    others = np.searchsorted(weight, rng.random(count - 1) * weight[-1], side="right")
    return np.union1d(first, hosts[others])


def simulate_outbreak(
    susceptible: NDArray[np.bool_],
    parameters: EpidemicParameters,
    days: int,
    rng: Generator,
    on_day: Callable[[], None] = lambda: None,
) -> NDArray[np.int8]:
    """Simulate an outbreak for `days` days, and return the onset of each cell, int8[W, H].

    The onset is the day of infection (0 for seeds), `NEVER` or `NO_HOST`. The result is as if `step` were
    called every day, but the cost is proportional to the number of infected cells. The generator draws the
    seeds, then on each day a uniform number for each cell that may become infected, in C order.
    """
    rule = parameters.infection_rule(susceptible.shape)
    onset = np.where(susceptible, np.int8(NEVER), np.int8(NO_HOST))
    flat = onset.reshape(-1)
    count = parameters.seed_count(susceptible.shape)
    seeds = draw_seeds(susceptible, count, rng, parameters.seed_spread_cells)
    front = InfectionFront(susceptible, rule.kernel)
    front.infect(seeds)
    flat[seeds] = 0
    ending = {parameters.seed_duration_days: [seeds]}
    for day in range(1, days + 1):
        for cells in ending.pop(day, []):
            front.remove(cells)
        infected = _newly_infected(front, lambda cells: rng.random(cells.size), rule)
        front.infect(infected)
        flat[infected] = day
        ending.setdefault(day + rule.duration_days, []).append(infected)
        on_day()
    return onset


def status_table(parameters: EpidemicParameters, day: int) -> NDArray[np.int8]:
    """Return the status on a day for each onset, int8[256]; the index is the onset as an unsigned byte.

    Examples
    --------
    >>> table = status_table(TYLCV, 6)
    >>> [int(table[onset]) for onset in (0, 1, 2, 6, 7, NEVER, NO_HOST)]
    [-1, -1, 1, 5, 0, 0, -2]
    """
    table = np.full(256, SUSCEPTIBLE, np.int8)
    for onset in range(min(day, 127) + 1):
        duration = parameters.duration_days if onset else parameters.seed_duration_days
        left = duration - (day - onset)
        table[onset] = left if left > 0 else REMOVED
    table[NO_HOST] = IMMUNE
    return table


def value_table(parameters: EpidemicParameters, day: int) -> NDArray[np.float32]:
    """Return the field's value on a day for each onset, float32[256], indexed like `status_table`.

    The value of status S is 1.0, of I 0.5, of R 0.0 and of V 1.0; cells with status V are not scored.
    """
    return np.array([_VALUES.get(int(status), 0.5) for status in status_table(parameters, day)], np.float32)


_OUTBREAKS = 100
_SIDE_CELLS = 64
_SHARED_DAYS = 4  # This many consecutive days share a simulation, to save time in campaigns


@dataclass(frozen=True, slots=True)
class Outbreak:
    """Statistics of simulated outbreaks of a disease on a day; each outbreak began with a single sick plant.

    Parameters
    ----------
    together : float
        Sum of the squared sizes of outbreaks divided by the sum of the sizes, in sick plants. If outbreaks
        start at random points and do not meet, this is the ratio of variance to mean of the number of sick
        plants.
    illness : float
        Mean of (1 - value) over all sick plants.
    """

    together: float
    illness: float


@lru_cache(maxsize=64)
def outbreak_of(parameters: EpidemicParameters, shape: tuple[int, int], day: int) -> Outbreak:
    """Return outbreak statistics for a farm of this shape (cells), simulated on land full of host plants.

    Examples
    --------
    >>> small, large = (outbreak_of(TYLCV, (side, side), 6) for side in (30, 1000))
    >>> 10 < small.together < 30 < 50 < large.together < 90, 0.5 < large.illness < small.illness < 0.6
    (True, True)
    """
    illness_by_onset = 1.0 - np.asarray(value_table(parameters, day), np.float64)
    counts, illness = np.zeros(_OUTBREAKS), 0.0
    last_day = max(day, min(_SHARED_DAYS * math.ceil(day / _SHARED_DAYS), MAX_DAYS))
    for number, onset in enumerate(_onsets(parameters, shape, last_day)):
        # The table of a day counts plants with a later onset as healthy.
        ill = illness_by_onset[onset.view(np.uint8)]
        counts[number] = np.count_nonzero(ill > 0.0)
        illness += float(ill.sum())
    sick = float(counts.sum())
    if sick == 0.0:
        return Outbreak(1.0, 0.5)
    return Outbreak(float(np.square(counts).sum()) / sick, illness / sick)


@lru_cache(maxsize=8)
def _onsets(
    parameters: EpidemicParameters, shape: tuple[int, int], last_day: int
) -> tuple[NDArray[np.int8], ...]:
    """Return the onsets of simulated outbreaks up to `last_day`; each begins with a single sick plant."""
    from_one_plant = parameters.on_window(shape, 1)
    side = min(max(shape), _SIDE_CELLS)
    land = np.ones((side, side), np.bool_)
    return tuple(
        simulate_outbreak(land, from_one_plant, last_day, stream(0, "report", str(number)))
        for number in range(_OUTBREAKS)
    )
