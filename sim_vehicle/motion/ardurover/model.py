"""A ground vehicle as ArduPilot's Rover drives it: the compiled drive with its state and its law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.motion.arducopter.along_curves import AlongCurves
from sim_vehicle.motion.arducopter.layout import Guide, Law
from sim_vehicle.motion.ardurover import kernel
from sim_vehicle.motion.ardurover.kernel import Drive, DriveGains
from sim_vehicle.motion.compiled_motion import Dynamics
from sim_vehicle.motion.legs import KEEP, LegKind
from sim_vehicle.motion.rover import layout as wheels
from sim_vehicle.motion.rover.layout import Wheels
from sim_vehicle.motion.rover.model import NOT_DRIVEN, Rover

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route
    from sim_vehicle.motion.rover.model import RoverLimits
    from sim_vehicle.weather.wind import Wind

# Legs that are followed as any `Rover` does it: bends of a curve, and positions that are asked for again and
# again, which Rover does not drive to along S-curves either.
_PURSUED = (LegKind.ARC, LegKind.SETPOINT)


@dataclass(frozen=True, slots=True)
class DriveLaw:
    """What Rover's parameters and the vehicle decide; SI units, radians, throttle and steering from -1 to 1.

    Parameters
    ----------
    position_p, velocity_p, velocity_filter_hz : float
        Position control.
    path_acceleration, jerk, snap : float
        Along the S-curves.
    acceleration, deceleration : float
        Of the speed that is asked for.
    lateral, turn_speed : float
        Greatest lateral acceleration; speed that it keeps in turns unless it slows down.
    radius, near : float
        How near to a corner the next leg may begin; how near a stop counts as reached.
    steer_acceleration, steer_rate : float
        Limits of the rate of turning that is asked for.
    steer_ff, steer_p, steer_i, steer_imax, steer_filter_hz : float
        Steering over rate of turning.
    scale_base : float
        Speed above which the steering is scaled down.
    tightest : float
        Radius at full steering; 0 for a vehicle that steers by its tracks.
    track_lag_s : float
        Time constant of the turns of tracks.
    angle_p, pivot_angle, pivot_rate, pivot_delay_s : float
        Turns on the spot; an angle of 0 is never.
    drive_base, drive_p, drive_i, drive_imax, drive_filter_hz : float
        Throttle over speed.
    stop_speed : float
        Below it, told to stop, the throttle is zero.
    top_speed, drive_lag_s : float
        Speed at full throttle and time constant of the speed.
    """

    position_p: float
    velocity_p: float
    velocity_filter_hz: float
    path_acceleration: float
    jerk: float
    snap: float
    acceleration: float
    deceleration: float
    lateral: float
    turn_speed: float
    radius: float
    near: float
    steer_acceleration: float
    steer_rate: float
    steer_ff: float
    steer_p: float
    steer_i: float
    steer_imax: float
    steer_filter_hz: float
    scale_base: float
    tightest: float
    track_lag_s: float
    angle_p: float
    pivot_angle: float
    pivot_rate: float
    pivot_delay_s: float
    drive_base: float
    drive_p: float
    drive_i: float
    drive_imax: float
    drive_filter_hz: float
    stop_speed: float
    top_speed: float
    drive_lag_s: float


class ArduRover(AlongCurves, Rover):
    """A vehicle on wheels or tracks under ArduPilot's Rover; velocities are driven as any `Rover` does.

    Parameters
    ----------
    limits_of, law_of : callable
        What the autopilot makes of a vehicle's parameters.
    wind : Wind, optional
        Counts only in the power.
    yaw_rad : float
        Heading at the start.
    """

    dynamics = Dynamics(
        kernel.advance,
        wheels.STATE,
        wheels.LIMITS,
        (("guide", kernel.GUIDE), ("numbers", kernel.LAW), ("heads", None), ("curves", None)),
        "_rows",
    )
    generic = Rover.dynamics
    # A return begins anew from where the vehicle stops.
    begins_anew = LegKind.HOME

    def __init__(
        self,
        spec: VehicleSpec,
        limits_of: Callable[[VehicleSpec], RoverLimits],
        law_of: Callable[[VehicleSpec], DriveLaw],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        super().__init__(spec, limits_of, wind, yaw_rad)
        self._law_of = law_of
        self._remember(len(Guide) + len(Drive))
        self.numbers = _numbers(law_of(spec), self.step_s)
        self._rest()

    def _rest(self) -> None:
        """Have no path, and the speed that the vehicle has."""
        self._rows = None
        self.guide[:] = 0.0
        self.guide[Guide.LEVEL] = self.spec.cruise_speed_m_s
        self.guide[Guide.RESET] = 1.0
        self.guide[Drive.SPEED_ASKED] = self.state[Wheels.SPEED]

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Be under way at time 0, with nothing used yet, as if it had driven there.

        A first leg that lies ahead is then gone on with, as far along its profile as the speed tells.
        """
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.heads[:] = 0.0
        self._rest()
        self._under_way = True

    def fly(self, route: Route) -> None:
        """Begin a route, from where the vehicle is and as it moves now."""
        if np.isin(route.kind, _PURSUED).any():
            self._rest()
            super().fly(route)
            return
        if self._rows is None and not self._goes_on:
            self._rest()
        ends = np.column_stack((route.points_m[:, :2], np.zeros(len(route.kind))))
        kind = np.where(np.isin(route.kind, NOT_DRIVEN), kernel.AT_ONCE, route.kind)
        self._set_out(route, self.numbers, ends, kind, self.law.speed_max)

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Drive at a velocity, or stop; told to go down it stops for good."""
        self._rest()
        super().steer(velocity_m_s, height_m=height_m, heading=heading)

    def lose_power(self) -> None:
        """Stop: without power it cannot go anywhere."""
        super().lose_power()
        self.numbers[DriveGains.TOP_SPEED] = 0.0

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next route on."""
        super().update_spec(spec)
        self.numbers = _numbers(self._law_of(spec), self.step_s)

    def touch_down(self) -> None:
        """Stand still."""
        super().touch_down()
        self._rest()


def _numbers(law: DriveLaw, dt: float) -> NDArray[np.float64]:
    """Return the law in the order of the kernel."""
    numbers = np.zeros(len(Law) + len(DriveGains))
    by_place = {
        Law.DT: dt,
        Law.POS_P: law.position_p,
        Law.VEL_P: law.velocity_p,
        Law.ERROR_FILTER: _share(dt, law.velocity_filter_hz),
        Law.ACCEL: law.path_acceleration,
        Law.ACCEL_Z: law.path_acceleration,
        Law.CORNER: law.lateral,
        Law.WP_RADIUS: law.radius,
        Law.PACE_FILTER: min(1.0, dt * law.jerk / law.path_acceleration),
        Law.JERK: law.jerk,
        Law.SNAP: law.snap,
        DriveGains.NEAR: law.near,
        DriveGains.SPEED_ACCEL: law.acceleration,
        DriveGains.DECEL: law.deceleration,
        DriveGains.LATERAL: law.lateral,
        DriveGains.TURN_SPEED: law.turn_speed,
        DriveGains.STEER_ACCEL: law.steer_acceleration,
        DriveGains.STEER_RATE: law.steer_rate,
        DriveGains.STEER_FF: law.steer_ff,
        DriveGains.STEER_P: law.steer_p,
        DriveGains.STEER_I_GAIN: law.steer_i,
        DriveGains.STEER_IMAX: law.steer_imax,
        DriveGains.STEER_FILTER: _share(dt, law.steer_filter_hz),
        DriveGains.SCALE_BASE: law.scale_base,
        DriveGains.TIGHTEST: law.tightest,
        DriveGains.STEER_LAG: min(1.0, dt / law.track_lag_s),
        DriveGains.ANGLE_P: law.angle_p,
        DriveGains.PIVOT_ANGLE: law.pivot_angle,
        DriveGains.PIVOT_RATE: law.pivot_rate,
        DriveGains.PIVOT_DELAY: law.pivot_delay_s / dt,
        DriveGains.DRIVE_BASE: law.drive_base,
        DriveGains.DRIVE_P: law.drive_p,
        DriveGains.DRIVE_I_GAIN: law.drive_i,
        DriveGains.DRIVE_IMAX: law.drive_imax,
        DriveGains.DRIVE_FILTER: _share(dt, law.drive_filter_hz),
        DriveGains.STOP_SPEED: law.stop_speed,
        DriveGains.TOP_SPEED: law.top_speed,
        DriveGains.DRIVE_LAG: min(1.0, dt / law.drive_lag_s),
    }
    for place, value in by_place.items():
        numbers[place] = value
    return numbers


def _share(dt: float, frequency_hz: float) -> float:
    """Return the share that a low-pass filter takes over in a step; a frequency of 0 is no filter."""
    return dt / (dt + 1.0 / (2.0 * math.pi * frequency_hz)) if frequency_hz > 0.0 else 1.0
