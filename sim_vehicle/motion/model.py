"""What a motion model is: it flies routes, in fixed steps, and tells when something happens."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec


class MotionEvent(IntEnum):
    """Why a motion model returned; the values are those of the kernel."""

    RAN = 0
    REACHED = 1
    STALLED = 3
    ENERGY = 4
    NEAR = 5


class LegKind(IntEnum):
    """What a leg is flown for; an autopilot has its own law for some."""

    WAYPOINT = 0
    TAKEOFF = 1
    CLIMB = 2
    HOME = 3
    DESCEND = 4
    LAND = 5
    STAY = 6
    LOITER = 7
    ARC = 8


@dataclass(frozen=True, slots=True)
class Route:
    """Legs that are flown without a pause between them, unless a leg ends with a stop.

    Parameters
    ----------
    points_m : float64[n, 3]
        Ends of the legs: east, north, up about home.
    radius_m : float64[n]
        Acceptance radius; 0 is a stop. The last point is always a stop.
    speed_m_s : float64[n]
        Horizontal ground speed; less its sign, a negative one is the speed of a vertical leg.
    heading_rad : float64[n]
        Compass heading on the leg; NaN looks along the leg, infinity keeps the heading.
    near_m : float64[n]
        Distance to the end at which NEAR is told, 0 for never.
    kind : int64[n]
        `LegKind` of each leg.
    pause_s : float64[n]
        Time to stay at the end of the leg, which is a stop then.
    turn_rad_s : float
        Rate of turning instead of the headings; NaN for none.
    circle : float64[n, 4] or None
        For vehicles that stay by circling: radius (clockwise when positive, NaN is the autopilot's own),
        turns, and the place (east, north) towards which the circle is left, NaN for anywhere.
    """

    points_m: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    speed_m_s: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    near_m: NDArray[np.float64]
    kind: NDArray[np.int64]
    pause_s: NDArray[np.float64]
    turn_rad_s: float = math.nan
    circle: NDArray[np.float64] | None = None

    @classmethod
    def to(
        cls,
        x_m: float,
        y_m: float,
        z_m: float,
        *,
        speed_m_s: float,
        heading_rad: float = math.nan,
        turn_rad_s: float = math.nan,
    ) -> Route:
        """Return a route of one leg, with a stop at its end."""
        return cls.through([(x_m, y_m, z_m, 0.0, speed_m_s, heading_rad, 0.0)], turn_rad_s)

    @classmethod
    def through(cls, legs: Sequence[tuple[float, ...]], turn_rad_s: float = math.nan) -> Route:
        """Return a route of (x, y, z, radius, speed, heading, near[, kind[, pause[, circle...]]]) rows."""
        table = np.zeros((len(legs), 13))
        table[:, 9:] = math.nan
        for row, leg in zip(table, legs, strict=True):
            row[: len(leg)] = leg
        radius, speed, heading, near, kind, pause = (np.ascontiguousarray(row) for row in table.T[3:9])
        points = np.ascontiguousarray(table[:, :3])
        circle = np.ascontiguousarray(table[:, 9:])
        return cls(points, radius, speed, heading, near, kind.astype(np.int64), pause, turn_rad_s, circle)


class MotionModel(Protocol):
    """A vehicle's motion (`Multirotor`, `FixedWing`, `Rover`, `IdealRobot`)."""

    spec: VehicleSpec
    step_s: float
    arrivals: NDArray[np.int64]
    track: NDArray[np.float64]
    track_every: int

    @property
    def track_points(self) -> int:
        """Points of the track that were written."""

    @property
    def time_s(self) -> float:
        """Time since the start."""

    @property
    def step(self) -> int:
        """Steps since the start."""

    @property
    def leg(self) -> int:
        """Index of the leg that is being flown."""

    @property
    def position_m(self) -> tuple[float, float, float]:
        """East, north, up about home."""

    @property
    def energy_j(self) -> float:
        """Energy used since the start."""

    def numbers(self) -> list[float]:
        """Return position, velocity, acceleration, heading, its rate, energy, path, power, -, wind."""

    def attitude(self) -> tuple[float, float, float, float] | None:
        """Return roll, pitch, airspeed and throttle; None where they follow from the acceleration."""

    def fly(self, route: Route) -> None:
        """Begin a route."""

    def steer(
        self,
        velocity_m_s: tuple[float, float, float],
        *,
        height_m: float = math.nan,
        heading_rad: float = math.inf,
        turn_rad_s: float = math.nan,
    ) -> None:
        """Keep a velocity (east, north, up), or its horizontal part at a height.

        Sinking, it goes on to the ground and slows down to the landing speed there; REACHED tells the touch.
        A heading of NaN is that of the flight, infinity keeps it.

        Raises
        ------
        VehicleError
            When the vehicle has no velocity control.
        """

    def look_at(self, place_m: tuple[float, float] | None) -> None:
        """Point the nose at a place (east, north) whatever is flown, None for no more."""

    def stopping_point(self) -> tuple[float, float, float]:
        """Return where the vehicle comes to rest if it brakes now."""

    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly up to a number of steps, less when something happens."""

    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps."""

    def respec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits."""

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Climb and sink no faster than this, from the next route on; None is the vehicle's own limit."""

    def use_energy(self, joules: float) -> None:
        """Take energy out of the battery."""

    def lose_power(self) -> None:
        """Fly on without the motor, where that is possible."""

    def touch_down(self) -> None:
        """Stand still on the ground."""

    def ignore_energy(self) -> None:
        """Tell no more that the battery is empty."""
