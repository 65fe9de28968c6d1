"""A multirotor as a motion model: the compiled kernel with its state, route, wind and energy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.energy.battery import WH_J
from sim_vehicle.energy.power import power_coefficients
from sim_vehicle.motion.legs import KEEP
from sim_vehicle.motion.model import MotionEvent, MotionState
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.motion.multirotor.legs import prepare_route, prepare_velocity
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route

_NO_TRACK = np.empty((0, 3))


class Multirotor:
    """A multirotor that flies routes.

    Parameters
    ----------
    spec : VehicleSpec
    wind : Wind, optional
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

    # The compiled law; a subclass whose kernel takes the same arguments has its own.
    _kernel = staticmethod(kernel.advance)

    def __init__(self, spec: VehicleSpec, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        self.spec = spec
        self.step_s = spec.step_s
        self._wind = (wind or Wind()).series()
        self._limits = _limits(spec)
        self._power = power_coefficients(spec.power, spec.battery)
        self._idle_w = spec.power.idle_w if spec.power is not None else 0.0
        self.state: NDArray[np.float64] = np.zeros(kernel.STATE)
        self.state[9] = yaw_rad % (2.0 * math.pi)
        self.state[14] = math.inf
        self.state[17:19] = math.nan
        self.state[13] = self._power[6]
        self.state[15:17] = self._wind.at(0, 0.0)[:2]
        self.counters: NDArray[np.int64] = np.zeros(kernel.COUNTERS, dtype=np.int64)
        self.arrivals: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._route: NDArray[np.float64] | None = None
        self.track: NDArray[np.float64] = _NO_TRACK
        self.track_every = 0

    @property
    def time_s(self) -> float:
        """Time since the start."""
        return int(self.counters[0]) * self.step_s

    @property
    def track_points(self) -> int:
        """Points of the track that were written."""
        return int(self.counters[5])

    @property
    def step(self) -> int:
        """Steps since the start."""
        return int(self.counters[0])

    @property
    def leg(self) -> int:
        """Index of the leg that is being flown."""
        return int(self.counters[1])

    @property
    def position_m(self) -> Position:
        """East, north, up about home."""
        x, y, z = self.state[0:3].tolist()
        return x, y, z

    @property
    def energy_j(self) -> float:
        """Energy used since the start."""
        return float(self.state[11])

    def snapshot(self) -> MotionState:
        """Return how the vehicle moves now."""
        x, y, z, vx, vy, vz, ax, ay, az, heading, rate, energy, length, power, _, east, north = self.state[
            :17
        ].tolist()
        return MotionState(
            (x, y, z), (vx, vy, vz), (ax, ay, az), heading, rate, energy, length, power, (east, north)
        )

    def attitude(self) -> tuple[float, float, float, float] | None:
        """None: they follow from the acceleration."""
        return None

    def fly(self, route: Route) -> None:
        """Begin a route, from where the vehicle is and as it moves now."""
        self._route = prepare_route(
            self.state[0:3].copy(),
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
            self.state[0:3], velocity_m_s, height_m, *heading.numbers, self._limits
        )
        self._begin()

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) whatever is flown, None for no more."""
        self.state[17:19] = math.nan if position_m is None else position_m

    def _begin(self) -> None:
        assert self._route is not None
        self.arrivals = np.full(len(self._route), -1, dtype=np.int64)
        self.state[14] = math.inf
        self.counters[1] = 0
        self.counters[2] = self.counters[0]
        self.counters[3] = self.counters[4] = 0

    def stopping_point(self) -> Position:
        """Return where the vehicle comes to rest if it brakes now."""
        x, y, z, vx, vy, vz, ax, ay, az = self.state[0:9].tolist()
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed < 1e-3:
            return x, y, z
        ux, uy, uz = vx / speed, vy / speed, vz / speed
        probe = np.array([[x + ux, y + uy, z + uz]])
        one = np.ones(1)
        row = prepare_route(self.state[0:3].copy(), probe, one, one, one, one, one, one, self._limits)[0]
        along = ax * ux + ay * uy + az * uz
        distance = kernel.stopping_distance(speed, along, 0.0, row[16], row[17])
        return x + ux * distance, y + uy * distance, max(z + uz * distance, 0.0)

    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly up to ``max_steps`` steps, less when something happens (see `MotionEvent`)."""
        end = int(self.counters[0]) + max_steps
        route = self._route
        if route is None:
            return MotionEvent.RAN
        while True:
            event = self._kernel(
                self.state,
                self.counters,
                route,
                self._limits,
                self._power,
                self._wind.block,
                self._wind.first,
                end - int(self.counters[0]),
                stop_each,
                self.arrivals,
                self.track,
                self.track_every,
            )
            if event != kernel.WIND:
                return MotionEvent(event)
            self._wind.forward()

    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps: no motion, only the idle power."""
        power = float(self._power[6]) + (self._idle_w if armed else 0.0)
        self.state[13] = power
        self.state[11] += power * steps * self.step_s
        self.counters[0] += steps
        self.state[15:17] = self._wind.at(self.step // kernel.GRID, 0.0)[:2]

    def ignore_energy(self) -> None:
        """Tell no more that the battery is empty."""
        self._limits[11] = math.inf

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next route on."""
        energy = self._limits[11]
        self.spec = spec
        self._limits = _limits(spec)
        if energy == math.inf:
            self._limits[11] = energy

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Climb and sink no faster than this, from the next route on; None is the vehicle's own limit."""
        spec = self.spec
        self._limits[3] = min(climb_m_s or math.inf, spec.climb_speed_m_s)
        self._limits[4] = min(descent_m_s or math.inf, spec.descent_speed_m_s)

    def use_energy(self, joules: float) -> None:
        """Take energy out of the battery."""
        self.state[11] += joules

    def lose_power(self) -> None:
        """Nothing: it comes down with what is left."""

    def touch_down(self) -> None:
        """Stand still on the ground."""
        self.state[2:9] = 0.0
        self.state[10] = 0.0
        self._route = None


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
