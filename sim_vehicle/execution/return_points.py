"""Where a vehicle may return to: home and the rally points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_vehicle.motion.legs import Position


@dataclass(slots=True)
class ReturnPoints:
    """Home and the rally points."""

    home_m: tuple[float, float] = (0.0, 0.0)
    """East and north of the start."""
    rally_m: tuple[Position, ...] = ()
    """East, north, and the least height of the path there."""

    def nearest(self, position_m: Position) -> Position:
        """The point nearest to a position: east, north, and the least height of the path there.

        Examples
        --------
        >>> points = ReturnPoints(rally_m=((100.0, 0.0, 30.0),))
        >>> points.nearest((20.0, 0.0, 5.0)), points.nearest((80.0, 0.0, 5.0))
        ((0.0, 0.0, 0.0), (100.0, 0.0, 30.0))
        """
        x, y, _ = position_m
        points = ((*self.home_m, 0.0), *self.rally_m)
        return min(points, key=lambda point: math.hypot(point[0] - x, point[1] - y))
