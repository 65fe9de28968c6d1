"""Decisions for a fleet: a search finds routes for each vehicle, and a coordination assigns them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.named import ParameterError
from mission.planners.path import Points, path_length
from mission.policies.acquisition import Acquisition, ValueMap
from mission.policies.decision import AcquisitionMap, Alternative, Decision
from mission.policies.observation import ContactArea, Event, PolicyObservation, Status, VehicleReport
from mission.policies.planning_grid import LegCosts, PlanningGrid
from mission.policies.route_search import take_leg

_LEAST_LEG = 1e-3  # A leg is cut only after a piece of this length (m)
_PRICED_TOGETHER = 4  # Number of paths whose costs are predicted in one call.
_STAY: Points = np.empty((0, 2))
_KEEPS_PATH = (Status.READY, Status.CLIMBING, Status.FLYING, Status.CHANGING, Status.SILENT)
_OUT_BY_BACK, _MOST_ONWARD = 6.0, 12
"""For routes that end beyond radio contact: least length as a multiple of the distance back to contact, and
greatest number of searches that extend the route."""
_MOST_BY_BUDGET = 200
"""Greatest number of searches that extend a route if there is no radio contact anywhere."""


@dataclass(frozen=True, slots=True, eq=False)
class Bid:
    """A vehicle's best path, given the paths that are promised to the other vehicles."""

    points_m: Points  # Points of the path in metres of the farm frame, float64[n, 2].
    value: float  # Expected value, in the policy's own measure.
    share: float  # Cost as a fraction of the vehicle's remaining budget.

    @property
    def rate(self) -> float:
        """Value per fraction of the remaining budget."""
        return self.value / self.share if self.share > 0.0 else float("inf")


Promised: TypeAlias = Mapping[int, Points]
"""Paths of vehicles by system id; cells along a path have no value for other vehicles."""
Bidder: TypeAlias = Callable[[VehicleReport, Promised], Bid | None]
"""Function that finds a vehicle's best path, given the promised paths of other vehicles."""
Coordination: TypeAlias = Callable[[Sequence[VehicleReport], Promised, Bidder], dict[int, Points]]
"""Function that returns new paths, given all current paths. A vehicle without a new path keeps its path."""


def sequential(vehicles: Sequence[VehicleReport], present: Promised, bidder: Bidder) -> dict[int, Points]:
    """Let the vehicles choose in turn, given the new or current paths of all other vehicles.

    If a cell has the same value for every vehicle, and a second observation of the cell has none, the result
    has at least half of the optimal value (sequential allocation: Singh et al. 2009; Fisher, Nemhauser and
    Wolsey 1978).
    """
    promised, chosen = dict(present), {}
    for vehicle in vehicles:
        bid = bidder(vehicle, promised)
        if bid is not None:
            promised[vehicle.system_id] = chosen[vehicle.system_id] = bid.points_m
    return chosen


def auction(vehicles: Sequence[VehicleReport], present: Promised, bidder: Bidder) -> dict[int, Points]:
    """Assign paths in the order of `Bid.rate`, by repeated auctions.

    All vehicles first give up their current paths. In each auction every vehicle without a new path bids, the
    bid with the best rate wins, and its path is promised. Bids can only fall, so a bid from an earlier
    auction is computed again only if it would win (Minoux 1978). A vehicle without a bid keeps its path. The
    result has the same bound as with `sequential`, but the order does not depend on the system ids.
    """
    bidding = {vehicle.system_id: vehicle for vehicle in vehicles}
    promised = {number: path for number, path in present.items() if number not in bidding}
    chosen: dict[int, Points] = {}
    bids: dict[int, tuple[int, Bid]] = {}
    sold = 0
    for number, vehicle in list(bidding.items()):
        bid = bidder(vehicle, promised)
        if bid is not None:
            bids[number] = sold, bid
    while bids:
        number = max(bids, key=lambda bidder_id: (bids[bidder_id][1].rate, -bidder_id))
        asked, bid = bids[number]
        if asked == sold:
            promised[number] = chosen[number] = bid.points_m
            del bids[number]
            sold += 1
            continue
        again = bidder(bidding[number], promised)
        if again is None:
            del bids[number]
        else:
            bids[number] = sold, again
    return chosen


COORDINATIONS: dict[str, Coordination] = {"sequential": sequential, "auction": auction}


def make_coordination(coordination: str | Coordination) -> Coordination:
    """Return the coordination with this name in `COORDINATIONS`; return a callable unchanged."""
    if callable(coordination):
        return coordination
    found = COORDINATIONS.get(str(coordination))
    if found is None:
        raise ParameterError(f"coordination {coordination!r}: give {' or '.join(COORDINATIONS)}")
    return found


@dataclass(frozen=True, slots=True, eq=False)
class RouteProblem:
    """Input of a search for a vehicle's route. Lengths are in cells of the planning grid."""

    vehicle: VehicleReport
    planning_grid: PlanningGrid
    values: ValueMap  # Acquisition values that the other vehicles' routes leave, float32[w, h].
    shares: NDArray[np.float32]  # Fractions of value that an observation removes, see `neighbour_shares`.
    costs: LegCosts
    x: float  # Position of the vehicle: x and y
    y: float


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A route and its value."""

    corners: NDArray[np.float64]  # Corners in cells of the planning grid, float64[n, 2]
    value: float


Search: TypeAlias = Callable[[RouteProblem], Sequence[Route]]
"""Function that finds routes, best first."""


@dataclass(slots=True)
class Steering:
    """Makes decisions for a fleet: searches for routes, and assigns them by a `Coordination`."""

    acquisition: Acquisition
    shares: NDArray[np.float32]  # Neighbour shares, see `mission.policies.route_search.neighbour_shares`
    coordination: Coordination = sequential
    _grids: dict[int, PlanningGrid] = field(default_factory=dict, init=False)
    _drawn: dict[tuple[bytes, float], PlanningGrid] = field(default_factory=dict, init=False)

    def start(self) -> None:
        """Clear the planning grids of the previous run."""
        self._grids, self._drawn = {}, {}

    def decide(self, observation: PolicyObservation, search: Search, reason: str) -> Decision:
        """Search for new routes of all steerable vehicles.

        A vehicle without an affordable route keeps its path, or stays on the ground at the start.
        """
        values = self.acquisition(observation)
        found: dict[int, list[Alternative]] = {}
        pooled: dict[PlanningGrid, ValueMap] = {}

        def bid(vehicle: VehicleReport, promised: Promised) -> Bid | None:
            planning_grid = self._grid(observation, vehicle)
            if planning_grid not in pooled:
                pooled[planning_grid] = planning_grid.pooled(values)
            problem = self._problem(
                vehicle, planning_grid, pooled[planning_grid].copy(), observation, promised
            )
            routes = search(problem)
            contact = vehicle.contact
            # If there is no contact anywhere, the vehicle can receive only its first path.
            if contact and routes and (observation.event is Event.START or not contact.is_nowhere):
                routes = [_out_and_back(problem, routes[0], search, contact), *routes[1:]]
            paths = [
                planning_grid.inside(vehicle.position_m, route.corners * planning_grid.cell_m)
                for route in routes
            ]
            mine = []
            for route, points, cost in zip(routes, paths, vehicle.travel_cost.rest(paths), strict=True):
                if cost > most_payable(vehicle):
                    points = affordable(vehicle, points)
                    cost = vehicle.travel_cost.rest([points])[0]
                if len(points):
                    mine.append(Alternative(vehicle.system_id, points, route.value, cost))
            found[vehicle.system_id] = mine
            if not mine:
                return None
            best = mine[0]
            if observation.event is not Event.ENDING and not _pays_for_change(problem, best.points_m):
                return None
            return Bid(best.points_m, best.value, best.cost / vehicle.left if vehicle.left > 0.0 else 1.0)

        present = {
            vehicle.system_id: vehicle.rest_m
            for vehicle in observation.vehicles
            if vehicle.status in _KEEPS_PATH and len(vehicle.rest_m)
        }
        paths = self.coordination(observation.steerable, present, bid)
        if observation.event is Event.START:
            steerable = [vehicle.system_id for vehicle in observation.steerable]
            paths = {number: paths.get(number, _STAY) for number in steerable}
        alternatives = tuple(itertools.chain.from_iterable(found.values()))
        return Decision(paths, reason=reason, alternatives=alternatives, acquisition=_joined(pooled))

    def _grid(self, observation: PolicyObservation, vehicle: VehicleReport) -> PlanningGrid:
        planning_grid = self._grids.get(vehicle.system_id)
        if planning_grid is None:
            # Vehicles with the same area share a planning grid, so that its values are pooled only once.
            request, shape = vehicle.request, observation.model.shape
            area = request.area.wkb, request.footprint_m
            if area not in self._drawn:
                drawn = PlanningGrid.of(
                    request.area, shape, observation.farm.cell_size_m, request.footprint_m
                )
                self._drawn[area] = drawn
            planning_grid = self._grids[vehicle.system_id] = self._drawn[area]
        return planning_grid

    def _problem(
        self,
        vehicle: VehicleReport,
        planning_grid: PlanningGrid,
        values: ValueMap,
        observation: PolicyObservation,
        planned: Promised,
    ) -> RouteProblem:
        shares = planning_grid.shares(self.shares)
        for other in observation.vehicles:
            route = planned.get(other.system_id)
            if other.system_id == vehicle.system_id or route is None:
                continue
            corners = np.vstack((np.asarray(other.position_m)[None], route)) / planning_grid.cell_m
            for begin, end in itertools.pairwise(corners):
                take_leg(values, shares, *begin, *end)
        x, y = vehicle.position_m[0] / planning_grid.cell_m, vehicle.position_m[1] / planning_grid.cell_m
        return RouteProblem(
            vehicle, planning_grid, values, shares, LegCosts.of(vehicle, planning_grid.cell_m), x, y
        )


def _joined(maps: Mapping[PlanningGrid, ValueMap]) -> AcquisitionMap | None:
    """Return the maps of all vehicles joined into one map, or None if there are no maps."""
    if not maps:
        return None
    cell_m = next(iter(maps)).cell_m
    # Maps whose blocks differ from the first map's in size (other footprints) cannot be joined.
    alike = [values for grid, values in maps.items() if grid.cell_m == cell_m]
    return AcquisitionMap(alike[0] if len(alike) == 1 else np.maximum.reduce(alike), cell_m)


def _pays_for_change(problem: RouteProblem, points_m: Points) -> bool:
    """Return whether a new path gains more value than the current path at the same cost, change included."""
    vehicle, cell_m = problem.vehicle, problem.planning_grid.cell_m
    price = vehicle.travel_cost.change(points_m)
    if price <= 0.0:
        return True
    here = np.asarray(vehicle.position_m)[None]
    stays, leaves = np.vstack((here, vehicle.rest_m)), np.vstack((here, points_m))
    length = np.hypot(*np.diff(stays / cell_m, axis=0).T).sum()
    lasts = len(vehicle.rest_m) * problem.costs.turn + float(length) * problem.costs.per_cell
    gains = []
    for path, budget in ((stays, lasts), (leaves, lasts - price)):
        left = problem.values.copy()
        for begin, end in itertools.pairwise(path / cell_m):
            cost = problem.costs.turn + float(np.hypot(*(end - begin))) * problem.costs.per_cell
            share = min(1.0, budget / cost) if cost > 0.0 else 1.0
            if share <= 0.0:
                break
            take_leg(left, problem.shares, *begin, *(begin + share * (end - begin)))
            budget -= cost
        gains.append(float(problem.values.sum(dtype=np.float64) - left.sum(dtype=np.float64)))
    return gains[1] > gains[0]


def _out_and_back(problem: RouteProblem, first: Route, search: Search, contact: ContactArea) -> Route:
    """Return a route that starts with the route `first` and ends within radio contact.

    Beyond contact the vehicle cannot receive a new path, so it would fly home at the end of the route.
    Further routes are therefore appended until the way back is short compared with the route; the value that
    earlier routes observe does not count again. If there is no contact anywhere, routes are appended until
    the budget is used up.
    """
    cell_m, costs = problem.planning_grid.cell_m, problem.costs
    route, left = Route(np.array([[problem.x, problem.y]]), 0.0), problem.values.copy()
    onward = [first]
    for _ in range(_MOST_BY_BUDGET if contact.is_nowhere else _MOST_ONWARD):
        for begin, end in itertools.pairwise(np.vstack((route.corners[-1:], onward[0].corners))):
            take_leg(left, problem.shares, *begin, *end)
        route = Route(np.vstack((route.corners, onward[0].corners)), route.value + onward[0].value)
        length = path_length(route.corners)
        # An approximate cost is enough here: the exact cost takes longer, and is computed once at the end.
        if length * costs.per_cell + (len(route.corners) - 1) * costs.turn > problem.vehicle.left:
            break
        away_m = contact.away_m(route.corners[-1] * cell_m)
        if not contact.is_nowhere and (away_m == 0.0 or length * cell_m > _OUT_BY_BACK * away_m):
            break
        x, y = route.corners[-1].tolist()
        onward = list(search(replace(problem, values=left.copy(), x=x, y=y)))
        if not onward:
            break
    back = _STAY if contact.is_nowhere else _nearest_in(contact, problem.planning_grid, route.corners[-1])
    return Route(np.vstack((route.corners[1:], back)), route.value)


def _nearest_in(contact: ContactArea, grid: PlanningGrid, corner: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest position with contact that a straight leg can reach from the corner (in cells).

    The result is float64[1, 2], or float64[0, 2] if the corner itself has contact or no leg reaches contact.
    """
    if contact.away_m(corner * grid.cell_m) == 0.0:
        return _STAY
    places = np.argwhere(grid.free).astype(np.float64) + 0.5
    apart = np.hypot(*(places * grid.cell_m - contact.center_m).T)
    within: NDArray[np.float64] = places[apart <= max(contact.radius_m, float(apart.min()))]
    order = np.argsort(np.hypot(*(within - corner).T), kind="stable")
    x_m, y_m = (corner * grid.cell_m).tolist()
    for k in order:
        if len(grid.inside((x_m, y_m), within[k : k + 1] * grid.cell_m)):
            return within[k : k + 1]
    return _STAY


def far_route(problem: RouteProblem) -> list[Route]:
    """Return the straight leg to the cell with the most value per distance; no route if all values are 0.

    Policies whose search has a limited range use this leg if no value is left near the vehicle.
    """
    x, y = np.indices(problem.values.shape) + 0.5
    rates = problem.values / (np.hypot(x - problem.x, y - problem.y) + 1.0)
    best = np.unravel_index(int(np.argmax(rates)), rates.shape)
    value = float(problem.values[best])
    return [Route(np.array([[x[best], y[best]]]), value)] if value > 0.0 else []


def most_payable(vehicle: VehicleReport) -> float:
    """Return the vehicle's remaining budget plus a margin for rounding."""
    return vehicle.left * (1.0 + 1e-12)


def affordable(vehicle: VehicleReport, points_m: Points) -> Points:
    """Return the first part of a path that the remaining budget allows; it may be empty or end amid a leg."""
    if not len(points_m):
        return points_m
    left = most_payable(vehicle)
    if vehicle.travel_cost.rest([points_m])[0] <= left:
        return points_m
    count = _last_payable([points_m[:count] for count in range(len(points_m))], vehicle)
    if count is None:
        return points_m[:0]
    begin = points_m[count - 1] if count else np.asarray(vehicle.position_m)
    step = points_m[count] - begin
    parts = np.linspace(1.0 / 16.0, 15.0 / 16.0, 15)
    cut = [np.vstack((points_m[:count], begin + part * step)) for part in parts]
    payable = _last_payable(cut, vehicle)
    if payable is None or np.hypot(*(parts[payable] * step)) < _LEAST_LEG:
        return points_m[:count]
    return cut[payable]


def _last_payable(paths: Sequence[Points], vehicle: VehicleReport) -> int | None:
    """Return the index of the last path that the remaining budget allows; None if there is no such path."""
    # Costs are predicted in small groups, from the last path on, because predictions take most of the time.
    left = most_payable(vehicle)
    for end in range(len(paths), 0, -_PRICED_TOGETHER):
        first = max(0, end - _PRICED_TOGETHER)
        payable = np.flatnonzero(np.asarray(vehicle.travel_cost.rest(paths[first:end])) <= left)
        if len(payable):
            return first + int(payable[-1])
    return None
