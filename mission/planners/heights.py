"""Terrain following: additional waypoints that keep a height above uneven ground."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.planners.path import Points

TOLERANCE_M = 1.0
"""Greatest difference between the wanted and the actual height above ground (m)."""
_AT_SAMPLES = 0.7  # Fraction of the tolerance used at samples; the rest is for the ground between samples
_MOST_SAMPLES = 2_000_000  # Limits memory and time


@dataclass(frozen=True, slots=True, eq=False)
class HeightProfile:
    """Terrain following at a height above the ground.

    Parameters
    ----------
    ground : callable
        Maps positions, float64[n, 2] in metres of the farm frame, to ground elevations in metres.
    height_m : float
        Wanted height above the ground.
    step_m : float
        Greatest distance between samples of the ground.
    climb, descent : float
        Steepest slopes of the vehicle, metres up or down per metre over ground, above zero. Over steeper
        ground the flight starts its climb earlier, and is higher than wanted, never lower.
    home_m : tuple of float
        Home position. Altitudes are relative to the ground at home.
    """

    ground: Callable[[Points], NDArray[np.float64]]
    height_m: float
    step_m: float
    climb: float
    descent: float
    home_m: tuple[float, float]

    def follow(self, path_m: Points) -> tuple[Points, NDArray[np.float64], NDArray[np.int64]]:
        """Return the waypoints of a path: points, altitudes above home, owners.

        The owner of a waypoint is the index of the path point at the end of its leg. The waypoints include
        all points of the path. Altitudes are linear between waypoints.
        """
        places, leg, at = _sampled(path_m, self.step_m)
        home = float(self.ground(np.array([self.home_m]))[0])
        wanted = self.ground(places) + self.height_m - home
        smooth = _slopes_limited(wanted, at, self.climb, self.descent)
        # The last sample of each leg is a point of the path.
        fixed = np.append(np.flatnonzero(np.diff(leg)), len(leg) - 1)
        kept = np.zeros(len(places), dtype=bool)
        kept[0] = True
        kept[fixed] = True
        begin = 0
        for end in fixed.tolist():
            _keep_within(at, smooth, begin, end, _AT_SAMPLES * TOLERANCE_M, kept)
            begin = end
        return places[kept], smooth[kept], leg[kept]


def _sampled(path_m: Points, step_m: float) -> tuple[Points, NDArray[np.int64], NDArray[np.float64]]:
    """Return samples along a path, the index of the path point after each, and their distances flown."""
    lengths = np.hypot(*np.diff(path_m, axis=0).T)
    counts = np.maximum(np.ceil(lengths / step_m), 1).astype(np.int64)
    if counts.sum() > _MOST_SAMPLES:
        msg = (
            f"terrain: the path of {lengths.sum() / 1000.0:.0f} km is too long for a ground that is looked at"
            f" each {step_m:.2g} m; take a coarser raster"
        )
        raise PlanningError(msg)
    leg = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(leg)) - np.repeat(np.cumsum(counts) - counts, counts) + 1) / counts[leg]
    places = path_m[leg] + share[:, None] * (path_m[leg + 1] - path_m[leg])
    before = np.concatenate(([0.0], np.cumsum(lengths)))
    at = before[leg] + share * lengths[leg]
    return (
        np.vstack((path_m[:1], places)),
        np.concatenate(([0], leg + 1)),
        np.concatenate(([0.0], at)),
    )


def _slopes_limited(
    wanted: NDArray[np.float64], at: NDArray[np.float64], climb: float, descent: float
) -> NDArray[np.float64]:
    """Return the lowest altitudes that keep the slopes and are nowhere below `wanted`."""
    if not (climb > 0.0 and descent > 0.0):
        msg = f"terrain: slopes of {climb:g} up and {descent:g} down must be above zero"
        raise PlanningError(msg)
    # A climb must start before the rise, a descent may only end after the fall.
    rise = np.maximum.accumulate((wanted - climb * at)[::-1])[::-1] + climb * at
    fall = np.maximum.accumulate(wanted + descent * at) - descent * at
    limited: NDArray[np.float64] = np.maximum(rise, fall)
    return limited


def _keep_within(
    at: NDArray[np.float64],
    altitudes: NDArray[np.float64],
    begin: int,
    end: int,
    tolerance_m: float,
    kept: NDArray[np.bool_],
) -> None:
    """Mark in `kept` the samples that keep straight lines within the tolerance (Douglas and Peucker 1973)."""
    open_ = [(begin, end)]
    while open_:
        first, last = open_.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = (at[inner] - at[first]) / max(at[last] - at[first], 1e-9)
        off = np.abs(altitudes[first] + share * (altitudes[last] - altitudes[first]) - altitudes[inner])
        worst = int(np.argmax(off))
        if off[worst] > tolerance_m:
            middle = first + 1 + worst
            kept[middle] = True
            open_ += [(first, middle), (middle, last)]


def slope(rate_m_s: float, speed_m_s: float) -> float:
    """Return the slope (m per m) of a climb or descent from its rate and the ground speed.

    >>> slope(2.0, 8.0)
    0.25
    """
    return rate_m_s / speed_m_s if math.isfinite(rate_m_s) and speed_m_s > 0.0 else math.inf
