"""A landing that is broken off: how high it climbs, and where the mission goes on.

The rules are ArduPlane's: ``Plane::do_land`` for the height and the pitch,
``AP_Landing::restart_landing_sequence`` for what follows.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.execution.items import POSITION_COMMANDS, number
from sim_vehicle.motion.legs import KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mission.model import MissionItem
    from sim_vehicle.motion.legs import Position

__all__ = ["climb_leg", "landing_start", "restart"]

# Where no take-off was flown.
_HEIGHT_M = 30.0
_PITCH_DEG = 10.0


def climb_leg(
    items: Sequence[MissionItem], seq: int, here: Position, speed: float, height_m: float | None
) -> Leg:
    """Return the climb straight ahead from a landing.

    Parameters
    ----------
    items : sequence of MissionItem
    seq : int
        The landing, whose first parameter is the height to climb to; without one it is that of the take-off.
    here : tuple of 3 floats
    speed : float
        Airspeed.
    height_m : float or None
        The height that is asked for.
    """
    takeoffs = [item for item in items[:seq] if item.command == Command.NAV_TAKEOFF]
    top = height_m or 0.0
    if top <= 0.0:
        top = number(items[seq].param1)
    if top <= 0.0:
        top = takeoffs[-1].z if takeoffs and takeoffs[-1].z > 0.0 else _HEIGHT_M
    pitch = number(takeoffs[-1].param1) if takeoffs else 0.0
    return Leg(
        (here[0], here[1], top),
        speed,
        heading=KEEP,
        kind=LegKind.TAKEOFF,
        pitch_rad=math.radians(pitch if pitch > 0.0 else _PITCH_DEG),
    )


def landing_start(items: Sequence[MissionItem], positions: Sequence[Position], here: Position) -> int | None:
    """Return the nearest item where a landing starts, None without one.

    One without a position of its own is where the next item is that has one.
    """
    starts = [seq for seq, item in enumerate(items) if item.command == Command.DO_LAND_START]
    if len(starts) < 2:
        return starts[0] if starts else None

    def distance(seq: int) -> float:
        places = (place for place in positions[seq:] if not math.isnan(place[0]))
        x, y, _ = next(places, (math.inf, math.inf, 0.0))
        return math.hypot(x - here[0], y - here[1])

    return min(starts, key=distance)


def restart(
    items: Sequence[MissionItem], positions: Sequence[Position], seq: int, here: Position
) -> int | None:
    """Return the item at which a landing is begun anew: where it starts, or at the position before it."""
    start = landing_start(items, positions, here)
    if start is not None:
        return start
    before = (
        index
        for index in range(seq - 1, -1, -1)
        if items[index].command in POSITION_COMMANDS and not math.isnan(positions[index][0])
    )
    return next(before, None)
