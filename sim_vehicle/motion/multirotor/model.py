"""A multirotor as a motion model: the compiled kernel with its state, route, wind and energy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.energy.battery import WH_J
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.compiled_motion import CompiledMotion
from sim_vehicle.motion.legs import KEEP
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.motion.multirotor.legs import prepare_route, prepare_velocity
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route

_NO_TRACK = np.empty((0, 3))


class Multirotor(CompiledMotion):
    """A multirotor that flies routes.

    Parameters
    ----------
    yaw_rad : float
        Heading at the start.

    Examples
    --------
    >>> from sim_vehicle.motion.legs import Leg, Route
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> vehicle = Multirotor(get_vehicle("quad"))
    >>> vehicle.fly(Route.through([Leg((0.0, 0.0, 10.0), 5.0)]))
    >>> vehicle.advance(10_000)
    <MotionEvent.REACHED: 1>
    >>> round(vehicle.position_m[2], 1), vehicle.time_s < 10.0
    (10.0, True)
    """

    _kernel = staticmethod(kernel.advance)
    _state_size = col.STATE
    _energy_limit = kernel.ENERGY_LIMIT

    def __init__(self, spec: VehicleSpec, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        super().__init__(spec, wind, yaw_rad)
        self.state[col.LOOK_EAST : col.LOOK_NORTH + 1] = math.nan

    def _numbers(self, spec: VehicleSpec) -> NDArray[np.float64]:
        return _limits(spec)

    def attitude(self) -> tuple[float, float, float, float] | None:
        """None: they follow from the acceleration."""
        return None

    def fly(self, route: Route) -> None:
        """Begin a route, from where the vehicle is and as it moves now."""
        self._route = prepare_route(
            self.state[col.POSITION : col.VELOCITY].copy(),
            route.points_m,
            route.radius_m,
            route.speed_m_s,
            route.vertical_m_s,
            route.heading_rad,
            route.turn_rad_s,
            route.near_m,
            self._limits,
        )
        self._begin()

    def steer(
        self,
        velocity_m_s: tuple[float, float, float],
        *,
        height_m: float = math.nan,
        heading: Heading = KEEP,
    ) -> None:
        """Keep a velocity, or its horizontal part at a height; downward it goes on to the ground."""
        self._route = prepare_velocity(
            self.state[col.POSITION : col.VELOCITY], velocity_m_s, height_m, *heading.numbers, self._limits
        )
        self._begin()

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) whatever is flown, None for no more."""
        self.state[col.LOOK_EAST : col.LOOK_NORTH + 1] = math.nan if position_m is None else position_m

    def point(self, heading_rad: float) -> None:
        """Turn the nose to a compass heading on the leg that is flown now."""
        if self._route is not None:
            self._route[self.leg, kernel.LEG_HEADING] = heading_rad
            self._route[self.leg, kernel.LEG_TURN_RATE] = math.nan

    def stopping_point(self) -> Position:
        """Return the position of rest if it brakes now."""
        x, y, z, vx, vy, vz, ax, ay, az = self.state[col.POSITION : col.HEADING].tolist()
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed < 1e-3:
            return x, y, z
        ux, uy, uz = vx / speed, vy / speed, vz / speed
        probe = np.array([[x + ux, y + uy, z + uz]])
        one = np.ones(1)
        row = prepare_route(
            self.state[col.POSITION : col.VELOCITY].copy(), probe, one, one, one, one, one, one, self._limits
        )[0]
        along = ax * ux + ay * uy + az * uz
        distance = kernel.stopping_distance(
            speed, along, 0.0, row[kernel.LEG_ACCELERATION_ALONG], row[kernel.LEG_JERK_ALONG]
        )
        return x + ux * distance, y + uy * distance, max(z + uz * distance, 0.0)

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Climb and sink no faster than this, from the next route on; None is the vehicle's own limit."""
        spec = self.spec
        self._limits[kernel.CLIMB_MAX] = min(climb_m_s or math.inf, spec.climb_speed_m_s)
        self._limits[kernel.DESCENT_MAX] = min(descent_m_s or math.inf, spec.descent_speed_m_s)

    def lose_power(self) -> None:
        """Nothing: it comes down with what is left."""


def _limits(spec: VehicleSpec) -> NDArray[np.float64]:
    """Return the limits in the order of the kernel."""
    capacity = spec.battery.capacity_wh * WH_J if spec.battery is not None else math.inf
    return np.array(
        [
            spec.step_s,
            spec.speed_limit_m_s,
            spec.airspeed_limit_m_s,
            spec.climb_speed_m_s,
            spec.descent_speed_m_s,
            spec.acceleration_m_s2,
            spec.jerk_m_s3,
            spec.vertical_acceleration_m_s2,
            spec.vertical_jerk_m_s3,
            spec.yaw_rate_rad_s,
            spec.yaw_acceleration_rad_s2,
            capacity,
            spec.landing_speed_m_s,
        ]
    )
