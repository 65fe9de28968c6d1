"""The observable side of a flight: the vehicle's state, its phases, and the events of a mission."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.energy.battery import BatteryState


class LandedState(IntEnum):
    """As MAV_LANDED_STATE numbers them."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class FlightPhase(Enum):
    """Phase of a flight."""

    GROUND = "on the ground"
    TAKEOFF = "taking off"
    MISSION = "flying the mission"
    HOLD = "holding"
    GOTO = "flying to a position"
    RETURN = "returning home"
    LAND = "landing"
    STEERED = "flying as it is told"
    DEPLETED = "coming down without power"
    FALLING = "falling"

    @property
    def is_lost(self) -> bool:
        """Whether the vehicle can obey no more."""
        return self is FlightPhase.DEPLETED or self is FlightPhase.FALLING


class VehicleState(NamedTuple):
    """The state of the vehicle at one time."""

    time_s: float
    """Since the start of the simulation."""
    # East, north, up about home (the ground at home is 0).
    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    # Attitude that gives the acceleration and holds against the drag of the air; roll right and pitch up
    # positive.
    roll_rad: float
    pitch_rad: float
    # Compass heading (clockwise from north, 0 to 2 pi) and its rate.
    yaw_rad: float
    yaw_rate_rad_s: float
    airspeed_m_s: float
    """Horizontal speed through the air."""
    wind_m_s: tuple[float, float]
    """Wind now, east and north, the direction that it moves to."""
    power_w: float
    """Electric power now."""
    battery: BatteryState | None
    """None for an endless battery."""
    path_length_m: float
    """Length of the path since the start."""
    armed: bool
    """Whether the motors run."""
    landed: LandedState
    """Ground contact."""
    phase: FlightPhase
    """Present phase."""
    current_seq: int
    """The mission item that is being flown, -1 without a mission."""
    throttle: float = 0.5
    """0 to 1; a half where the motion has none."""


@dataclass(frozen=True, slots=True)
class FlightEvent:
    """Something that happens in a flight, at a time."""

    time_s: float


@dataclass(frozen=True, slots=True)
class ItemEvent(FlightEvent):
    """Something that happens to a mission item."""

    seq: int


class ItemReached(ItemEvent):
    """A mission item was completed or, for a waypoint, reached."""


class CurrentChanged(ItemEvent):
    """Another mission item is the current one."""


class LandingRestarted(ItemEvent):
    """A landing that was broken off begins anew, at this item."""


@dataclass(frozen=True, slots=True)
class CameraCommand(ItemEvent):
    """The mission commands the camera or its gimbal (`sim_vehicle.execution.items`)."""

    item: MissionItem


@dataclass(frozen=True, slots=True)
class CannotFly(ItemEvent):
    """The vehicle gave up; it holds. ``seq`` is -1 outside a mission."""

    reason: str


@dataclass(frozen=True, slots=True)
class HomeMoved(FlightEvent):
    """The mission moved home: east and north of where the vehicle started."""

    x_m: float
    y_m: float


class MissionComplete(FlightEvent):
    """The last mission item was completed."""


class TargetReached(FlightEvent):
    """A direct target (take-off, go to, return height) was reached."""


class BatteryDepleted(FlightEvent):
    """The battery is empty: the vehicle comes down where it is."""


class Landed(FlightEvent):
    """The vehicle touched the ground."""


class Disarmed(FlightEvent):
    """The motors stopped by themselves after landing."""
