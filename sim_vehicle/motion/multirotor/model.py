"""A multirotor as a motion model: the compiled kernel with its state, route, wind and energy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.energy.battery import WH_J
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import KEEP, ROUTE
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.motion.multirotor.legs import prepare_route, prepare_velocity
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.columns import Record
    from sim_vehicle.motion.legs import Heading, Position, Route

GENERIC = Dynamics(kernel.advance, col.STATE, kernel.LIMITS)
"""Those of a multirotor of no autopilot in particular, or that is not flown by its autopilot."""


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

    dynamics = GENERIC
    _state_size = len(col.State)
    _energy_limit = kernel.Limits.ENERGY_LIMIT

    def __init__(self, spec: VehicleSpec, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        super().__init__(spec, wind, yaw_rad)
        self.state[col.LOOK] = math.nan

    def _numbers(self, spec: VehicleSpec) -> NDArray[np.float64]:
        return _limits(spec)

    def fly(self, route: Route) -> None:
        """Begin a route, from where the vehicle is and as it moves now."""
        self._route = self._prepared(route.legs)
        self._begin()

    def _prepared(self, legs: Record) -> Record:
        route = np.zeros(len(legs), kernel.LEG)
        prepare_route(route, self._records("state", col.STATE), legs, self._records("_limits", kernel.LIMITS))
        return route

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Keep a velocity, or its horizontal part at a height; downward it goes on to the ground."""
        limits = self._records("_limits", kernel.LIMITS)[0]
        self._route = prepare_velocity(self.position_m, velocity_m_s, height_m, *heading.numbers, limits)
        self._begin()

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) whatever is flown, None for no more."""
        self.state[col.LOOK] = math.nan if position_m is None else position_m

    def point(self, heading_rad: float) -> None:
        """Turn the nose to a compass heading on the leg that is flown now."""
        if self._route is not None:
            self._route["heading"][self.leg] = heading_rad
            self._route["turn_rate"][self.leg] = math.nan

    def stopping_point(self) -> Position:
        """Return the position of rest if it brakes now."""
        x, y, z, vx, vy, vz, ax, ay, az = self.state[State.POSITION_X : State.HEADING].tolist()
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed < 1e-3:
            return x, y, z
        ux, uy, uz = vx / speed, vy / speed, vz / speed
        probe = np.ones(1, ROUTE)
        probe["x"], probe["y"], probe["z"] = x + ux, y + uy, z + uz
        leg = self._prepared(probe)[0]
        along = ax * ux + ay * uy + az * uz
        limit, jerk = leg.acceleration_along, leg.jerk_along
        distance = kernel.stopping_distance(speed, along, 0.0, limit, jerk)
        return x + ux * distance, y + uy * distance, max(z + uz * distance, 0.0)

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Climb and sink no faster than this, from the next route on; None is the vehicle's own limit."""
        spec = self.spec
        self._limits[kernel.Limits.CLIMB_MAX] = min(climb_m_s or math.inf, spec.climb_speed_m_s)
        self._limits[kernel.Limits.DESCENT_MAX] = min(descent_m_s or math.inf, spec.descent_speed_m_s)


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
