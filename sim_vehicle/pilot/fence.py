"""Geofence: zones, distance of a position to the edge, and breaches.

Repeated checks are cheap: a vehicle that is 100 m from the edge cannot cross it within the next 100 m of its
path, so the watch computes nothing for this distance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from mission.model import Command, MissionItem

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from geo.frame import LocalFrame

_INCLUSIONS = frozenset(
    {int(Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION), int(Command.NAV_FENCE_CIRCLE_INCLUSION)}
)
_POLYGONS = frozenset(
    {int(Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION), int(Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)}
)
_CIRCLES = frozenset({int(Command.NAV_FENCE_CIRCLE_INCLUSION), int(Command.NAV_FENCE_CIRCLE_EXCLUSION)})


class Breach(IntEnum):
    """Limit that a vehicle has breached, with the values of FENCE_BREACH."""

    NONE = 0
    MAX_ALTITUDE = 2
    BOUNDARY = 3


@dataclass(frozen=True, slots=True, eq=False)
class _Zone:
    """Zone of a fence: a circle if it has a radius, else a polygon; vehicles stay inside an ``inclusion``."""

    points_m: NDArray[np.float64]
    radius_m: float
    inclusion: bool

    def depth_m(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of each position from the edge of the zone; it is negative outside the zone."""
        if self.radius_m > 0.0:
            away: NDArray[np.float64] = np.hypot(x - self.points_m[0, 0], y - self.points_m[0, 1])
            return self.radius_m - away
        ax, ay = self.points_m[:, 0, None], self.points_m[:, 1, None]
        dx, dy = np.roll(ax, -1, axis=0) - ax, np.roll(ay, -1, axis=0) - ay
        px, py = x - ax, y - ay
        squared = np.maximum(dx * dx + dy * dy, 1e-12)
        part = np.clip((px * dx + py * dy) / squared, 0.0, 1.0)
        away = np.sqrt(((px - part * dx) ** 2 + (py - part * dy) ** 2).min(axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses = ((ay > y) != (np.roll(ay, -1, axis=0) > y)) & (
                px < np.where(dy != 0.0, dx * py / dy, 0.0)
            )
        inside = crosses.sum(axis=0) % 2 == 1
        return np.where(inside, away, -away)


@dataclass(frozen=True, slots=True, eq=False)
class Fence:
    """Zones of a fence plan."""

    zones: tuple[_Zone, ...] = ()
    """Polygons and circles."""
    return_point_m: tuple[float, float, float] | None = None
    """Return point: east, north, height."""
    any_inclusion: bool = True
    """Whether a position in one inclusion zone is allowed (PX4); otherwise it must be in all (ArduPilot)."""

    @classmethod
    def of(cls, items: Sequence[MissionItem], frame: LocalFrame, *, any_inclusion: bool = True) -> Fence:
        """Return a fence from plan items with the commands 5000 to 5004; incomplete zones are ignored.

        Examples
        --------
        >>> from geo.frame import LocalFrame
        >>> circle = MissionItem(5003, 0, 50.0, x=28.05, y=-82.15)
        >>> fence = Fence.of([circle], LocalFrame(28.05, -82.15))
        >>> fence.margin_m(30.0, 0.0), fence.margin_m(60.0, 0.0)
        (20.0, -10.0)
        """
        zones: list[_Zone] = []
        point: tuple[float, float, float] | None = None
        vertices: list[tuple[float, float]] = []
        for item in items:
            if not item.has_position:
                continue
            x, y = frame.from_wgs84(item.x, item.y)
            first = item.param1 or 0.0
            if item.command == Command.NAV_FENCE_RETURN_POINT:
                point = (x, y, item.z)
            elif item.command in _CIRCLES and first > 0.0:
                zones.append(_Zone(np.array([[x, y]]), first, item.command in _INCLUSIONS))
            elif item.command in _POLYGONS:
                vertices.append((x, y))
                if len(vertices) == int(first) >= 3:
                    zones.append(_Zone(np.array(vertices), 0.0, item.command in _INCLUSIONS))
                if len(vertices) >= int(first):
                    vertices = []
        return cls(tuple(zones), point, any_inclusion)

    def margins_m(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.float64]:
        """Return the distance of each position from the nearest edge; it is negative outside the fence."""
        x, y = np.atleast_1d(np.asarray(x_m, float)), np.atleast_1d(np.asarray(y_m, float))
        margin = np.full(len(x), np.inf)
        inside = [zone.depth_m(x, y) for zone in self.zones if zone.inclusion]
        if inside:
            margin = np.max(inside, axis=0) if self.any_inclusion else np.min(inside, axis=0)
        for zone in self.zones:
            if not zone.inclusion:
                margin = np.minimum(margin, -zone.depth_m(x, y))
        return np.asarray(margin)

    def margin_m(self, x_m: float, y_m: float) -> float:
        """Return the distance of a position from the nearest edge; it is negative outside the fence."""
        return float(self.margins_m(x_m, y_m)[0])


@dataclass(frozen=True, slots=True)
class Bounds:
    """Limits of a fence besides its plan; infinity disables a limit."""

    ceiling_m: float = math.inf
    """Height above home."""
    radius_m: float = math.inf
    """Distance from home."""
    areas: bool = True
    """Whether the zones of the plan are checked."""


@dataclass(slots=True)
class FenceWatch:
    """Watch over a fence, with the breaches of one vehicle."""

    fence: Fence = field(default_factory=Fence)
    bounds: Bounds = field(default_factory=Bounds)
    # Present breach, and its description.
    breach: Breach = Breach.NONE
    reason: str = ""
    # Number of breaches, and time of the last breach.
    count: int = 0
    broken_s: float = 0.0
    _free_until_m: float = -math.inf

    def change(self, fence: Fence | None = None, bounds: Bounds | None = None) -> None:
        """Replace the fence or the bounds."""
        self.fence = fence if fence is not None else self.fence
        self.bounds = bounds if bounds is not None else self.bounds
        self._free_until_m = -math.inf

    def evaluate(
        self, place_m: tuple[float, float, float], home_m: tuple[float, float, float]
    ) -> tuple[Breach, str, float]:
        """Return the breach at a position, a description of it, and the distance from the nearest limit."""
        x, y, z = place_m[0], place_m[1], place_m[2] - home_m[2]
        bounds = self.bounds
        away = math.hypot(x - home_m[0], y - home_m[1])
        edge = self.fence.margin_m(x, y) if bounds.areas and self.fence.zones else math.inf
        free = min(bounds.ceiling_m - z, bounds.radius_m - away, edge)
        if z > bounds.ceiling_m:
            return Breach.MAX_ALTITUDE, f"{z:.1f} m high, {bounds.ceiling_m:g} m are allowed", free
        if away > bounds.radius_m:
            return Breach.BOUNDARY, f"{away:.0f} m from home, {bounds.radius_m:g} m are allowed", free
        if edge < 0.0:
            return Breach.BOUNDARY, f"{-edge:.1f} m outside the area", free
        return Breach.NONE, "", free

    def check(
        self,
        place_m: tuple[float, float, float],
        flown_m: float,
        home_m: tuple[float, float, float],
        now_s: float,
    ) -> bool:
        """Check a vehicle's position and path length; return whether a breach has just begun."""
        if flown_m < self._free_until_m:
            return False
        breach, reason, free = self.evaluate(place_m, home_m)
        fresh = breach is not Breach.NONE and self.breach is Breach.NONE
        self.breach, self.reason = breach, reason
        self._free_until_m = flown_m + free if breach is Breach.NONE else -math.inf
        if fresh:
            self.count += 1
            self.broken_s = now_s
        return fresh
