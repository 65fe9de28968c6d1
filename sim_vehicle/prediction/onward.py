"""Time and energy of the remaining mission of a vehicle in flight, for many paths in one batch."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from geo.frame import LocalFrame
from geo.linear_algebra import product
from mission.model import Command, Frame, MissionItem
from mission.planners.cornering import Cornering
from sim_vehicle.autopilot import flight_procedures
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.item_legs import plan_item_legs
from sim_vehicle.execution.items import Settings, do_items, item_positions
from sim_vehicle.execution.leg_follower import AfterLastLeg
from sim_vehicle.motion.legs import Leg, Route
from sim_vehicle.motion.model import MotionEvent

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from mission.planners.cornering import Waypoints
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.batch import VehicleBatch
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

RETURN_HOME = (MissionItem(Command.NAV_RETURN_TO_LAUNCH),)
_LONGEST_S = 86_400.0
_AXIS_M = 100.0
# Time steps of multirotors on the legs of a path, and on the return, as multiples of `step_s`.
_PATH_STEPS, _HOME_STEPS = 2, 3
_MAX_RETURNS = 100_000


@dataclass(frozen=True, slots=True)
class InFlight:
    """State of a vehicle in flight, as known from telemetry."""

    position_m: tuple[float, float]
    """Position in the farm frame."""
    height_m: float
    """Height above home."""
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    """Ground velocity along x and y of the farm frame."""
    climb_m_s: float = 0.0
    heading_rad: float | None = None
    """Compass heading; None selects the direction of the velocity."""


class OnwardPredictor:
    """Predictor of the cost of a vehicle's remaining mission: a flight through waypoints, then a return.

    Motion models of the vehicle fly all paths at the same time, in threads on all cores, in a wind without
    gusts. For multirotors, the time steps are longer than in a simulated flight, which changes the result by
    about 1 %.

    Parameters
    ----------
    spec : VehicleSpec
        Vehicle under its autopilot (`sim_vehicle.autopilot.with_autopilot`).
    frame : LocalFrame
        Farm frame, in which paths, positions and home are given.
    altitude_m, speed_m_s : float
        Altitude of the waypoints above home, and speed of the mission; by default the cruise speed.
    waypoints : callable, optional
        Function that takes a path, float64[n, 2], and the vehicle's position, and returns the waypoints that
        the vehicle gets; by default these are the points of the path.
    ending : tuple of MissionItem
        Items after the last waypoint: a return to launch, or the landing of a fixed wing. Without items the
        mission ends at the last waypoint.
    wind : Wind, optional
        Wind; its gusts are ignored.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> from sim_vehicle.autopilot import with_autopilot
    >>> quad = with_autopilot(get_vehicle("quad"), "px4")
    >>> predictor = OnwardPredictor(quad, LocalFrame(28.05, -82.15), (0.0, 0.0), altitude_m=10.0)
    >>> here = InFlight((50.0, 0.0), 10.0, (5.0, 0.0))
    >>> seconds, watt_hours = predictor.rest(here, [[(100.0, 0.0)], [(100.0, 0.0), (100.0, 100.0)]])
    >>> bool(0.0 < seconds[0] < seconds[1]), bool(watt_hours[0] < watt_hours[1])
    (True, True)
    """

    def __init__(
        self,
        spec: VehicleSpec,
        frame: LocalFrame,
        home_m: tuple[float, float],
        *,
        altitude_m: float,
        speed_m_s: float | None = None,
        waypoints: Callable[[NDArray[np.float64], tuple[float, float]], Waypoints] | None = None,
        ending: tuple[MissionItem, ...] = RETURN_HOME,
        wind: Wind | None = None,
    ) -> None:
        if not 0.0 < altitude_m < math.inf:
            raise VehicleError(f"altitude {altitude_m} m must be a finite number above zero")
        self.spec = spec
        self._altitude_m = altitude_m
        self._speed_m_s = min(speed_m_s or spec.cruise_speed_m_s, spec.top_speed_m_s)
        self._waypoints = waypoints or Cornering().waypoints
        latitude, longitude = frame.to_wgs84(*home_m)
        about_home = LocalFrame(latitude, longitude, frame.altitude_m)
        self.home_m = np.array(home_m)
        self._axes = _axes(frame, about_home, home_m)
        self._ending = ending
        self._ending_m = item_positions(ending, about_home)
        calm = None if wind is None else replace(wind, gust_m_s=0.0, turbulence=None)
        self._on_path = _Squadron(_stepping(spec, _PATH_STEPS if spec.hovers else 1), calm)
        self._on_return = _Squadron(_stepping(spec, _HOME_STEPS), calm) if spec.hovers else self._on_path
        # Time and energy of a return, by position and velocity at its start, rounded to about 1 m and 1 m/s.
        self._returns: dict[tuple[float, ...], tuple[float, float]] = {}

    def rest(
        self,
        state: InFlight,
        paths: Sequence[NDArray[np.float64] | Sequence[tuple[float, float]]],
        *,
        anew: Sequence[bool] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the time and the energy from here to the end of the mission, for each of several paths.

        Parameters
        ----------
        paths : sequence of float64[n, 2]
            Waypoints in the farm frame; an empty path is an immediate return.
        anew : sequence of bool, optional
            Whether each path differs from the path in flight; by default False. ArduPilot begins the first
            leg of a changed mission at the stopping point.

        Returns
        -------
        seconds, watt_hours : float64[number of paths]
            Infinite for a path that the vehicle cannot fly because of the wind; 0 Wh without a power model.

        Raises
        ------
        VehicleError
            If an argument is not finite.
        """
        here, velocity, heading = self._start(state)
        flights = [_Flight(self._through(state, here, np.asarray(path, dtype=np.float64))) for path in paths]
        self._on_path.place(flights, [(here, velocity, heading)] * len(flights))
        for flight, begins_anew in zip(flights, anew or [False] * len(flights), strict=True):
            if begins_anew:
                flight.motion.interrupt()
        self._on_path.fly(flights)
        if self._ending:
            self._fly_home([flight for flight in flights if flight.seconds < math.inf])
        return np.array([flight.seconds for flight in flights]), np.array(
            [flight.joules / WH_J for flight in flights]
        )

    def _start(self, state: InFlight) -> tuple[Position, Position, float]:
        """Return position and velocity relative to home (east, north, up), and the compass heading."""
        numbers = (*state.position_m, state.height_m, *state.velocity_m_s, state.climb_m_s)
        if not all(map(math.isfinite, numbers)):
            msg = f"vehicle {self.spec.name}: its position and velocity must be finite, not {numbers}"
            raise VehicleError(msg)
        x, y = product(self._axes, np.array(state.position_m) - self.home_m).tolist()
        east, north = product(self._axes, np.array(state.velocity_m_s)).tolist()
        heading = state.heading_rad
        if heading is None:
            heading = math.atan2(east, north)
        return (x, y, state.height_m), (east, north, state.climb_m_s), heading

    def _through(self, state: InFlight, here: Position, path: NDArray[np.float64]) -> Route | None:
        """Return the route through the waypoints of a path, or None for an empty path."""
        points = path.reshape(-1, 2)
        if not np.isfinite(points).all():
            raise VehicleError(f"vehicle {self.spec.name}: a path has a point that is not finite")
        if not len(points):
            return None
        sent = self._waypoints(points, state.position_m)
        points, radius_m = sent.points_m, sent.radius_m or self.spec.acceptance_radius_m
        count = len(points)
        places = np.empty((count, 3))
        places[:, :2] = product(points - self.home_m, self._axes.T)
        places[:, 2] = self._altitude_m
        if self.spec.circles:
            waypoint = MissionItem(
                Command.NAV_WAYPOINT, Frame.GLOBAL_RELATIVE_ALT, param2=radius_m, param4=None
            )
            items = ((waypoint,) * count) + self._ending
            positions = [(x, y, z) for x, y, z in places.tolist()] + self._ending_m
            plan = plan_item_legs(items, positions, 0, Settings(self._speed_m_s), self.spec, here)
            return Route.through(plan.legs)
        return Route.over(places, Leg(here, self._speed_m_s, radius_m))

    def _fly_home(self, flights: list[_Flight]) -> None:
        """Add flights home; multirotors at about the same position and velocity share one flight home."""
        if self._on_return is self._on_path:
            self._end(flights)
            return
        if len(self._returns) > _MAX_RETURNS:
            self._returns.clear()
        keys = []
        for flight in flights:
            end = flight.motion.snapshot()
            x, y, z = end.position_m
            keys.append((_outward(x), _outward(y), *(round(value) for value in (z, *end.velocity_m_s))))
        new = [key for key in dict.fromkeys(keys) if key not in self._returns]
        ways = [_Flight(None) for _ in new]
        states = [((x, y, z), (u, v, w), math.atan2(u, v)) for x, y, z, u, v, w in new]
        self._on_return.place(ways, states)
        self._end(ways)
        self._returns.update({key: (way.seconds, way.joules) for key, way in zip(new, ways, strict=True)})
        for flight, key in zip(flights, keys, strict=True):
            seconds, joules = self._returns[key]
            flight.seconds += seconds
            flight.joules += joules

    def _end(self, flights: list[_Flight]) -> None:
        """Fly the items after the last waypoint, one leg plan after another."""
        items = self._ending
        settings = Settings(self._speed_m_s, default_m_s=self._speed_m_s)
        seq = 0
        while flights:
            _, seq = do_items(items, seq, settings, self.spec.top_speed_m_s)
            if not 0 <= seq < len(items):
                return
            following = len(items)
            for flight in flights:
                here = flight.motion.position_m
                plan = plan_item_legs(items, self._ending_m, seq, settings.copy(), self.spec, here)
                flight.route, flight.wait_s = Route.through(plan.legs), plan.wait_s
                if plan.after_last in (AfterLastLeg.NEXT, AfterLastLeg.WAIT):
                    following = plan.seqs[-1] + 1
            self._on_return.fly(flights)
            seq = following
            flights = [flight for flight in flights if flight.seconds < math.inf]


def _outward(value_m: float) -> float:
    """Round a coordinate to half metres, away from home: a return from farther away may climb higher."""
    return math.copysign(math.ceil(2.0 * abs(value_m)) / 2.0, value_m)


class _Flight:
    """Flight along one path."""

    __slots__ = ("joules", "motion", "route", "seconds", "slot", "wait_s")

    motion: MotionModel

    def __init__(self, route: Route | None) -> None:
        # Next route, pause at the end of it, and index of the flight in the squadron.
        self.route = route
        self.wait_s = 0.0
        self.slot = 0
        # Time and energy used; infinite for a path that cannot be flown.
        self.seconds = self.joules = 0.0

    def mark_impossible(self) -> None:
        """Record that the vehicle cannot fly the path."""
        self.seconds = self.joules = math.inf


class _Squadron:
    """Motion models of one vehicle for repeated use, which are advanced in one batch."""

    def __init__(self, spec: VehicleSpec, wind: Wind | None) -> None:
        self._new: Callable[[], MotionModel] = lambda: flight_procedures(spec).motion(spec, wind, 0.0)
        self._step_s = spec.step_s
        self._motions: list[MotionModel] = []
        self._batch: VehicleBatch | None = None

    def place(self, flights: list[_Flight], states: Sequence[tuple[Position, Position, float]]) -> None:
        """Give each flight a motion model, placed in flight."""
        # The import is here because programs without predictions need no compiler.
        from sim_vehicle.motion.batch import VehicleBatch

        if len(flights) > len(self._motions):
            while len(self._motions) < len(flights):
                motion = self._new()
                motion.ignore_energy()
                self._motions.append(motion)
            self._batch = VehicleBatch(self._motions, parallel=True)
        for slot, (flight, state) in enumerate(zip(flights, states, strict=True)):
            motion = self._motions[slot]
            motion.place_in_flight(*state)
            flight.motion, flight.slot = motion, slot

    def fly(self, flights: list[_Flight]) -> None:
        """Fly each route to its end, and pause there."""
        if self._batch is None:
            return
        steps = np.zeros(len(self._motions), dtype=np.int64)
        flown = []
        for flight in flights:
            if flight.route is not None:
                flight.motion.fly(flight.route)
                steps[flight.slot] = round(_LONGEST_S / self._step_s)
                flown.append(flight)
        if not flown:
            return
        events = self._batch.advance(steps, stop_each=False)
        steps[:] = 0
        for flight in flown:
            if events[flight.slot] != MotionEvent.REACHED:
                flight.mark_impossible()
            elif flight.wait_s > 0.0:
                steps[flight.slot] = round(flight.wait_s / self._step_s)
        if steps.any():
            self._batch.advance(steps, stop_each=False)
        for flight in flown:
            if flight.seconds < math.inf:
                flight.seconds, flight.joules = flight.motion.time_s, flight.motion.energy_j


def _stepping(spec: VehicleSpec, steps: int) -> VehicleSpec:
    """Return the vehicle with `steps` times its time step; the ideal robot keeps its time step."""
    return spec if spec.is_ideal or steps == 1 else replace(spec, step_s=steps * spec.step_s)


def _axes(farm: LocalFrame, home: LocalFrame, home_m: tuple[float, float]) -> NDArray[np.float64]:
    """Return the matrix that rotates directions in the farm frame to east and north at home."""
    x, y = home_m
    latitude, longitude = farm.to_wgs84(np.array([x + _AXIS_M, x]), np.array([y, y + _AXIS_M]))
    east, north = home.from_wgs84(latitude, longitude)
    return np.array([east, north]) / _AXIS_M
