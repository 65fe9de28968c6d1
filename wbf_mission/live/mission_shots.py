"""What a mission orders of a camera, and when a camera carries that out by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.model import Command, Mission

__all__ = ["MissionShots", "Shots", "shots_before"]

_PATIENCE_S = 2.0
_SAME = 1e-5  # parameters cross the link as 32-bit floats


@dataclass(frozen=True, slots=True)
class Shots:
    """What a camera does by itself, by distance or by time between images; neither is nothing."""

    distance_m: float = 0.0
    interval_ms: float = 0.0

    @property
    def is_off(self) -> bool:
        """Whether no images are taken."""
        return self.distance_m <= 0.0 and self.interval_ms <= 0.0

    def is_same(self, other: Shots) -> bool:
        """Whether a camera that does the other does this."""
        return math.isclose(self.distance_m, other.distance_m, rel_tol=_SAME) and math.isclose(
            self.interval_ms, other.interval_ms, rel_tol=_SAME
        )


def shots_before(mission: Mission, item: int) -> Shots | None:
    """Return what a mission has ordered of the camera while an item is flown; None while nothing was.

    Examples
    --------
    >>> from mission.model import MissionItem
    >>> orders = [MissionItem(Command.DO_SET_CAM_TRIGG_DIST, param1=metres) for metres in (5.0, 0.0)]
    >>> leg = MissionItem(Command.NAV_WAYPOINT, x=27.0, y=-82.0, z=10.0)
    >>> mission = Mission((leg, orders[0], leg, orders[1], leg))
    >>> [None if (one := shots_before(mission, item)) is None else one.distance_m for item in range(5)]
    [None, None, 5.0, 5.0, 0.0]
    """
    for one in reversed(mission.items[: max(item, 0)]):
        value = max(one.param1 or 0.0, 0.0)
        if one.command == Command.DO_SET_CAM_TRIGG_DIST:
            return Shots(distance_m=value)
        if one.command == Command.DO_SET_CAM_TRIGG_INTERVAL:
            return Shots(interval_ms=value)
    return None


class MissionShots:
    """Compares what a camera does with what the mission orders, whoever is to tell the camera so.

    A vehicle that commands the camera is given a moment, because its command may be on its way; one that
    does not command it is not waited for. So a command that is lost, late, or overtaken by an older one
    does not decide for longer than that. What a ground station ordered holds until the mission orders
    something else. A vehicle that orders image by image needs nothing of this.
    """

    def __init__(self) -> None:
        self.commanded = self.single = False
        self._ordered: Shots | None = None
        self._overruled: Shots | None = None
        self._differs_s = math.inf

    def restart(self) -> None:
        """After a restart of the vehicle nobody has told the camera anything."""
        self.commanded = self.single = False
        self._overruled, self._differs_s = None, math.inf

    def overrule(self) -> None:
        """A ground station has told the camera something."""
        self._overruled = self._ordered

    def due(self, ordered: Shots | None, does: Shots, now_s: float, *, may_stop: bool) -> bool:
        """Return whether the camera has to do now what the mission orders.

        Parameters
        ----------
        may_stop : bool
            False while the mission is being changed: an item of the one, read in the other, must not end
            the images.
        """
        self._ordered = ordered
        if ordered != self._overruled:
            self._overruled = None
        settled = ordered is None or self._overruled is not None or ordered.is_same(does)
        if ordered is None or settled or self.single or (ordered.is_off and not may_stop):
            self._differs_s = math.inf
            return False
        self._differs_s = min(self._differs_s, now_s)
        if self.commanded and now_s < self._differs_s + _PATIENCE_S:
            return False
        self._differs_s = math.inf
        return True
