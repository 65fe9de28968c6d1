"""Motion models: their base class, and the paper's ideal robot.

A motion model flies a route in fixed time steps until an event.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.legs import KEEP

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.navigation_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route

# Excess over whole cells (in cells) that costs no time step; links round waypoints to 1e-7 degree (1.1 cm).
_SLACK = 0.04


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

    By default, a method that only some models need does nothing.
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
        """Position relative to the start: east, north, up."""

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
        """Begin a route, at the vehicle's present position."""

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
        """Put the vehicle at rest on the ground, without a route."""

    def ignore_energy(self) -> None:
        """Let the vehicle fly on with an empty battery."""
        return


class IdealRobot(MotionModel):
    """The paper's ideal robot: it moves one cell per time step and climbs at once; it has no battery.

    A robot that is at most one cell away from its waypoint moves exactly to the waypoint; this shorter move
    still takes a whole time step (see docs/vehicle-model.md). Otherwise the robot moves one cell along the
    straight line. A waypoint at the robot's present position takes a time step, too. Height changes instantly
    at the start of a leg, and a purely vertical leg takes no step. Positions are relative to the start (m).

    Parameters
    ----------
    spec : VehicleSpec
        Specification of kind ``ideal``.
    yaw_rad : float
        Heading at the start.
    """

    step = leg = track_points = 0
    energy_j = 0.0

    def __init__(self, spec: VehicleSpec, yaw_rad: float = 0.0) -> None:
        self.spec = spec
        self.step_s = spec.step_s
        self.arrivals: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self.track: NDArray[np.float64] = np.empty((0, 3))
        self.track_every = 0
        self._place = (0.0, 0.0, 0.0)
        self._velocity = (0.0, 0.0)
        self._yaw = yaw_rad % (2.0 * math.pi)
        self._length = 0.0
        self._legs: list[list[float]] = []
        self._begin: tuple[float, float, float, int] = (0.0, 0.0, 0.0, 0)

    @property
    def position_m(self) -> Position:
        """Position relative to the start: east, north, up."""
        return self._place

    def snapshot(self) -> MotionState:
        """Return the present state of the motion."""
        return MotionState(
            position_m=self._place,
            velocity_m_s=(*self._velocity, 0.0),
            acceleration_m_s2=(0.0, 0.0, 0.0),
            heading_rad=self._yaw,
            yaw_rate_rad_s=0.0,
            energy_j=0.0,
            path_length_m=self._length,
            power_w=0.0,
            wind_m_s=(0.0, 0.0),
        )

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Place the robot at a position at time 0, with no path flown."""
        self.step = self.leg = self.track_points = 0
        self._place = position_m
        self._velocity = velocity_m_s[:2]
        self._yaw = heading_rad % (2.0 * math.pi)
        self._length = 0.0
        self._legs = []

    def fly(self, route: Route) -> None:
        """Begin a route, at the robot's present position."""
        self._legs = np.column_stack([route.points_m, route.legs["heading"]]).tolist()
        self.arrivals = np.full(len(self._legs), -1, dtype=np.int64)
        self.leg = 0
        self._enter()

    def _enter(self) -> None:
        x, y, _ = self._place
        tx, ty, _, heading = self._legs[self.leg]
        distance = math.hypot(tx - x, ty - y)
        self._begin = (x, y, distance, self.step)
        if math.isfinite(heading):
            self._yaw = heading % (2.0 * math.pi)
        elif math.isnan(heading) and distance > 0.0:
            self._yaw = math.atan2(tx - x, ty - y) % (2.0 * math.pi)

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Raise VehicleError, because the ideal robot has no velocity control."""
        msg = f"vehicle {self.spec.name}: the ideal robot has no velocity control, give it positions"
        raise VehicleError(msg)

    def stopping_point(self) -> Position:
        """Return the present position, because the robot stops at once."""
        return self._place

    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Move for ``max_steps`` steps, or to a waypoint (without ``stop_each``, to the last waypoint)."""
        end = self.step + max_steps
        while self.leg < len(self._legs):
            tx, ty, tz, _ = self._legs[self.leg]
            x, y, distance, begun = self._begin
            climbs = tz != self._place[2]
            if climbs:
                self._length += abs(tz - self._place[2])
                self._place = (*self._place[:2], tz)
            stride = self.spec.cell_m
            needed = 0 if climbs and distance < 1e-3 else max(1, math.ceil(distance / stride - _SLACK))
            moved = min(needed, end - begun)
            before = self._place
            if moved >= needed:
                here = (tx, ty, tz)
            elif moved > 0:
                part = moved * stride / distance
                here = (x + (tx - x) * part, y + (ty - y) * part, tz)
            else:
                here = before
            self._record(begun, moved)
            steps = begun + moved - self.step
            if steps > 0:
                pace = min(stride, distance) / self.step_s
                share = pace / distance if distance > 0.0 else 0.0
                self._velocity = ((tx - x) * share, (ty - y) * share)
                self._length += math.hypot(here[0] - before[0], here[1] - before[1])
            self.step, self._place = begun + moved, here
            if moved < needed:
                return MotionEvent.RAN
            self.arrivals[self.leg] = self.step
            self.leg += 1
            if self.leg == len(self._legs):
                self.leg -= 1
                self._legs = []
                return MotionEvent.REACHED
            self._enter()
            if stop_each:
                return MotionEvent.REACHED
        if end > self.step:
            self._velocity = (0.0, 0.0)
            self.step = end
        return MotionEvent.RAN

    def _record(self, begun: int, moved: int) -> None:
        """Write the positions from ``self.step`` to ``begun + moved`` into the track."""
        if not self.track_every or not len(self._legs):
            return
        tx, ty, tz, _ = self._legs[self.leg]
        x, y, distance, _ = self._begin
        first = -(-self.step // self.track_every) * self.track_every
        for step in range(first, begun + moved, self.track_every):
            if self.track_points >= len(self.track):
                return
            part = (step - begun) * self.spec.cell_m / distance if distance > 0.0 else 0.0
            self.track[self.track_points] = (x + (tx - x) * part, y + (ty - y) * part, tz)
            self.track_points += 1

    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps."""
        self._velocity = (0.0, 0.0)
        self.step += steps

    def update_spec(self, spec: VehicleSpec) -> None:
        """Replace the vehicle's defaults."""
        self.spec = spec

    def touch_down(self) -> None:
        """Put the robot at rest on the ground, without a route."""
        self._place = (*self._place[:2], 0.0)
        self._velocity = (0.0, 0.0)
        self._legs = []
