"""Times and positions of exposures, computed from position telemetry.

If positions arrive at 10 Hz, the path between two positions is approximated by a chord. At multirotor
accelerations the chord is within 5 mm of the path, and MAVLink rounds positions to 11 mm. At lower rates
(slow radios send positions at 1 to 4 Hz) the path is approximated by the cubic Hermite curve through the
positions and velocities at both ends, in chords of at most 0.1 s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

MAX_GAP_MS = 1500
REBOOT_MS = 5000
MAX_SPEED_M_S = 150.0
STILL_M = 0.1
"""Shortest movement that counts towards the trigger distance.

A hovering vehicle sways by less. The rounding to 11 mm lengthens longer chords by less than 0.1 %.
"""
_CHORD_MS = 150
_STEP_MS = 100
_E7 = 10_000_000
_TURN_E7 = 360 * _E7
_WGS84_A = 6378137.0
_WGS84_E2 = 0.0066943799901413165
_REFRESH_E7 = 10_000


class Fix(NamedTuple):
    """A position report (GLOBAL_POSITION_INT) with the time since boot."""

    time_ms: int
    latitude_e7: int
    longitude_e7: int
    altitude_mm: int
    relative_altitude_mm: int
    north_m_s: float
    east_m_s: float
    heading_cdeg: int


class Exposure(NamedTuple):
    """An exposure at a position rounded to 1e-7 degree, with heading, pitch and roll of the camera."""

    time_us: int
    latitude_e7: int
    longitude_e7: int
    altitude_mm: int
    relative_altitude_mm: int
    heading_cdeg: int
    pitch_cdeg: int = -9000
    roll_cdeg: int = 0


class CameraTrigger:
    """Distance, interval and external triggers along a track of position reports.

    A new distance or interval trigger replaces the active one. Distances are horizontal lengths along the
    path. In a gap of the telemetry (more than 1.5 s, or a jump faster than 150 m/s) there are no exposures,
    because the position is unknown. After the gap, the distance begins again at 0. Late or repeated reports
    are ignored. If the clock jumps back, the autopilot has rebooted, and the trigger stops.
    """

    __slots__ = (
        "_anchor",
        "_due_us",
        "_external",
        "_last",
        "_metres",
        "_since_m",
        "distance_m",
        "interval_us",
        "remaining",
    )

    def __init__(self) -> None:
        self.distance_m = 0.0
        self.interval_us = 0
        self.remaining = 0
        self._since_m = 0.0
        self._due_us: float = 0.0
        self._external: list[int] = []
        self._last: Fix | None = None
        self._anchor: Fix | None = None
        self._metres = (0, 0.0, 0.0)

    @property
    def position(self) -> Fix | None:
        """Last position report; None before the first report."""
        return self._last

    @property
    def active(self) -> bool:
        """Whether a distance or interval trigger is active."""
        return self.distance_m > 0.0 or self.interval_us > 0

    def stop(self) -> None:
        """Stop the distance or interval trigger."""
        self.distance_m, self.interval_us, self.remaining = 0.0, 0, 0

    def every_distance(self, distance_m: float) -> None:
        """Start exposures at every `distance_m` along the path from the last position."""
        self.stop()
        self.distance_m = distance_m
        self._since_m = 0.0
        self._anchor = self._last

    def every_interval(self, interval_us: int, count: int, *, start_us: int) -> None:
        """Start `count` exposures (0 for no limit) at equal intervals, the first at `start_us` since boot."""
        self.stop()
        self.interval_us, self.remaining = interval_us, count
        self._due_us = start_us

    def here(self) -> Exposure | None:
        """Return an exposure at the last reported position; None before the first report."""
        fix = self._last
        return None if fix is None else _exposure(fix, fix, 1.0, fix.latitude_e7, fix.longitude_e7)

    def at(self, time_us: int) -> None:
        """Add an exposure at a time since boot; it is made when the position at this time is known."""
        self._external.append(time_us)
        del self._external[:-64]

    def lost(self) -> None:
        """Discard the track after the loss of the position."""
        self._last = self._anchor = None

    def add(self, fix: Fix) -> list[Exposure]:
        """Process a position report and return the exposures since the last report, in order of time."""
        last = self._last
        if last is None:
            self._last = self._anchor = fix
            self._start_at(fix)
            return []
        step_ms = fix.time_ms - last.time_ms
        if step_ms <= 0:
            if step_ms > -REBOOT_MS:
                return []
            self.stop()
            self._external.clear()
            self._last = self._anchor = fix
            return []
        if step_ms > MAX_GAP_MS or self._jumped(last, fix, step_ms):
            self._last = self._anchor = fix
            self._since_m = 0.0
            self._start_at(fix)
            self._external = [time_us for time_us in self._external if time_us >= fix.time_ms * 1000]
            return []
        exposures: list[Exposure] = []
        if self.distance_m > 0.0:
            self._along(fix, exposures)
        elif self.interval_us > 0:
            self._timed(last, fix, exposures)
        if self._external:
            end_us = fix.time_ms * 1000
            due = sorted(time_us for time_us in self._external if time_us <= end_us)
            self._external = [time_us for time_us in self._external if time_us > end_us]
            exposures += (self._at_time(last, fix, max(time_us, last.time_ms * 1000)) for time_us in due)
            exposures.sort()
        self._last = fix
        return exposures

    def _jumped(self, last: Fix, fix: Fix, step_ms: int) -> bool:
        _, per_north, per_east = self._scale(last.latitude_e7)
        reach_m = MAX_SPEED_M_S * step_ms / 1000.0 + 1.0
        return (
            abs(fix.latitude_e7 - last.latitude_e7) * per_north > reach_m
            or abs(_turn(fix.longitude_e7 - last.longitude_e7)) * per_east > reach_m
        )

    def _start_at(self, fix: Fix) -> None:
        """Skip timed exposures that were due before this position report."""
        if self.interval_us > 0:
            late = fix.time_ms * 1000 - self._due_us
            if late > 0:
                self._due_us += math.ceil(late / self.interval_us) * self.interval_us

    def _scale(self, latitude_e7: int) -> tuple[int, float, float]:
        """Return a cached latitude near this one, and the metres per 1e-7 degree north and east there."""
        if abs(latitude_e7 - self._metres[0]) > _REFRESH_E7 or not self._metres[1]:
            latitude = math.radians(latitude_e7 / _E7)
            w = 1.0 - _WGS84_E2 * math.sin(latitude) ** 2
            unit = math.radians(1.0 / _E7)
            north = unit * _WGS84_A * (1.0 - _WGS84_E2) / w**1.5
            east = unit * _WGS84_A * max(math.cos(latitude), 1e-6) / math.sqrt(w)
            self._metres = (latitude_e7, north, east)
        return self._metres

    def _along(self, fix: Fix, exposures: list[Exposure]) -> None:
        anchor = self._anchor
        assert anchor is not None
        _, per_north, per_east = self._scale(anchor.latitude_e7)
        north = (fix.latitude_e7 - anchor.latitude_e7) * per_north
        east = _turn(fix.longitude_e7 - anchor.longitude_e7) * per_east
        length = math.hypot(north, east)
        if length < STILL_M:
            # Only the time of the anchor advances, so that slow motion adds up, but sway does not.
            if fix.time_ms - anchor.time_ms > _STEP_MS:
                self._anchor = fix._replace(latitude_e7=anchor.latitude_e7, longitude_e7=anchor.longitude_e7)
            return
        step_ms = fix.time_ms - anchor.time_ms
        self._anchor = fix
        distance, since = self.distance_m, self._since_m
        if step_ms <= _CHORD_MS:
            if since + length < distance:
                self._since_m = since + length
                return
            at = distance - since
            north_e7 = fix.latitude_e7 - anchor.latitude_e7
            east_e7 = _turn(fix.longitude_e7 - anchor.longitude_e7)
            while at <= length:
                part = at / length
                latitude_e7 = anchor.latitude_e7 + part * north_e7
                exposures.append(
                    _exposure(anchor, fix, part, latitude_e7, anchor.longitude_e7 + part * east_e7)
                )
                at += distance
            self._since_m = length - (at - distance)
            return
        points = _curve(anchor, fix, north, east, step_ms / 1000.0)
        steps = len(points) - 1
        for k in range(steps):
            (from_north, from_east), (to_north, to_east) = points[k], points[k + 1]
            length = math.hypot(to_north - from_north, to_east - from_east)
            at = distance - since
            while at <= length:
                part = at / length
                place_north = from_north + part * (to_north - from_north)
                place_east = from_east + part * (to_east - from_east)
                latitude_e7 = anchor.latitude_e7 + place_north / per_north
                longitude_e7 = anchor.longitude_e7 + place_east / per_east
                exposures.append(_exposure(anchor, fix, (k + part) / steps, latitude_e7, longitude_e7))
                at += distance
            since = length - (at - distance)
        self._since_m = since

    def _timed(self, last: Fix, fix: Fix, exposures: list[Exposure]) -> None:
        end_us = fix.time_ms * 1000
        while self.interval_us > 0 and self._due_us <= end_us:
            exposures.append(self._at_time(last, fix, self._due_us))
            self._due_us += self.interval_us
            if self.remaining:
                self.remaining -= 1
                if not self.remaining:
                    self.stop()

    def _at_time(self, last: Fix, fix: Fix, time_us: float) -> Exposure:
        step_ms = fix.time_ms - last.time_ms
        part = min(max((time_us / 1000.0 - last.time_ms) / step_ms, 0.0), 1.0)
        _, per_north, per_east = self._scale(last.latitude_e7)
        north_e7 = fix.latitude_e7 - last.latitude_e7
        east_e7 = _turn(fix.longitude_e7 - last.longitude_e7)
        if step_ms > _CHORD_MS:
            points = _curve(last, fix, north_e7 * per_north, east_e7 * per_east, step_ms / 1000.0)
            steps = len(points) - 1
            k = min(int(part * steps), steps - 1)
            rest = part * steps - k
            north = points[k][0] + rest * (points[k + 1][0] - points[k][0])
            east = points[k][1] + rest * (points[k + 1][1] - points[k][1])
            position = (last.latitude_e7 + north / per_north, last.longitude_e7 + east / per_east)
        else:
            position = (last.latitude_e7 + part * north_e7, last.longitude_e7 + part * east_e7)
        return _exposure(last, fix, part, *position)


def _turn(longitude_e7: int) -> int:
    """Return a difference of longitudes, brought into the range of +-180 degrees."""
    if -180 * _E7 <= longitude_e7 <= 180 * _E7:
        return longitude_e7
    return longitude_e7 - _TURN_E7 if longitude_e7 > 0 else longitude_e7 + _TURN_E7


def _exposure(a: Fix, b: Fix, part: float, latitude_e7: float, longitude_e7: float) -> Exposure:
    longitude = round(longitude_e7)
    if not -180 * _E7 <= longitude <= 180 * _E7:
        longitude = _turn(longitude)
    return Exposure(
        round((a.time_ms + part * (b.time_ms - a.time_ms)) * 1000.0),
        round(latitude_e7),
        longitude,
        round(a.altitude_mm + part * (b.altitude_mm - a.altitude_mm)),
        round(a.relative_altitude_mm + part * (b.relative_altitude_mm - a.relative_altitude_mm)),
        b.heading_cdeg,
    )


def _curve(a: Fix, b: Fix, north: float, east: float, step_s: float) -> list[tuple[float, float]]:
    """Return points (north, east; m from `a`) at equal times on the cubic Hermite curve from `a` to `b`.

    If the velocities do not fit the positions (the curve is longer than twice the chord), the points are on
    the chord.
    """
    steps = math.ceil(step_s * 1000.0 / _STEP_MS)
    points = []
    for k in range(steps + 1):
        u = k / steps
        start, leave, arrive = (
            u * u * (3.0 - 2.0 * u),
            u * (1.0 - u) ** 2 * step_s,
            u * u * (u - 1.0) * step_s,
        )
        points.append(
            (
                start * north + leave * a.north_m_s + arrive * b.north_m_s,
                start * east + leave * a.east_m_s + arrive * b.east_m_s,
            )
        )
    length = sum(math.dist(points[k], points[k + 1]) for k in range(steps))
    if length > 2.0 * math.hypot(north, east) + 0.5:
        return [(north * k / steps, east * k / steps) for k in range(steps + 1)]
    return points
