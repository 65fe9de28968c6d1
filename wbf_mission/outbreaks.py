"""What one outbreak of a disease looks like: how many plants are sick together, and how sick a plant is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.seeds import stream
from sensors.dynamics.epidemic import MAX_DAYS, EpidemicParameters
from sensors.dynamics.outbreak import simulate_outbreak, value_table

_OUTBREAKS = 100
_SIDE_CELLS = 64
_SHARED_DAYS = 4


@dataclass(frozen=True, slots=True)
class Outbreak:
    """The outbreaks of a disease on a day, which spread from one plant each.

    Parameters
    ----------
    together : float
        Sum of squares by sum of their sick plants. The variance of the number of sick plants of a farm, where
        outbreaks begin anywhere and do not meet, is so many times its mean.
    illness : float
        How far the value of a sick plant lies below 1 on average.
    """

    together: float
    illness: float


@lru_cache(maxsize=64)
def outbreak_of(parameters: EpidemicParameters, shape: tuple[int, int], day: int) -> Outbreak:
    """Simulate outbreaks of a disease on a farm of this shape (cells), on land full of its hosts.

    Examples
    --------
    >>> from sensors.dynamics.epidemic import TYLCV
    >>> small, large = (outbreak_of(TYLCV, (side, side), 6) for side in (30, 1000))
    >>> 10 < small.together < 30 < 50 < large.together < 90, 0.5 < large.illness < small.illness < 0.6
    (True, True)
    """
    table = 1.0 - np.asarray(value_table(parameters, day), np.float64)
    counts, illness = np.zeros(_OUTBREAKS), 0.0
    last_day = max(day, min(_SHARED_DAYS * math.ceil(day / _SHARED_DAYS), MAX_DAYS))
    for number, onset in enumerate(_onsets(parameters, shape, last_day)):
        # Who falls ill later is healthy by the table of the day.
        ill = table[onset.view(np.uint8)]
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
    """Simulate outbreaks up to a day, each from one plant; return the day on which each plant fell ill."""
    size = parameters.kernel_size
    if size is None:
        size = parameters.infection_rule(shape).kernel.size
    one = replace(parameters, seeds=1, kernel_size=size)
    side = min(max(shape), _SIDE_CELLS)
    land = np.ones((side, side), np.bool_)
    return tuple(
        simulate_outbreak(land, one, last_day, stream(0, "report", str(number)))
        for number in range(_OUTBREAKS)
    )
