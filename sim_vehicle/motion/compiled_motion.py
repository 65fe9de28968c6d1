"""Base class of compiled motion models: it holds a kernel's state, route, wind and energy."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sim_vehicle.airframe.power_spec import CONSTANT_POWER
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.energy.power import power_coefficients
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import State, record_of, row_of
from sim_vehicle.motion.model import MotionEvent, MotionModel, MotionState
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.columns import Record
    from sim_vehicle.motion.legs import Position

_NO_TRACK = np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Kernel of a motion model, with the names and types of its array arguments.

    Parameters
    ----------
    kernel : callable
        See `sim_vehicle.motion.stepping.kernel_of`.
    state, limits : dtype
        Record types of the arrays that all kernels have.
    own : tuple of (str, dtype or None)
        Names and record types of the arrays that only this kernel has, in argument order, with records first.
    route : str
        Name of the route array.
    """

    kernel: Callable[..., int]
    state: np.dtype[Any]
    limits: np.dtype[Any]
    own: tuple[tuple[str, np.dtype[Any] | None], ...] = ()
    route: str = "_route"

    @property
    def rows(self) -> dict[str, np.dtype[Any] | None]:
        """Names and record types of the arrays that have the same shape in all vehicles of a batch."""
        return {
            "state": self.state,
            "counters": None,
            "_limits": self.limits,
            "_power": None,
            "track": None,
            **dict(self.own),
        }


class CompiledMotion(MotionModel):
    """Vehicle that starts on the ground at home and that a compiled kernel moves.

    Parameters
    ----------
    yaw_rad : float
        Heading at the start.
    """

    dynamics: ClassVar[Dynamics]
    """Dynamics of the vehicle under its autopilot."""

    def __init__(self, spec: VehicleSpec, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        self.spec = spec
        self.step_s = spec.step_s
        self._wind = (wind or Wind()).series()
        self._take_limits(spec)
        self._power = power_coefficients(spec.power, spec.battery)
        self._idle_w = spec.power.idle_w if spec.power is not None else 0.0
        self._known: dict[str, tuple[NDArray[np.float64], Record]] = {}
        self.state: NDArray[np.float64] = np.zeros(self.dynamics.state.itemsize // 8)
        self.state[State.HEADING] = yaw_rad % (2.0 * math.pi)
        self.state[State.GIVE_UP_STEP] = math.inf
        self.state[State.POWER] = self._power[CONSTANT_POWER]
        self.state[col.LEVEL_WIND] = self._wind.at(0, 0.0)[:2]
        self.counters: NDArray[np.int64] = np.zeros(col.COUNTERS, dtype=np.int64)
        self.arrivals: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._route: Record | None = None
        self.track: NDArray[np.float64] = _NO_TRACK
        self.track_every = 0

    @abstractmethod
    def _numbers(self, spec: VehicleSpec) -> Mapping[str, float]:
        """Return the kernel's limits by name, except the time step and the energy."""

    def _take_limits(self, spec: VehicleSpec) -> None:
        capacity_j = math.inf if spec.battery is None else spec.battery.capacity_wh * WH_J
        common = {"step_s": spec.step_s, "energy_limit": capacity_j}
        self._limits = row_of(self.dynamics.limits, {**common, **self._numbers(spec)})

    @property
    def _limit(self) -> Record:
        """The kernel's limits, by name."""
        return record_of(self._limits, self.dynamics.limits)

    @property
    def track_points(self) -> int:
        """Number of track points written."""
        return int(self.counters[col.TRACK_POINTS])

    @property
    def step(self) -> int:
        """Number of steps since the start."""
        return self.counters.item(col.STEP)

    @property
    def leg(self) -> int:
        """Index of the present leg."""
        return int(self.counters[col.LEG_INDEX])

    @property
    def position_m(self) -> Position:
        """Position relative to the start: east, north, up."""
        x, y, z = self.state[col.POSITION].tolist()
        return x, y, z

    @property
    def energy_j(self) -> float:
        """Energy used since the start."""
        return float(self.state[State.ENERGY_USED])

    @property
    def _airspeed(self) -> float:
        """Horizontal airspeed."""
        vx, vy = self.state[State.VELOCITY_X : State.VELOCITY_Z].tolist()
        east, north = self.state[col.LEVEL_WIND].tolist()
        return math.hypot(vx - east, vy - north)

    @property
    def draws_errors(self) -> bool:
        """Whether the autopilot's estimate has errors."""
        return False

    def snapshot(self) -> MotionState:
        """Return the present state of the motion."""
        x, y, z, vx, vy, vz, ax, ay, az, heading, rate, energy, length, power, _, east, north = self.state[
            : State.WIND_NORTH + 1
        ].tolist()
        return MotionState(
            (x, y, z), (vx, vy, vz), (ax, ay, az), heading, rate, energy, length, power, (east, north)
        )

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Place the vehicle in steady flight at time 0, with no energy used and no path flown."""
        self.counters[:] = 0
        self.state[State.POSITION_X : State.ACCELERATION_X] = (*position_m, *velocity_m_s)
        self.state[State.ACCELERATION_X : State.GIVE_UP_STEP] = 0.0
        self.state[State.HEADING] = heading_rad % (2.0 * math.pi)
        self.state[col.LEVEL_WIND] = self._wind.at(self._wind.first, position_m[2])[:2]
        self._route = None

    def _begin(self, route: Record) -> None:
        """Begin a route, whose legs are rows for the kernel."""
        self._route = route
        self.arrivals = np.full(len(route), -1, dtype=np.int64)
        self.state[State.GIVE_UP_STEP] = math.inf
        self.counters[col.LEG_INDEX] = 0
        self.counters[col.MOVED_STEP] = self.counters[col.STEP]
        self.counters[col.ARRIVED] = self.counters[col.NEAR_SENT] = 0

    def advance(self, max_steps: int, *, stop_each: bool = True) -> MotionEvent:
        """Fly for ``max_steps`` steps, or until an event occurs (see `MotionEvent`)."""
        return self._run(self._dynamics_now, max_steps, stop_each)

    @property
    def _dynamics_now(self) -> Dynamics:
        """The dynamics that move the vehicle at present."""
        return self.dynamics

    def is_flown_by_its_autopilot(self) -> bool:
        """Whether the vehicle follows a route by the dynamics of its class."""
        return self._dynamics_now is self.dynamics and getattr(self, self.dynamics.route) is not None

    def _records(self, name: str, kind: np.dtype[Any] | None) -> Record:
        """Return an array of the model as records that share its memory, or unchanged if `kind` is None.

        The records are cached until the array is replaced, because making records takes longer than a step.
        """
        array = getattr(self, name)
        if kind is None:
            return array
        known = self._known.get(name)
        if known is None or known[0] is not array:
            known = self._known[name] = array, array.view(kind)
        return known[1]

    def _run(self, dynamics: Dynamics, max_steps: int, stop_each: bool) -> MotionEvent:
        """Call the kernel for `max_steps` steps, or until an event other than a new wind block occurs."""
        end = self.step + max_steps
        route = getattr(self, dynamics.route)
        if route is None:
            return MotionEvent.RAN
        state, limits = self._records("state", dynamics.state), self._records("_limits", dynamics.limits)
        own = [self._records(name, kind) for name, kind in dynamics.own]
        while True:
            event = dynamics.kernel(
                state,
                self.counters,
                route,
                limits,
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

    def rest(self, steps: int, *, armed: bool) -> None:
        """Stand on the ground for a number of steps, with idle power if armed."""
        power = float(self._power[CONSTANT_POWER]) + (self._idle_w if armed else 0.0)
        self.state[State.POWER] = power
        self.state[State.ENERGY_USED] += power * steps * self.step_s
        self.counters[col.STEP] += steps
        self.state[col.LEVEL_WIND] = self._wind.at(self.step // col.GRID, 0.0)[:2]

    def ignore_energy(self) -> None:
        """Let the vehicle fly on with an empty battery."""
        self._limit.energy_limit = math.inf

    def update_spec(self, spec: VehicleSpec) -> None:
        """Replace the vehicle's defaults and limits; the new values apply from the next route."""
        energy_j = self._limit.energy_limit
        self.spec = spec
        self._take_limits(spec)
        if energy_j == math.inf:
            self._limit.energy_limit = energy_j

    def use_energy(self, joules: float) -> None:
        """Take energy from the battery."""
        self.state[State.ENERGY_USED] += joules

    def touch_down(self) -> None:
        """Put the vehicle at rest on the ground, without a route."""
        self.state[State.POSITION_Z : State.HEADING] = 0.0
        self.state[State.HEADING_RATE] = 0.0
        self._route = None
