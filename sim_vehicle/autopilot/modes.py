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

    @property
    def is_pilot(self) -> bool:
        """Whether a pilot's sticks would fly; without sticks the vehicle keeps its place."""
        return self in (Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION)

    @property
    def is_automatic(self) -> bool:
        """Whether the vehicle follows a plan of its own (not a pilot, not single orders)."""
        return self in (Mode.TAKEOFF, Mode.MISSION, Mode.RTL, Mode.LAND)
