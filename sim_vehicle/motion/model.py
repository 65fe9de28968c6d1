"""Base class of motion models, which fly routes in fixed time steps until an event."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from sim_vehicle.motion.legs import KEEP

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sim_vehicle.airframe.estimate_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route


class MotionEvent(IntEnum):
    """Reason why a motion model returned; kernels return the same values."""

    RAN = 0
    REACHED = 1
    STALLED = 3
    ENERGY = 4
    NEAR = 5


class MotionState(NamedTuple):
    """Motion of a vehicle at one time."""

    # East, north, up relative to the start.
    position_m: Position
    velocity_m_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    # Compass heading and heading rate, clockwise.
    heading_rad: float
    yaw_rate_rad_s: float
    # Totals since the start.
    energy_j: float
    path_length_m: float
    power_w: float
    """Present electric power."""
    wind_m_s: tuple[float, float]
    """Velocity of the air to the east and north."""


def attitude_of(east: float, north: float, up: float, heading_rad: float) -> tuple[float, float]:
    """Return the roll and pitch of a vehicle whose thrust points in the given direction."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    pitch = -math.atan2(east * sine + north * cosine, up)
    return math.atan2((east * cosine - north * sine) * math.cos(pitch), up), pitch


class MotionModel(ABC):
    """Motion of one vehicle, such as `Multirotor` or `IdealRobot`.

    By default, methods that only some models need do nothing.
    """

    spec: VehicleSpec
    step_s: float
    arrivals: NDArray[np.int64]
    track: NDArray[np.float64]
    track_every: int

    @property
    @abstractmethod
    def track_points(self) -> int:
        """Number of track points written."""

    @property
    def time_s(self) -> float:
        """Time since the start."""
        return self.step * self.step_s

    @property
    @abstractmethod
    def step(self) -> int:
        """Number of steps since the start."""

    @property
    @abstractmethod
    def leg(self) -> int:
        """Index of the present leg."""

    @property
    @abstractmethod
    def position_m(self) -> Position:
        """East, north, up relative to the start."""

    @property
    @abstractmethod
    def energy_j(self) -> float:
        """Energy used since the start."""

    @property
    def estimate_error(self) -> tuple[float, float, float, float]:
        """Errors of the autopilot's estimate (estimate minus truth); all are 0 without `EstimateErrors`.

        The numbers are the errors of the height (m) and of the velocity to the east, north and up (m/s).
        """
        return 0.0, 0.0, 0.0, 0.0

    def estimate_with(self, errors: EstimateErrors) -> None:
        """Add errors to the autopilot's estimate, if this model supports them."""
        return

    @abstractmethod
    def snapshot(self) -> MotionState:
        """Return the present state of the motion."""

    def attitude(self) -> tuple[float, float, float, float] | None:
        """Return roll, pitch, airspeed and throttle, or None if the acceleration determines them."""
        return None

    @abstractmethod
    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Place the vehicle in steady flight at time 0, with no energy used and no path flown."""

    @abstractmethod
    def fly(self, route: Route) -> None:
        """Begin a route."""

    def interrupt(self) -> None:
        """Abort the present leg as the autopilot would; the next route does not continue this leg."""
        return

    @abstractmethod
    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Keep a velocity (east, north, up), or its horizontal part at an altitude.

        A descent slows to the landing speed near the ground, and ends with REACHED at touch-down. With the
        heading `ALONG`, the nose points in the direction of flight.

        Raises
        ------
        VehicleError
            If the vehicle has no velocity control.
        """

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) on all legs, if the vehicle can; None ends this."""
        return

    def point(self, heading_rad: float) -> None:
        """Turn the nose to a compass heading on the present leg, if the vehicle can."""
        return

    @abstractmethod
    def stopping_point(self) -> Position:
        """Return the position at which the vehicle stops if it brakes now."""

    @abstractmethod
    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly for `max_steps` steps, or until an event occurs."""

    @abstractmethod
    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps."""

    @abstractmethod
    def update_spec(self, spec: VehicleSpec) -> None:
        """Replace the vehicle's defaults and limits."""

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Limit the climb and descent speeds from the next route on; None selects the vehicle's limit."""
        return

    def use_energy(self, joules: float) -> None:
        """Take energy from the battery."""
        return

    def lose_power(self) -> None:
        """Fly on without the motor, if the vehicle can."""
        return

    @abstractmethod
    def touch_down(self) -> None:
        """Stand still on the ground."""

    def ignore_energy(self) -> None:
        """Let the vehicle fly on with an empty battery."""
        return
