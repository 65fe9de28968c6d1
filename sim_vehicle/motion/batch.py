"""Batches of vehicles: one compiled call advances each vehicle along its route as if it were alone.

Arrays ``[vehicle, number]`` hold one row of numbers for each vehicle. Each vehicle keeps views of its rows,
so its routes, parameters and positions are used as without a batch. A loop calls each vehicle's kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.system import in_parallel
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.columns import STEP, WIND, Record, records_of
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_vehicle.motion.model import MotionModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Tables = tuple[Record, ...]

# Columns of a call of a vehicle's kernel. The arguments are steps, whether to stop at each leg, steps between
# track points, and number and first index of the wind rows. The last column is the returned event.
STEPS, STOPS, EVERY, WIND_ROWS, FIRST, EVENT = range(6)
CALL = 6


@compiled
def _row(table: Record, k: int) -> Record:
    """Return a vehicle's row; if the row is a record, return it as an array of length 1 for the kernel."""
    if table.ndim == 1:
        return table[k : k + 1]
    return table[k]


# These functions return the rows of a vehicle in the tables that only its kernel has. There is one function
# for each number of tables, because compiled code cannot loop over tables of different dimensions.
@compiled
def _none(own: Tables, k: int) -> Tables:
    return ()


@compiled
def _three(own: Tables, k: int) -> Tables:
    return _row(own[0], k), _row(own[1], k), _row(own[2], k)


@compiled
def _four(own: Tables, k: int) -> Tables:
    return _row(own[0], k), _row(own[1], k), _row(own[2], k), _row(own[3], k)


_ROWS = {0: _none, 3: _three, 4: _four}


@cache
def loop_of(dynamics: Dynamics) -> Callable[..., None]:
    """Return the compiled loop that calls the kernel for each of ``members``, the indices of vehicles.

    The arguments are call int64[B, CALL], routes and arrivals concatenated at ``offsets``, wind[B, n, 9], the
    rows of the vehicles, and the tables that only this kernel has. The first call compiles the loop.
    """
    advance, rows = dynamics.kernel, _ROWS[len(dynamics.own)]

    def loop(
        members: Integers,
        call: Integers,
        offsets: Integers,
        routes: Record,
        arrivals: Integers,
        wind: Floats,
        state: Record,
        counters: Integers,
        limits: Record,
        power: Floats,
        track: Floats,
        *own: Any,
    ) -> None:
        for k in members:
            begin, end = offsets[k], offsets[k + 1]
            call[k, EVENT] = advance(
                _row(state, k),
                counters[k],
                routes[begin:end],
                _row(limits, k),
                power[k],
                wind[k, : call[k, WIND_ROWS]],
                call[k, FIRST],
                call[k, STEPS],
                call[k, STOPS] != 0,
                arrivals[begin:end],
                track[k],
                call[k, EVERY],
                *rows(own, k),
            )

    loop.__qualname__ = f"loop_of_{advance.__module__}"
    return compiled(nogil=True)(loop)


class VehicleBatch:
    """Batch of vehicles that are advanced together.

    Parameters
    ----------
    vehicles : sequence of MotionModel
        One or more vehicles of the same class; their arrays become views of the batch's arrays. Each vehicle
        is advanced by a call of its own if the class has no loop here (`IdealRobot`), if any of the vehicles
        has estimate errors, or while the generic dynamics fly a multirotor.
    parallel : bool
        Whether threads share the work; the results do not depend on the threads.

    Raises
    ------
    VehicleError
        If there are no vehicles, or if their classes or track lengths differ.

    Examples
    --------
    >>> from sim_vehicle.motion.legs import Leg, Route
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> from sim_vehicle.motion.multirotor.model import Multirotor
    >>> quads = [Multirotor(get_vehicle("quad")) for _ in range(3)]
    >>> for k, quad in enumerate(quads):
    ...     quad.fly(Route.through([Leg((10.0 * k, 0.0, 10.0), 5.0)]))
    >>> batch = VehicleBatch(quads)
    >>> batch.advance(10_000).tolist()
    [1, 1, 1]
    >>> [round(x) for x in batch.state[:, 0].tolist()], quads[2].step == int(batch.counters[2, 0])
    ([0, 10, 20], True)
    """

    def __init__(self, vehicles: Sequence[MotionModel], *, parallel: bool = False) -> None:
        if not vehicles or any(type(vehicle) is not type(vehicles[0]) for vehicle in vehicles):
            raise VehicleError("a batch needs one or more vehicles of the same kind and autopilot")
        self.vehicles = tuple(vehicles)
        self._parallel = parallel
        # With estimate errors each vehicle is advanced alone, because it draws the errors during the flight.
        together = all(
            isinstance(vehicle, CompiledMotion) and not vehicle.draws_errors for vehicle in vehicles
        )
        dynamics = type(self._vehicle(0)).dynamics if together else None
        self._dynamics = dynamics if dynamics is not None and len(dynamics.own) in _ROWS else None
        self._tables: dict[str, NDArray[Any]] = {}
        self._views: dict[str, list[Any]] = {}
        count = len(self.vehicles)
        self._calls = np.zeros((count, CALL), dtype=np.int64)
        self._blocks: list[Any] = [None] * count
        self._wind: NDArray[np.float64] = np.zeros((count, 1, 1))
        self._routes: Record = np.zeros((0, 0))
        self._arrivals = np.zeros(0, dtype=np.int64)
        self._offsets = np.zeros(count + 1, dtype=np.int64)
        self._route_views: list[Any] = [None] * count
        self._arrival_views: list[Any] = [None] * count
        if self._dynamics is not None:
            self._adopt()

    @property
    def state(self) -> NDArray[np.float64]:
        """States of the vehicles, float64[B, STATE]; the kernel of their class defines STATE."""
        return self._tables["state"]

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counters of the vehicles, int64[B, COUNTERS]."""
        return self._tables["counters"]

    def advance(
        self, max_steps: int | NDArray[np.int64], *, stop_each: bool | NDArray[np.bool_] = True
    ) -> NDArray[np.int64]:
        """Advance every vehicle as the vehicle's `advance` would.

        Parameters
        ----------
        max_steps : int or int64[B]
            Number of steps; 0 leaves a vehicle unchanged.
        stop_each : bool or bool[B]

        Returns
        -------
        int64[B]
            `MotionEvent` of each vehicle.
        """
        calls, events = self._calls, np.zeros(len(self.vehicles), dtype=np.int64)
        calls[:, STEPS], calls[:, STOPS] = max_steps, stop_each
        together: list[int] = []
        alone: list[int] = []
        for k in np.flatnonzero(calls[:, STEPS] > 0).tolist():
            shared = self._dynamics is not None and self._vehicle(k).is_flown_by_its_autopilot()
            (together if shared else alone).append(k)

        def advance_alone(members: Sequence[int]) -> None:
            for k in members:
                steps, stops = calls[k, STEPS : STOPS + 1].tolist()
                events[k] = self.vehicles[k].advance(steps, stop_each=bool(stops))

        if self._parallel:
            in_parallel(advance_alone, alone)
        else:
            advance_alone(alone)
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

    def _call(self, members: NDArray[np.int64]) -> None:
        assert self._dynamics is not None
        loop = loop_of(self._dynamics)
        rows = [
            self._tables[name] if kind is None else records_of(self._tables[name], kind)
            for name, kind in self._dynamics.rows.items()
        ]
        rest = (self._calls, self._offsets, self._routes, self._arrivals, self._wind, *rows)
        if self._parallel:
            in_parallel(lambda share: loop(np.array(share), *rest), members.tolist())
        else:
            loop(members, *rest)

    def _adopt(self) -> None:
        """Copy the vehicles' arrays into the batch's rows, and replace the arrays by views of these rows."""
        assert self._dynamics is not None
        for name in self._dynamics.rows:
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
            renewed |= getattr(vehicle, self._dynamics.route) is not self._route_views[k]
            renewed |= vehicle.arrivals is not self._arrival_views[k]
        if renewed:
            self._take_routes()

    def _take_table(self, name: str) -> None:
        own = [getattr(self._vehicle(k), name) for k in range(len(self.vehicles))]
        if any(array.shape != own[0].shape for array in own):
            msg = f"a batch needs vehicles whose arrays have one shape: {name.strip('_')} differs"
            raise VehicleError(msg)
        table = np.empty((len(own), *own[0].shape), dtype=own[0].dtype)
        views = []
        for k, array in enumerate(own):
            # Only a track that has points must be copied.
            if name != "track" or self._vehicle(k).track_points:
                table[k] = array
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
        """Concatenate the routes in one array."""
        assert self._dynamics is not None
        routes = [getattr(self._vehicle(k), self._dynamics.route) for k in range(len(self.vehicles))]
        lengths = [0 if route is None else len(route) for route in routes]
        np.cumsum(lengths, out=self._offsets[1:])
        # Routes of other dynamics have other columns; the loop does not fly them.
        flown = [k for k in range(len(routes)) if self._vehicle(k).is_flown_by_its_autopilot()]
        if flown:
            columns = routes[flown[0]].shape[1:]
            self._routes = np.zeros((int(self._offsets[-1]), *columns), dtype=routes[flown[0]].dtype)
        self._arrivals = np.zeros(int(self._offsets[-1]), dtype=np.int64)
        for k, route in enumerate(routes):
            vehicle = self._vehicle(k)
            part = slice(self._offsets[k], self._offsets[k + 1])
            self._route_views[k], self._arrival_views[k] = route, vehicle.arrivals
            if k in flown:
                self._routes[part] = route
                self._arrivals[part] = vehicle.arrivals
                self._route_views[k], self._arrival_views[k] = self._routes[part], self._arrivals[part]
                setattr(vehicle, self._dynamics.route, self._route_views[k])
                vehicle.arrivals = self._arrival_views[k]
