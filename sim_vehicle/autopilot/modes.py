"""What a vehicle can be told to do, whatever number an autopilot gives it."""

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
