"""The base of motion models: they fly routes in fixed steps, and return when something happens."""

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
    """Why a motion model returned; the values are those of the kernel."""

    RAN = 0
    REACHED = 1
    STALLED = 3
    ENERGY = 4
    NEAR = 5


class MotionState(NamedTuple):
    """How a vehicle moves at one time."""

    # East, north, up about home.
    position_m: Position
    velocity_m_s: tuple[float, float, float]
    acceleration_m_s2: tuple[float, float, float]
    # Compass heading, and its rate (clockwise).
    heading_rad: float
    yaw_rate_rad_s: float
    # Used and flown since the start.
    energy_j: float
    path_length_m: float
    power_w: float
    """Electric power now."""
    wind_m_s: tuple[float, float]
    """East, north: where the air moves to."""


def attitude_of(east: float, north: float, up: float, heading_rad: float) -> tuple[float, float]:
    """Return roll and pitch of a vehicle whose thrust points there."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    pitch = -math.atan2(east * sine + north * cosine, up)
    return math.atan2((east * cosine - north * sine) * math.cos(pitch), up), pitch


class MotionModel(ABC):
    """A vehicle's motion, such as `Multirotor` or `IdealRobot`.

    Methods that mean nothing to most models have a body here.
    """

    spec: VehicleSpec
    step_s: float
    arrivals: NDArray[np.int64]
    track: NDArray[np.float64]
    track_every: int

    @property
    @abstractmethod
    def track_points(self) -> int:
        """Points of the track that were written."""

    @property
    def time_s(self) -> float:
        """Time since the start."""
        return self.step * self.step_s

    @property
    @abstractmethod
    def step(self) -> int:
        """Steps since the start."""

    @property
    @abstractmethod
    def leg(self) -> int:
        """Index of the leg that is being flown."""

    @property
    @abstractmethod
    def position_m(self) -> Position:
        """East, north, up about home."""

    @property
    @abstractmethod
    def energy_j(self) -> float:
        """Energy used since the start."""

    @property
    def estimate_error(self) -> tuple[float, float, float, float]:
        """Errors of what the autopilot estimates, estimate less truth, all 0 without `EstimateErrors`.

        Height (m), velocity east, north, up (m/s).
        """
        return 0.0, 0.0, 0.0, 0.0

    def estimate_with(self, errors: EstimateErrors) -> None:
        """Fly by an estimate that is wrong, where the autopilot's is known to be."""
        return

    @abstractmethod
    def snapshot(self) -> MotionState:
        """Return the motion state now."""

    def attitude(self) -> tuple[float, float, float, float] | None:
        """Return roll, pitch, airspeed and throttle; None where they follow from the acceleration."""
        return None

    @abstractmethod
    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Be in steady flight at time 0, with nothing used yet, as if it had flown there."""

    @abstractmethod
    def fly(self, route: Route) -> None:
        """Begin a route."""

    def interrupt(self) -> None:
        """Give up the present leg: the next route begins anew, where the autopilot does that."""
        return

    @abstractmethod
    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Keep a velocity (east, north, up), or its horizontal part at a height.

        Sinking, it goes on to the ground and slows down to the landing speed there; the touch is REACHED.
        A heading along the leg is that of the flight.

        Raises
        ------
        VehicleError
            When the vehicle has no velocity control.
        """

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) on any leg, where it can; None ends that."""
        return

    def point(self, heading_rad: float) -> None:
        """Turn the nose to a compass heading on the leg that is flown now, where that is possible."""
        return

    @abstractmethod
    def stopping_point(self) -> Position:
        """Return the position of rest if it brakes now."""

    @abstractmethod
    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly up to a number of steps, less when something happens."""

    @abstractmethod
    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps."""

    @abstractmethod
    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits."""

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Climb and sink no faster than this, from the next route on; None is the vehicle's own limit."""
        return

    def use_energy(self, joules: float) -> None:
        """Take energy out of the battery."""
        return

    def lose_power(self) -> None:
        """Fly on without the motor, where that is possible."""
        return

    @abstractmethod
    def touch_down(self) -> None:
        """Stand still on the ground."""

    def ignore_energy(self) -> None:
        """Go on with an empty battery."""
        return
