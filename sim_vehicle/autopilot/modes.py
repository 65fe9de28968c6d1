"""Flight modes, independent of the numbers that autopilots give them."""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """Flight modes; each autopilot has its own custom mode numbers for them."""

    MANUAL = "manual"
    ALTITUDE = "altitude"
    POSITION = "position"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    MISSION = "mission"
    RTL = "return"
    LAND = "land"
    GUIDED = "guided"
    ATTITUDE = "attitude"
    CIRCLE = "circle"
    FLIP = "flip"
