"""Many vehicles advanced in one compiled call, each along its own route, with the states of the single one.

The numbers of the vehicles are rows of arrays, ``[vehicle, number]``; the vehicles themselves keep views of
their rows, so that everything else (routes, parameters, positions) is done with them as ever. The loops below
call the kernels of the single vehicles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.arducopter.model import ArduCopter
from sim_vehicle.motion.ardurover.model import ArduRover
from sim_vehicle.motion.batch_loops import CALL, EVENT, EVERY, FIRST, LOOPS, STEPS, STOPS, WIND_ROWS
from sim_vehicle.motion.columns import STEP, WIND
from sim_vehicle.motion.fixed_wing.model import FixedWing
from sim_vehicle.motion.multirotor.model import Multirotor
from sim_vehicle.motion.px4.model import Px4Multirotor
from sim_vehicle.motion.rover.model import Rover

if TYPE_CHECKING:
    from collections.abc import Sequence
    from concurrent.futures import Executor

    from sim_vehicle.motion.model import MotionModel

__all__ = ["VehicleBatch"]

_SHARES = 16
_COMMON = ("state", "counters", "_limits", "_power", "track")


@dataclass(frozen=True, slots=True)
class _Law:
    """How a motion model's numbers are given to its loop.

    Parameters
    ----------
    loop : str
        Name of the loop.
    rows : tuple of str
        Attributes of the model that are arrays of one shape for all vehicles.
    route : str
        Attribute that is the route.
    """

    loop: str
    rows: tuple[str, ...] = _COMMON
    route: str = "_route"


_LAWS: dict[type, _Law] = {
    Multirotor: _Law("generic"),
    Px4Multirotor: _Law("px4", (*_COMMON, "guide", "_law", "_errors")),
    ArduCopter: _Law("arducopter", (*_COMMON, "guide", "law", "heads", "curves"), "_rows"),
    FixedWing: _Law("fixed-wing"),
    Rover: _Law("rover"),
    ArduRover: _Law("ardurover", (*_COMMON, "guide", "numbers", "heads", "curves"), "_rows"),
}


class VehicleBatch:
    """Vehicles that are advanced together.

    Parameters
    ----------
    vehicles : sequence of MotionModel
        One or more of the same class. Their arrays become views of the batch's. Of a class that has no loop
        here (`IdealRobot`), and a multirotor that is not flown by its autopilot at the moment, each is
        advanced on its own.
    pool : concurrent.futures.Executor, optional
        Threads that share the vehicles; they do not change the result.

    Raises
    ------
    VehicleError
        Without vehicles, or when they differ in class or in the length of their tracks.

    Examples
    --------
    >>> from sim_vehicle.motion.legs import Leg, Route
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> quads = [Multirotor(get_vehicle("quad")) for _ in range(3)]
    >>> for k, quad in enumerate(quads):
    ...     quad.fly(Route.through([Leg((10.0 * k, 0.0, 10.0), 5.0)]))
    >>> batch = VehicleBatch(quads)
    >>> batch.advance(10_000).tolist()
    [1, 1, 1]
    >>> [round(x) for x in batch.state[:, 0].tolist()], quads[2].step == int(batch.counters[2, 0])
    ([0, 10, 20], True)
    """

    def __init__(self, vehicles: Sequence[MotionModel], *, pool: Executor | None = None) -> None:
        if not vehicles or any(type(vehicle) is not type(vehicles[0]) for vehicle in vehicles):
            msg = "a batch needs one or more vehicles of the same kind and autopilot"
            raise VehicleError(msg)
        self.vehicles = tuple(vehicles)
        self._pool = pool
        # Estimates that are wrong are drawn as they are flown with, for each vehicle on its own.
        alone = any(isinstance(vehicle, Px4Multirotor) and vehicle.draws_errors for vehicle in vehicles)
        self._law = None if alone else _LAWS.get(type(vehicles[0]))
        self._tables: dict[str, NDArray[Any]] = {}
        self._views: dict[str, list[Any]] = {}
        count = len(self.vehicles)
        self._calls = np.zeros((count, CALL), dtype=np.int64)
        self._blocks: list[Any] = [None] * count
        self._wind: NDArray[np.float64] = np.zeros((count, 1, 1))
        self._routes: NDArray[np.float64] = np.zeros((0, 0))
        self._arrivals = np.zeros(0, dtype=np.int64)
        self._offsets = np.zeros(count + 1, dtype=np.int64)
        self._route_views: list[Any] = [None] * count
        self._arrival_views: list[Any] = [None] * count
        if self._law is not None:
            self._adopt()

    @property
    def state(self) -> NDArray[np.float64]:
        """The states of the vehicles, float64[B, STATE]: see the kernel of their class."""
        return self._tables["state"]

    @property
    def counters(self) -> NDArray[np.int64]:
        """The counters of the vehicles, int64[B, COUNTERS]."""
        return self._tables["counters"]

    def advance(
        self, max_steps: int | NDArray[np.int64], *, stop_each: bool | NDArray[np.bool_] = True
    ) -> NDArray[np.int64]:
        """Advance every vehicle as its own ``advance`` would.

        Parameters
        ----------
        max_steps : int or int64[B]
            0 leaves a vehicle where it is.
        stop_each : bool or bool[B]

        Returns
        -------
        int64[B]
            `MotionEvent` of each.
        """
        calls, events = self._calls, np.zeros(len(self.vehicles), dtype=np.int64)
        calls[:, STEPS], calls[:, STOPS] = max_steps, stop_each
        together: list[int] = []
        for k in np.flatnonzero(calls[:, STEPS] > 0).tolist():
            if self._law is not None and self._is_lawful(k):
                together.append(k)
            else:
                steps, stops = calls[k, STEPS : STOPS + 1].tolist()
                events[k] = self.vehicles[k].advance(steps, stop_each=bool(stops))
        if not together:
            return events
        self._adopt()
        members = np.array(together, dtype=np.int64)
        ends = self.counters[:, STEP] + calls[:, STEPS]
        while len(members):
            calls[members, STEPS] = ends[members] - self.counters[members, STEP]
            self._call(members)
            events[members] = calls[members, EVENT]
            members = members[events[members] == WIND]
            for k in members.tolist():
                series = self._vehicle(k)._wind
                series.forward()
                self._take_wind(k, series)
        return events

    def _vehicle(self, k: int) -> Any:
        return self.vehicles[k]

    def _is_lawful(self, k: int) -> bool:
        """Whether a vehicle has a route that the loop of its class flies."""
        vehicle = self._vehicle(k)
        if isinstance(vehicle, Px4Multirotor) and not vehicle._guided:
            return False
        assert self._law is not None
        return getattr(vehicle, self._law.route) is not None

    def _call(self, members: NDArray[np.int64]) -> None:
        assert self._law is not None
        loop = LOOPS[self._law.loop]
        rows = [self._tables[name] for name in self._law.rows]
        rest = (self._calls, self._offsets, self._routes, self._arrivals, self._wind, *rows)
        if self._pool is None or len(members) == 1:
            loop(members, *rest)
            return
        # More shares than threads, since some take longer than others.
        shares = np.array_split(members, min(len(members), _SHARES))
        for future in [self._pool.submit(loop, share, *rest) for share in shares]:
            future.result()

    def _adopt(self) -> None:
        """Make the rows of the batch what the vehicles have, and the vehicles' arrays views of them."""
        assert self._law is not None
        for name in self._law.rows:
            views = self._views.get(name)
            if views is None:
                self._take_table(name)
                continue
            for k, view in enumerate(views):
                vehicle = self._vehicle(k)
                own = getattr(vehicle, name)
                if own is not view:
                    if own.shape != view.shape:
                        self._take_table(name)
                        break
                    view[...] = own
                    setattr(vehicle, name, view)
        renewed = False
        for k in range(len(self.vehicles)):
            vehicle = self._vehicle(k)
            self._calls[k, EVERY] = vehicle.track_every
            series = vehicle._wind
            if series.block is not self._blocks[k]:
                self._take_wind(k, series)
            renewed |= getattr(vehicle, self._law.route) is not self._route_views[k]
            renewed |= vehicle.arrivals is not self._arrival_views[k]
        if renewed:
            self._take_routes()

    def _take_table(self, name: str) -> None:
        own = [getattr(self._vehicle(k), name) for k in range(len(self.vehicles))]
        if any(one.shape != own[0].shape for one in own):
            msg = f"a batch needs vehicles whose arrays have one shape: {name.strip('_')} differs"
            raise VehicleError(msg)
        table = np.empty((len(own), *own[0].shape), dtype=own[0].dtype)
        views = []
        for k, one in enumerate(own):
            # What a track will hold is not there yet.
            if name != "track" or self._vehicle(k).track_points:
                table[k] = one
            view = table[k]
            setattr(self.vehicles[k], name, view)
            views.append(view)
        self._tables[name], self._views[name] = table, views

    def _take_wind(self, k: int, series: Any) -> None:
        block = series.block
        rows, columns = block.shape
        if rows > self._wind.shape[1] or columns != self._wind.shape[2]:
            wind = np.zeros((len(self.vehicles), max(rows, self._wind.shape[1]), columns))
            if columns == self._wind.shape[2]:
                wind[:, : self._wind.shape[1]] = self._wind
            self._wind = wind
        self._wind[k, :rows] = block
        self._calls[k, WIND_ROWS], self._calls[k, FIRST] = rows, series.first
        self._blocks[k] = block

    def _take_routes(self) -> None:
        """Put the routes into one array, one after the other."""
        assert self._law is not None
        routes = [getattr(self._vehicle(k), self._law.route) for k in range(len(self.vehicles))]
        lengths = [0 if route is None else len(route) for route in routes]
        np.cumsum(lengths, out=self._offsets[1:])
        # A route of other dynamics has other columns: it is not flown here.
        columns = max((route.shape[1] for k, route in enumerate(routes) if self._is_lawful(k)), default=1)
        self._routes = np.zeros((int(self._offsets[-1]), columns))
        self._arrivals = np.zeros(int(self._offsets[-1]), dtype=np.int64)
        for k, route in enumerate(routes):
            vehicle = self._vehicle(k)
            part = slice(self._offsets[k], self._offsets[k + 1])
            self._route_views[k], self._arrival_views[k] = route, vehicle.arrivals
            if self._is_lawful(k):
                self._routes[part] = route
                self._arrivals[part] = vehicle.arrivals
                self._route_views[k], self._arrival_views[k] = self._routes[part], self._arrivals[part]
                setattr(vehicle, self._law.route, self._route_views[k])
                vehicle.arrivals = self._arrival_views[k]
