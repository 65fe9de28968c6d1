"""The course of a disease over days, kept as one number a cell: the day on which it was infected.

Infections last for a fixed number of days, so the day of infection ("onset") tells the status on every day.
One byte a cell holds the whole history of a disease, whatever the number of days.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sensors.dynamics.epidemic import IMMUNE, REMOVED, SUSCEPTIBLE, EpidemicParameters
from sensors.dynamics.front import InfectionFront

NEVER = -1
"""Onset of a cell that was not infected."""
NO_HOST = -2
"""Onset of a cell that cannot be infected."""
_VALUES = {SUSCEPTIBLE: 1.0, REMOVED: 0.0, IMMUNE: 1.0}


def draw_seeds(susceptible: NDArray[np.bool_], count: int, rng: Generator) -> NDArray[np.intp]:
    """Draw the cells of the infections of day 0.

    Every susceptible cell is equally likely for each seed, which is the same as to draw cells of the farm
    again until one is susceptible. Two seeds may fall on one cell.

    Parameters
    ----------
    susceptible : bool[W, H]
        Cells that can be infected.
    count : int
        Number of seeds.
    rng : numpy.random.Generator
        Gives `count` integers.

    Returns
    -------
    intp[n]
        Different flat indices (C order), ascending; empty if no cell is susceptible.
    """
    per_row = np.count_nonzero(susceptible, axis=1)
    last_rank = np.cumsum(per_row)
    hosts = int(last_rank[-1]) if last_rank.size else 0
    if hosts == 0:
        return np.empty(0, np.intp)
    ranks = np.unique(rng.integers(0, hosts, count))
    rows = np.searchsorted(last_rank, ranks, side="right")
    height = susceptible.shape[1]
    cells = [
        row * height + np.flatnonzero(susceptible[row])[rank - (last_rank[row] - per_row[row])]
        for row, rank in zip(rows.tolist(), ranks.tolist(), strict=True)
    ]
    return np.array(cells, np.intp)


def simulate_outbreak(
    susceptible: NDArray[np.bool_],
    parameters: EpidemicParameters,
    days: int,
    rng: Generator,
    on_day: Callable[[], None] = lambda: None,
) -> NDArray[np.int8]:
    """Let a disease run for some days.

    The result is that of `sensors.dynamics.epidemic.step` repeated day by day, at a cost proportional to
    the number of infected cells.

    Parameters
    ----------
    susceptible : bool[W, H]
        Cells with the crop of the disease, whoever owns them.
    parameters : EpidemicParameters
        The disease.
    days : int
        Number of steps, at most `sensors.dynamics.epidemic.MAX_DAYS`.
    rng : numpy.random.Generator
        Gives the seeds, then on each day one uniform number for each cell that may be infected, in C order.
    on_day : callable
        Called after each day.

    Returns
    -------
    int8[W, H]
        Onset: the day of infection, 0 for the seeds; -1 for cells never infected, -2 for cells without the
        crop.
    """
    rule = parameters.infection_rule(susceptible.shape)
    onset = np.where(susceptible, np.int8(NEVER), np.int8(NO_HOST))
    flat = onset.reshape(-1)
    seeds = draw_seeds(susceptible, parameters.seed_count(susceptible.shape), rng)
    front = InfectionFront(susceptible, rule.kernel)
    front.infect(seeds)
    flat[seeds] = 0
    ending = {parameters.seed_duration_days: [seeds]}
    for day in range(1, days + 1):
        for cells in ending.pop(day, []):
            front.remove(cells)
        cells, total = front.exposed()
        probability = rule.probability(total)
        possible = probability > 0.0
        cells, probability = cells[possible], probability[possible]
        infected = cells[probability > rng.random(cells.size)]
        front.infect(infected)
        flat[infected] = day
        ending.setdefault(day + rule.duration_days, []).append(infected)
        on_day()
    return onset


def status_table(parameters: EpidemicParameters, day: int) -> NDArray[np.int8]:
    """Tabulate the status on a day by the onset.

    Parameters
    ----------
    parameters : EpidemicParameters
        The disease, for its durations.
    day : int
        The day.

    Returns
    -------
    int8[256]
        SIRV status; the index is the onset read as an unsigned byte.

    Examples
    --------
    >>> from sensors.dynamics.epidemic import TYLCV
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
    """Tabulate the value on a day by the onset: S 1.0, I 0.5, R 0.0; V 1.0, which no score counts.

    Parameters
    ----------
    parameters : EpidemicParameters
        The disease, for its durations.
    day : int
        The day.

    Returns
    -------
    float32[256]
        Values; the index is the onset read as an unsigned byte.
    """
    return np.array([_VALUES.get(int(status), 0.5) for status in status_table(parameters, day)], np.float32)
