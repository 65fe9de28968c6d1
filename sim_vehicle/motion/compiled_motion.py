"""What the compiled motion models have in common: a state, a route, wind and energy around a kernel."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sim_vehicle.energy.power import CONSTANT_POWER, power_coefficients
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.model import MotionEvent, MotionState
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.estimate_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

_NO_TRACK = np.empty((0, 3))


class CompiledMotion(ABC):
    """A vehicle on the ground at home, moved by a compiled kernel.

    Parameters
    ----------
    yaw_rad : float
        Heading at the start.
    """

    _kernel: ClassVar[Callable[..., int]]
    _state_size: ClassVar[int]
    _energy_limit: ClassVar[int]

    def __init__(self, spec: VehicleSpec, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        self.spec = spec
        self.step_s = spec.step_s
        self._wind = (wind or Wind()).series()
        self._limits = self._numbers(spec)
        self._power = power_coefficients(spec.power, spec.battery)
        self._idle_w = spec.power.idle_w if spec.power is not None else 0.0
        self.state: NDArray[np.float64] = np.zeros(self._state_size)
        self.state[col.HEADING] = yaw_rad % (2.0 * math.pi)
        self.state[col.GIVE_UP_STEP] = math.inf
        self.state[col.POWER] = self._power[CONSTANT_POWER]
        self.state[col.WIND_EAST : col.WIND_NORTH + 1] = self._wind.at(0, 0.0)[:2]
        self.counters: NDArray[np.int64] = np.zeros(col.COUNTERS, dtype=np.int64)
        self.arrivals: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._route: NDArray[np.float64] | None = None
        self.track: NDArray[np.float64] = _NO_TRACK
        self.track_every = 0

    @abstractmethod
    def _numbers(self, spec: VehicleSpec) -> NDArray[np.float64]:
        """The limits in the order of the kernel."""

    @property
    def time_s(self) -> float:
        """Time since the start."""
        return self.step * self.step_s

    @property
    def track_points(self) -> int:
        """Points of the track that were written."""
        return int(self.counters[col.TRACK_POINTS])

    @property
    def step(self) -> int:
        """Steps since the start."""
        step: int = self.counters.item(col.STEP)
        return step

    @property
    def leg(self) -> int:
        """Index of the leg that is being flown."""
        return int(self.counters[col.LEG_INDEX])

    @property
    def position_m(self) -> Position:
        """East, north, up about home."""
        x, y, z = self.state[col.POSITION : col.VELOCITY].tolist()
        return x, y, z

    @property
    def energy_j(self) -> float:
        """Energy used since the start."""
        return float(self.state[col.ENERGY_USED])

    @property
    def estimate_error(self) -> tuple[float, float, float, float]:
        """Errors of what the autopilot estimates: 0, it flies by the truth."""
        return 0.0, 0.0, 0.0, 0.0

    def estimate_with(self, errors: EstimateErrors) -> None:  # noqa: B027 (most motions fly by the truth)
        """Nothing: only PX4's multirotors are flown by a wrong estimate."""

    def snapshot(self) -> MotionState:
        """Return the motion state now."""
        x, y, z, vx, vy, vz, ax, ay, az, heading, rate, energy, length, power, _, east, north = self.state[
            : col.WIND_NORTH + 1
        ].tolist()
        return MotionState(
            (x, y, z), (vx, vy, vz), (ax, ay, az), heading, rate, energy, length, power, (east, north)
        )

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Be in steady flight at time 0, with nothing used yet, as if it had flown there."""
        self.counters[:] = 0
        self.state[col.POSITION : col.ACCELERATION] = (*position_m, *velocity_m_s)
        self.state[col.ACCELERATION : col.GIVE_UP_STEP] = 0.0
        self.state[col.HEADING] = heading_rad % (2.0 * math.pi)
        self.state[col.WIND_EAST : col.WIND_NORTH + 1] = self._wind.at(self._wind.first, position_m[2])[:2]
        self._route = None

    def _begin(self) -> None:
        assert self._route is not None
        self.arrivals = np.full(len(self._route), -1, dtype=np.int64)
        self.state[col.GIVE_UP_STEP] = math.inf
        self.counters[col.LEG_INDEX] = 0
        self.counters[col.MOVED_STEP] = self.counters[col.STEP]
        self.counters[col.ARRIVED] = self.counters[col.NEAR_TOLD] = 0

    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly up to ``max_steps`` steps, less when something happens (see `MotionEvent`)."""
        return self._run(self._kernel, self._route, (), max_steps, stop_each)

    def _run(
        self,
        kernel: Callable[..., int],
        route: NDArray[np.float64] | None,
        own: tuple[NDArray[np.float64], ...],
        max_steps: int,
        stop_each: bool,
    ) -> MotionEvent:
        """Call a kernel, with the arrays that are its own, until an event that is not the wind's."""
        end = self.step + max_steps
        if route is None:
            return MotionEvent.RAN
        while True:
            event = kernel(
                self.state,
                self.counters,
                route,
                self._limits,
                self._power,
                self._wind.block,
                self._wind.first,
                end - self.step,
                stop_each,
                self.arrivals,
                self.track,
                self.track_every,
                *own,
            )
            if event != col.WIND:
                return MotionEvent(event)
            self._wind.forward()

    def interrupt(self) -> None:  # noqa: B027 (most motions have nothing to do)
        """Nothing: a route begins as the vehicle moves."""

    def point(self, heading_rad: float) -> None:  # noqa: B027 (only multirotors turn as they like)
        """Nothing: the nose points where it moves to."""

    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps: no motion, only the idle power."""
        power = float(self._power[CONSTANT_POWER]) + (self._idle_w if armed else 0.0)
        self.state[col.POWER] = power
        self.state[col.ENERGY_USED] += power * steps * self.step_s
        self.counters[col.STEP] += steps
        self.state[col.WIND_EAST : col.WIND_NORTH + 1] = self._wind.at(self.step // col.GRID, 0.0)[:2]

    def ignore_energy(self) -> None:
        """Tell no more that the battery is empty."""
        self._limits[self._energy_limit] = math.inf

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next route on."""
        energy = self._limits[self._energy_limit]
        self.spec = spec
        self._limits = self._numbers(spec)
        if energy == math.inf:
            self._limits[self._energy_limit] = energy

    def use_energy(self, joules: float) -> None:
        """Take energy out of the battery."""
        self.state[col.ENERGY_USED] += joules

    def touch_down(self) -> None:
        """Stand still on the ground."""
        self.state[col.POSITION + 2 : col.HEADING] = 0.0
        self.state[col.HEADING_RATE] = 0.0
        self._route = None
