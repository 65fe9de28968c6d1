"""Observable state of a flight: vehicle state, flight phases, and mission events."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.energy.battery import BatteryState

EPOCH_UNIX_S = 1_780_315_200.0
"""Unix time at simulated time 0, 2026-06-01T12:00:00Z; it is constant, so that equal runs have equal logs."""


class LandedState(IntEnum):
    """Ground contact, with the values of MAV_LANDED_STATE."""

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
    STEERED = "flying at a commanded velocity"
    DEPLETED = "coming down without power"
    FALLING = "falling"

    @property
    def is_lost(self) -> bool:
        """Whether the vehicle no longer obeys orders."""
        return self is FlightPhase.DEPLETED or self is FlightPhase.FALLING


class VehicleState(NamedTuple):
    """State of the vehicle at one time."""

    time_s: float
    """Time since the start of the simulation."""
    # East, north, up relative to the start; the ground at the start is at 0.
    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    # Attitude at which the thrust causes the acceleration and balances the drag; right and up are positive.
    roll_rad: float
    pitch_rad: float
    # Compass heading (clockwise from north, 0 to 2 pi) and the heading rate.
    yaw_rad: float
    yaw_rate_rad_s: float
    airspeed_m_s: float
    """Horizontal speed through the air."""
    wind_m_s: tuple[float, float]
    """Present velocity of the air to the east and north."""
    power_w: float
    """Present electric power."""
    battery: BatteryState | None
    """Battery state; None for an unlimited battery."""
    path_length_m: float
    """Path length since the start."""
    armed: bool
    """Whether the motors run."""
    landed: LandedState
    """Ground contact."""
    phase: FlightPhase
    """Flight phase."""
    current_seq: int
    """Index of the current mission item; -1 without a mission."""
    throttle: float = 0.5
    """Throttle from 0 to 1; 0.5 if the motion model has no throttle."""


@dataclass(frozen=True, slots=True)
class FlightEvent:
    """Event of a flight, with its time."""

    time_s: float


@dataclass(frozen=True, slots=True)
class ItemEvent(FlightEvent):
    """Event of a mission item."""

    seq: int


class ItemReached(ItemEvent):
    """A mission item is complete; for a waypoint, this means that the vehicle has reached it."""


class CurrentChanged(ItemEvent):
    """The current mission item changed."""


class LandingRestarted(ItemEvent):
    """An aborted landing restarts at this item."""


@dataclass(frozen=True, slots=True)
class CameraCommand(ItemEvent):
    """A mission item commands the camera, its gimbal or an output (see `sim_vehicle.execution.items`)."""

    item: MissionItem


@dataclass(frozen=True, slots=True)
class CannotFly(ItemEvent):
    """The vehicle cannot continue and holds; ``seq`` is -1 outside a mission."""

    reason: str


@dataclass(frozen=True, slots=True)
class HomeMoved(FlightEvent):
    """The mission moved home to this position, relative to the start of the vehicle."""

    x_m: float
    y_m: float


class MissionComplete(FlightEvent):
    """The last mission item is complete."""


class TargetReached(FlightEvent):
    """The vehicle reached the target of a take-off or go-to order."""


class BatteryDepleted(FlightEvent):
    """The battery is empty; a vehicle in the air descends at its position."""


class Landed(FlightEvent):
    """The vehicle touched down."""


class Disarmed(FlightEvent):
    """The motors stopped automatically on the ground."""
