"""Measures of a mission flight: durations of the phases and accuracy in the corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from recordings import Flight

from geo.frame import LocalFrame
from mission.model import Command, MissionItem


@dataclass(frozen=True, slots=True)
class Phases:
    """Durations of the phases of a flight (s); NaN for a missing phase.

    Parameters
    ----------
    takeoff : float
        From the start of the mission until a metre below the height of the take-off item; NaN for a flight
        that began in the air.
    first : float
        From the start to the first waypoint.
    mission : float
        From the first to the last waypoint.
    home : float
        From the last waypoint to the start of the last descent; without a landing, until the vehicle stands
        or circles at home.
    landing : float
        From the start of the last descent until the vehicle disarms.
    """

    takeoff: float
    first: float
    mission: float
    home: float
    landing: float


@dataclass(frozen=True, slots=True)
class Turns:
    """Medians of a flight's measures over corners of more than 30 degrees.

    Parameters
    ----------
    miss_m : float
        Smallest distance to the corner's waypoint.
    overshoot_m, worst_overshoot_m : float
        Distance beyond the line of the next leg: median, and maximum over all corners.
    radius_m : float
        Turn radius, weighted by the turned angle: half of the angle is turned with a smaller radius. Only
        samples above a quarter of the corner's greatest turn rate count.
    rate_deg_s : float
        Greatest turn rate at a corner.
    """

    miss_m: float
    overshoot_m: float
    worst_overshoot_m: float
    radius_m: float
    rate_deg_s: float


_WAYPOINTS = frozenset({16, 82})
_GROUND_M = 2.0
_NEAR_M = 1.0
# Height loss that is not yet the descent (m): an estimated height drifts by more than a metre.
_LEVEL_M = 2.0
_REST_M_S = 0.1
_SMOOTH_S = 0.5
_CORNER = np.radians(30.0)
_SLOW_M_S = 0.3
# Longest gap between samples near a corner (s): with longer gaps the turn cannot be measured.
_GAP_S = 0.5
_TURN_S = 1.5
_TURNING = 0.25


def phases(flight: Flight, items: tuple[MissionItem, ...], start_s: float, *, flies: bool) -> Phases:
    """Return the durations of the phases of a flight.

    Parameters
    ----------
    flight : Flight
    items : tuple of MissionItem
    start_s : float
        Start of the mission on the flight's clock (s).
    flies : bool
        Whether the vehicle flies; heights of ground vehicles are ignored.
    """
    first, last = flight.window(items)
    height = flight.position_m[:, 2]
    takeoff = float("nan")
    wanted = [item.z for item in items if item.command == Command.NAV_TAKEOFF]
    if flies and wanted and height[np.searchsorted(flight.time_s, start_s)] < _GROUND_M:
        there = (height >= wanted[0] - _NEAR_M) & (flight.time_s > start_s)
        takeoff = float(flight.time_s[there][0]) - start_s if there.any() else takeoff
    after = flight.time_s >= last
    time_s = flight.time_s[after]
    if flies and not np.isnan(flight.end_s):
        high = height[after]
        sinks = float(time_s[np.flatnonzero(high >= high.max() - _LEVEL_M)[-1]])
        return Phases(takeoff, first - start_s, last - first, sinks - last, flight.end_s - sinks)
    distance = np.hypot(*flight.position_m[after, :2].T)
    if flies:
        # A circling vehicle has arrived once its distance is within 1.1 of the median circle radius.
        arrived = distance <= 1.1 * float(np.median(distance[len(distance) // 2 :]))
    else:
        speed = np.hypot(*flight.velocity_m_s[after, :2].T)
        arrived = (speed < _REST_M_S) & (distance < distance.min() + _NEAR_M)
    home = float(time_s[arrived][0]) - last if arrived.any() else float("nan")
    return Phases(takeoff, first - start_s, last - first, home, float("nan"))


def turns(flights: Sequence[Flight], items: tuple[MissionItem, ...], frame: LocalFrame) -> list[Turns]:
    """Return the corner measures of flights, over corners without gaps in any of the flights."""
    seen = [_corners(flight, items, frame) for flight in flights]
    common = set.intersection(*(set(corners) for corners in seen))
    if not common:
        return [Turns(*[float("nan")] * 5) for _ in flights]
    found = []
    for corners in seen:
        table = np.array([corners[i] for i in sorted(common)])
        miss, overshoot, radius, turn_rate = np.median(table, axis=0).tolist()
        found.append(Turns(miss, overshoot, float(table[:, 1].max()), radius, turn_rate))
    return found


def _corners(
    flight: Flight, items: tuple[MissionItem, ...], frame: LocalFrame
) -> dict[int, tuple[float, float, float, float]]:
    """Return the four measures of each corner, from the middle of one leg to the middle of the next.

    The passing time of a corner is the time of the smallest distance, because the report of a reached
    waypoint may be late after a gap.
    """
    seqs = [seq for seq, item in enumerate(items) if item.command in _WAYPOINTS]
    places = np.array([frame.from_wgs84(items[seq].x, items[seq].y) for seq in seqs])
    reached_s = np.array([min((t for t, s in flight.reached if seq <= s), default=np.nan) for seq in seqs])
    rate, speed = _turning(flight)
    found = {}
    for i, (before, after) in enumerate(pairwise(np.diff(places, axis=0)), start=1):
        if abs(np.arctan2(before[0] * after[1] - before[1] * after[0], before @ after)) < _CORNER:
            continue
        begin, end = 0.5 * (reached_s[i - 1] + reached_s[i]), 0.5 * (reached_s[i] + reached_s[i + 1])
        here = (flight.time_s >= begin) & (flight.time_s <= end)
        apart = np.hypot(*(flight.position_m[:, :2] - places[i]).T)
        if not here.any() or not _is_seen(flight, flight.time_s[here][apart[here].argmin()]):
            continue
        onward = np.hypot(*(flight.position_m[:, :2] - places[i + 1]).T)
        leg = np.flatnonzero((flight.time_s >= begin) & (flight.time_s <= reached_s[i + 1]))
        leg = leg[: onward[leg].argmin() + 1]
        across = np.array([after[1], -after[0]]) / np.hypot(*after)
        across *= np.sign(before @ across)
        beyond = (flight.position_m[leg, :2] - places[i]) @ across
        radius = _radius(flight.time_s[here], speed[here], rate[here])
        overshoot = max(float(beyond.max(initial=0.0)), 0.0)
        found[i] = (float(apart[here].min()), overshoot, radius, float(np.degrees(rate[here].max())))
    return found


def _radius(
    time_s: NDArray[np.float64], speed_m_s: NDArray[np.float64], rate_rad_s: NDArray[np.float64]
) -> float:
    """Return the median radius of a turn, weighted by the turned angle."""
    turning = rate_rad_s > _TURNING * rate_rad_s.max()
    angle = (rate_rad_s * np.gradient(time_s))[turning]
    radius = speed_m_s[turning] / rate_rad_s[turning]
    order = np.argsort(radius)
    turned = np.cumsum(angle[order])
    return float(radius[order][np.searchsorted(turned, 0.5 * turned[-1])])


def _is_seen(flight: Flight, when_s: float) -> bool:
    """Return whether the samples around a time are dense enough to measure a turn."""
    first, last = np.searchsorted(flight.time_s, (when_s - _TURN_S, when_s + _TURN_S))
    return bool(last > first and np.diff(flight.time_s[first : last + 1]).max(initial=0.0) <= _GAP_S)


def _turning(flight: Flight) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the absolute turn rate of the course (rad/s) and the ground speed (m/s)."""
    east, north, _ = flight.velocity_m_s.T
    speed = np.hypot(east, north)
    course = np.unwrap(np.arctan2(east, north))
    ahead = np.interp(flight.time_s + 0.5 * _SMOOTH_S, flight.time_s, course)
    behind = np.interp(flight.time_s - 0.5 * _SMOOTH_S, flight.time_s, course)
    # At low speed the course is noise.
    return np.where(speed > _SLOW_M_S, np.abs(ahead - behind) / _SMOOTH_S, 0.0), speed
