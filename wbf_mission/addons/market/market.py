"""Market policy: vehicles trade survey segments, coarse at first, fine around detections.

Source: the exploration packages, pioneers and contractors of ``papers/y2025_mrmr`` and ``papers/y2027_mrmr``
(multi-resolution multi-robot) of the authors' repository WaterberryFarms; the contract net of R. G. Smith,
IEEE Transactions on Computers C-29, 1980.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from geo.seeds import stream
from mission.errors import PlanningError
from mission.planners.path import Points
from mission.planners.terrain import TOLERANCE_M, Terrain, draw_places
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, PolicyObservation, Status, VehicleReport, pays_for_return
from mission.policies.planning_grid import LegCosts
from mission.policies.policy import LEAST_S, Triggers
from mission.policies.steering import affordable
from wbf_mission.addons.market.auction import Bidder, hold_auction, leg_costs, path_cost
from wbf_mission.addons.market.segments import SHORTEST_M, Detections, Row, Segment, blocks_of, rows_over

_SAME_M = 0.1
_ROW_POINTS = 2
NO_POINTS: Points = np.empty((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Part of a path: a row and the way to this row, or a leg to a random place."""

    segment: Segment | None  # None for a leg to a random place
    row: int  # Index of the row in the segment
    # float64[n, 2]: the way, then the row's two ends (only the far end if the vehicle is at the near end).
    points_m: Points


@dataclass(slots=True, eq=False)
class Contract:
    """Path of one vehicle, and the segments it serves."""

    stretches: tuple[Stretch, ...]  # In order of flight
    points_m: Points  # float64[n, 2]: the path as sent; its last leg may be shortened
    under_way: Segment | None = None  # First segment, if it was partly flown before this contract
    _left: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._left = len(self.points_m)

    def follow(self, rest_m: Points) -> bool:
        """Update the progress from the vehicle's remaining path; return False if it flies another path."""
        count = min(len(rest_m), len(self.points_m))
        mine, flown = self.points_m[len(self.points_m) - count :], rest_m[len(rest_m) - count :]
        if not np.allclose(mine, flown, rtol=0.0, atol=_SAME_M):
            return False
        self._left = count
        return True

    @property
    def ahead(self) -> list[tuple[Stretch, int]]:
        """Stretches not fully flown, each with its number of remaining points."""
        found = []
        end = len(self.points_m)
        passed = end - self._left
        begin = 0
        for stretch in self.stretches:
            stop = begin + len(stretch.points_m)
            left = min(stop - max(begin, passed), end - begin)
            if stop > passed and begin < end and left > 0:
                found.append((stretch, left))
            begin = stop
        return found

    @property
    def begun(self) -> Segment | None:
        """Segment that is partly flown."""
        ahead = self.ahead
        if not ahead:
            return None
        stretch, left = ahead[0]
        first = next(one for one in self.stretches if one.segment is stretch.segment)
        whole = stretch is first and left == len(stretch.points_m)
        return None if whole and stretch.segment is not self.under_way else stretch.segment

    def work(self) -> Points:
        """Return the remaining points of all segments, float64[n, 2]."""
        parts = [one.points_m[-left:] for one, left in self.ahead if one.segment is not None]
        return np.concatenate(parts) if parts else NO_POINTS

    def unflown(self, here_m: tuple[float, float] | None = None) -> list[Segment]:
        """Return the segments with their remaining rows; a row that is partly flown starts at `here_m`."""
        rows: dict[int, dict[int, Row]] = {}
        segments: dict[int, Segment] = {}
        for stretch, left in self.ahead:
            if stretch.segment is None:
                continue
            row = stretch.segment.rows[stretch.row]
            if left < _ROW_POINTS and here_m is not None:
                row = _rest_of(row, stretch.points_m[-1], here_m)
            if np.hypot(*(row.ends_m[1] - row.ends_m[0])) <= SHORTEST_M:
                continue
            segments[stretch.segment.number] = stretch.segment
            rows.setdefault(stretch.segment.number, {})[stretch.row] = row
        return [
            replace(segment, rows=tuple(rows[number][k] for k in sorted(rows[number])))
            for number, segment in segments.items()
        ]


def _rest_of(row: Row, end_m: Points, here_m: tuple[float, float]) -> Row:
    """Return the unflown rest of a row, which a vehicle at `here_m` flies towards `end_m`."""
    low, high = row.ends_m
    along = high - low
    share = float(np.clip(((np.asarray(here_m) - low) * along).sum() / (along * along).sum(), 0.0, 1.0))
    here = low + share * along
    towards_high = np.hypot(*(end_m - high)) < np.hypot(*(end_m - low))
    return Row(np.stack((here, high)) if towards_high else np.stack((low, here)), row.line)


_NAME = "market"
_MOST_LEGS = 40
_AT_CELLS = 0.5
_KEEP = (Status.READY, Status.CLIMBING, Status.CHANGING, Status.SILENT)


class Market:
    """Award survey segments to the vehicles that can finish them first.

    At the start, coarse segments (blocks with wide row spacing) are auctioned. When a group of detections of
    sick plants is complete, a fine segment (with narrow row spacing) is made around them. Then all fine
    segments not yet begun are auctioned again, and after these all unflown rows of the coarse segments.
    The loss of a vehicle also starts a new auction. A vehicle without work flies to random places.

    Parameters
    ----------
    border : float
        Margin of a fine segment around its detections, cells.
    step : float
        Row spacing of a fine segment, cells.
    pioneers : int
        Number of vehicles (those with the lowest ids) that get no fine segments if there are other vehicles.
    field : str
        Disease of the detections; ``all``: every scored disease.
    below : float
        Upper limit of a detection's value; the default includes lost plants (0), not infected plants (0.5).
    explore : float
        Fraction of the fleet's budget for the coarse segments, between 0 and 1.
    blocks : int
        Number of coarse segments per vehicle.
    every : int
        Number of observations between two searches for detections.

    Raises
    ------
    PlanningError
        If a parameter is out of its range.
    """

    def __init__(
        self,
        border: float = 3.0,
        step: float = 2.0,
        pioneers: int = 1,
        field: str = "tylcv",
        below: float = 0.25,
        explore: float = 0.5,
        blocks: int = 4,
        every: int = 5,
    ) -> None:
        if not 0.0 < explore < 1.0:
            raise PlanningError(f"{_NAME}: explore must be between 0 and 1, not {explore!r}")
        for name, value in (("step", step), ("blocks", blocks), ("every", every)):
            if not value > 0:
                raise PlanningError(f"{_NAME}: {name} must be above zero, not {value!r}")
        self._explore, self._blocks = float(explore), int(blocks)
        self._pioneers = int(pioneers)
        self.triggers = Triggers(observations=int(every), least_s=LEAST_S)
        self._detections = Detections(float(border), float(step), field, float(below), _NAME)
        self.start()

    def start(self) -> None:
        """Reset the policy for a new run."""
        self._detections.start()
        self._day: int | None = None
        self._contracts: dict[int, Contract] = {}
        self._open: list[Segment] = []
        self._terrains: dict[int, Terrain] = {}
        self._streams: dict[int, np.random.Generator] = {}

    def decide(self, observation: PolicyObservation) -> Decision:
        """Hold an auction if a segment is new or was returned, a vehicle has no work, or a path ends."""
        spacing: dict[int, float] = {}
        if observation.event is Event.START:
            self._begin_flight(observation.day)
            spacing = self._divide(observation)
            returned = True
        else:
            returned = self._settle(observation)
        terrains = [self._terrain(one) for one in observation.steerable]
        found = self._detections.segments(observation, terrains, self._fine_ahead())
        self._open += found
        contracts = [self._contracts.get(vehicle.system_id) for vehicle in observation.steerable]
        idle = self._open and any(contract is None or not len(contract.work()) for contract in contracts)
        if not (found or returned or idle or observation.event is Event.ENDING):
            return NO_CHANGE
        paths = self._trade(observation)
        if not paths:
            return NO_CHANGE
        reason = "coarse survey" if spacing else "segments around detections" if found else "new auction"
        return Decision(paths, reason=reason, spacing_m=spacing)

    def _begin_flight(self, day: int) -> None:
        """Keep the unflown fine segments of the previous flight if this flight is on the same day."""
        left = [*self._open]
        for contract in self._contracts.values():
            left += contract.unflown()
        self._contracts, self._open = {}, []
        if day == self._day:
            self._open = [segment for segment in left if segment.fine]
        else:
            self._detections.begin_day()
        self._day = day

    def _divide(self, observation: PolicyObservation) -> dict[int, float]:
        """Offer the coarse segments of every area; return each vehicle's row spacing."""
        spacings: dict[int, float] = {}
        vehicles = list(observation.steerable)
        while vehicles:
            same = [vehicle for vehicle in vehicles if vehicle.request.area == vehicles[0].request.area]
            vehicles = [vehicle for vehicle in vehicles if vehicle not in same]
            flyable, footprint = self._terrain(same[0]).flyable, same[0].request.footprint_m
            cell_m = observation.farm.cell_size_m
            reach = sum(one.left * cell_m / LegCosts.of(one, cell_m).per_cell for one in same)
            spacing = max(flyable.area / (self._explore * reach), footprint, TOLERANCE_M)
            for box in blocks_of(flyable, self._blocks * len(same)):
                rows = rows_over(box, flyable, spacing)
                if rows:
                    self._open.append(Segment(self._detections.next_number(), False, box, rows))
            spacings |= {one.system_id: spacing for one in same}
        return spacings

    def _settle(self, observation: PolicyObservation) -> bool:
        """Update the progress of all contracts; return whether segments were returned to the market."""
        returned: list[Segment] = []
        for vehicle in observation.vehicles:
            contract = self._contracts.get(vehicle.system_id)
            if contract is None or vehicle.status in _KEEP:
                continue
            # A lost vehicle may report no remaining path; then the progress that was last known counts.
            silent = vehicle.status is Status.LOST and not len(vehicle.rest_m)
            follows = silent or contract.follow(vehicle.rest_m)
            if vehicle.status is Status.FLYING and follows:
                continue
            returned += contract.unflown(vehicle.position_m)
            del self._contracts[vehicle.system_id]
        self._open += returned
        return bool(returned)

    def _fine_ahead(self) -> list[Segment]:
        """Return the fine segments not yet flown."""
        sold = [one.segment for contract in self._contracts.values() for one, _ in contract.ahead]
        return [segment for segment in [*self._open, *sold] if segment is not None and segment.fine]

    def _trade(self, observation: PolicyObservation) -> dict[int, Points]:
        """Auction all segments that are not begun; return the paths of vehicles whose work has changed."""
        vehicles = observation.steerable
        kept: dict[int, list[Stretch]] = {vehicle.system_id: [] for vehicle in vehicles}
        for vehicle in vehicles:
            contract = self._contracts.get(vehicle.system_id)
            if contract is None:
                continue
            unflown, begun = contract.unflown(vehicle.position_m), contract.begun
            if begun is not None and begun.fine:  # The vehicle keeps and finishes this segment.
                unflown = [segment for segment in unflown if segment.number != begun.number]
                kept[vehicle.system_id] = [
                    Stretch(begun, stretch.row, stretch.points_m[-left:])
                    for stretch, left in contract.ahead
                    if stretch.segment is begun
                ]
            self._open += unflown
        segments = sorted(self._open, key=lambda segment: segment.number)
        bidders = [self._bidder(one, segments, kept[one.system_id]) for one in vehicles]
        fine = [k for k, segment in enumerate(segments) if segment.fine]
        coarse = [k for k, segment in enumerate(segments) if not segment.fine]
        pioneers = sorted(vehicle.system_id for vehicle in observation.vehicles)[: self._pioneers]
        contractors = [bidder for bidder in bidders if bidder.system_id not in pioneers]
        unsold = hold_auction(contractors or bidders, fine) + hold_auction(bidders, coarse)
        self._open = [segments[k] for k in unsold]
        paths: dict[int, Points] = {}
        for vehicle, bidder in zip(vehicles, bidders, strict=True):
            awarded = [(segments[k], variant) for k, variant in bidder.route]
            points = self._sign(observation, vehicle, kept[vehicle.system_id], awarded)
            if points is not None:
                paths[vehicle.system_id] = points
        return paths

    def _bidder(self, vehicle: VehicleReport, segments: Sequence[Segment], kept: list[Stretch]) -> Bidder:
        flyable = shapely.buffer(self._terrain(vehicle).flyable, TOLERANCE_M)
        rows = [shapely.multilinestrings([row.ends_m for row in segment.rows]) for segment in segments]
        first = np.concatenate([np.asarray(vehicle.position_m)[None], *(one.points_m for one in kept)])
        return Bidder(
            vehicle.system_id,
            vehicle.travel_cost,
            segments,
            [bool(shapely.covers(flyable, one)) for one in rows],
            first[-1],
            vehicle.request.start_xy_m,
            path_cost(vehicle.travel_cost, first),
            vehicle.left,
            returns=pays_for_return(vehicle),
        )

    def _sign(
        self,
        observation: PolicyObservation,
        vehicle: VehicleReport,
        kept: list[Stretch],
        awarded: list[tuple[Segment, int]],
    ) -> Points | None:
        """Return the path for the awarded segments; None if the vehicle already flies this path.

        Segments that turn out to exceed the budget are offered again.
        """
        stretches = kept + self._stretches(observation, vehicle, kept, awarded)
        before = self._contracts.get(vehicle.system_id)
        work = affordable(vehicle, _points(stretches))
        ending = observation.event is Event.ENDING and len(vehicle.rest_m) <= 1
        if before is not None and _same(before.work(), work) and not ending:
            return None
        if len(work) < len(_points(stretches)):
            self._open += _beyond(stretches, work)
        else:
            stretches = stretches + self._wander(vehicle, work)
        points = affordable(vehicle, _points(stretches))
        if not len(points):
            if observation.event is Event.START:
                budget = vehicle.request.budget
                msg = f"budget of {budget.limit:g} {budget.unit} is too small: {_NAME} cannot reach the area"
                raise PlanningError(msg)
            return None
        under_way = kept[0].segment if kept else None
        self._contracts[vehicle.system_id] = Contract(tuple(stretches), points, under_way)
        return points

    def _stretches(
        self,
        observation: PolicyObservation,
        vehicle: VehicleReport,
        kept: list[Stretch],
        awarded: list[tuple[Segment, int]],
    ) -> list[Stretch]:
        flown = [(segment, *row) for segment, variant in awarded for row in segment.ordered(variant)]
        if not flown:
            return []
        here = kept[-1].points_m[-1] if kept else np.asarray(vehicle.position_m)
        legs = self._terrain(vehicle).legs([ends for _, _, ends in flown], here)
        # A waypoint at the vehicle's position would only stop the vehicle.
        near = np.hypot(*(legs[0] - here).T) < _AT_CELLS * observation.farm.cell_size_m
        passed = int(np.argmin(near)) if not near.all() else len(near) - 1
        legs[0] = legs[0][passed:]
        return [Stretch(segment, row, leg) for (segment, row, _), leg in zip(flown, legs, strict=True)]

    def _wander(self, vehicle: VehicleReport, after_m: Points) -> list[Stretch]:
        """Return legs to random places that use up the remaining budget."""
        terrain = self._terrain(vehicle)
        number = vehicle.system_id
        rng = self._streams.setdefault(
            number, stream(vehicle.request.seed, _NAME, f"vehicle-{number}", "wander")
        )
        here = after_m[-1] if len(after_m) else np.asarray(vehicle.position_m)
        left = vehicle.left - vehicle.travel_cost.rest([after_m])[0]
        places = draw_places(terrain.flyable, _MOST_LEGS, rng)[:_MOST_LEGS]
        legs = terrain.legs(list(places[:, None, :]), here)
        way = np.vstack((here, *legs))
        ends = np.cumsum([len(leg) for leg in legs])
        spent = np.cumsum(leg_costs(vehicle.travel_cost, way))[ends - 1]
        count = int(np.searchsorted(spent, left)) + 1
        return [Stretch(None, 0, leg) for leg in legs[:count]]

    def _terrain(self, vehicle: VehicleReport) -> Terrain:
        if vehicle.system_id not in self._terrains:
            request = vehicle.request
            self._terrains[vehicle.system_id] = Terrain(request.area, request.footprint_m, request.passable)
        return self._terrains[vehicle.system_id]


def _points(stretches: Sequence[Stretch]) -> Points:
    return np.concatenate([stretch.points_m for stretch in stretches]) if stretches else NO_POINTS


def _same(before: Points, after: Points) -> bool:
    return len(before) == len(after) and np.allclose(before, after, rtol=0.0, atol=_SAME_M)


def _beyond(stretches: list[Stretch], flown: Points) -> list[Segment]:
    """Return the segments that a path leaves unfinished, each with its unfinished rows."""
    whole = Contract(tuple(stretches), _points(stretches))
    whole.follow(whole.points_m[max(len(flown) - 1, 0) :])
    here = flown[-1] if len(flown) else whole.points_m[0]
    return whole.unflown((float(here[0]), float(here[1])))
