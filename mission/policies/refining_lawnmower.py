"""The refining lawnmower: coarse rows, left for what lies about a sick plant as soon as it is found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.planners import Budget, make_planner
from mission.planners.inside_routing import TOLERANCE_M, Terrain
from mission.planners.partition import STRIPS
from mission.planners.path import Area, Points, path_length
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.detour import detour
from mission.policies.observation import Event, PolicyObservation, VehicleReport
from mission.policies.policy import LEAST_S, Triggers
from mission.policies.rolling_horizon import RollingHorizon
from mission.policies.sharing import shared
from mission.policies.steering import affordable

_RENEW_CELLS = 6.0
_NOTHING: Points = np.empty((0, 2))


@dataclass(slots=True)
class _Rows:
    """What is left of a vehicle's coarse rows.

    Parameters
    ----------
    rest : float64[n, 2]
        The points that are still to be reached, metres.
    begin : float64[2]
        Where the rows were left, or begin.
    """

    rest: Points
    begin: NDArray[np.float64]

    def resumed(self, from_m: NDArray[np.float64]) -> Points:
        """Return the points of the rows for a vehicle that comes back to them from a place."""
        if not len(self.rest):
            return self.rest
        leg = self.rest[0] - self.begin
        length = float(leg @ leg)
        part = float(np.clip((from_m - self.begin) @ leg / length, 0.0, 1.0)) if length > 0.0 else 0.0
        return np.vstack((self.begin + part * leg, self.rest))


class RefiningLawnmower:
    """Fly coarse rows; where a sick plant is seen, leave them until all plants beside sick ones are known.

    The land of the crop whose disease weighs most is flown first, in rows as close as the budget allows, but
    not closer than outbreaks are wide; what is left of the budget goes to the rows of the next crop. When the
    rows are done, `mission.policies.rolling_horizon.RollingHorizon` flies what is left of it. Until then the
    observations alone count, so that it works with any estimator. Several vehicles get a strip of the land
    each.

    Parameters
    ----------
    coarse : float
        Part of the budget for the rows.
    gap, later_gap : float
        Least distance of the rows on the land that is flown first, and on that of other crops, cells.
    least_rate : float
        Plants beside sick ones a cell of flight below which no detour is made.
    every : int
        Look for a detour after so many observations.

    Raises
    ------
    PlanningError
        If a parameter is out of its range.
    """

    def __init__(
        self,
        coarse: float = 0.9,
        gap: float = 6.0,
        later_gap: float = 3.5,
        least_rate: float = 0.35,
        every: int = 2,
    ) -> None:
        if not 0.0 < coarse <= 1.0:
            msg = f"refining-lawnmower: coarse must be above 0 and at most 1, not {coarse!r}"
            raise PlanningError(msg)
        if not min(gap, later_gap) > 0.0:
            msg = f"refining-lawnmower: gap and later_gap must be above 0, not {gap!r} and {later_gap!r}"
            raise PlanningError(msg)
        self._coarse = float(coarse)
        self._gaps = float(gap), float(later_gap)
        self._least_rate = float(least_rate)
        self._every = int(every)
        self._after = RollingHorizon()
        self._rows: dict[int, _Rows] = {}
        self._away: set[int] = set()
        self._terrains: dict[int, Terrain] = {}

    @property
    def triggers(self) -> Triggers:
        """After some observations."""
        return Triggers(observations=self._every, least_s=LEAST_S)

    def start(self) -> None:
        """Forget the run before."""
        self._rows, self._away = {}, set()
        self._after.start()

    def decide(self, observation: PolicyObservation) -> Decision:
        """Give rows at the start; then detours, the way back to the rows, and routes when these are flown."""
        if observation.event is Event.START:
            return self._begin(observation)
        paths: dict[int, Points] = {}
        done: list[int] = []
        for vehicle in observation.steerable:
            rows = self._rows.get(vehicle.system_id)
            if rows is None:
                done.append(vehicle.system_id)
                continue
            path = self._path(vehicle, rows, observation, paths)
            ends = observation.event is Event.ENDING and len(vehicle.rest_m) <= 1
            if path is None and (ends or _nearly_flown(vehicle, observation.farm.cell_size_m)):
                del self._rows[vehicle.system_id]
                done.append(vehicle.system_id)
            elif path is not None:
                paths[vehicle.system_id] = path
        if done:
            paths |= self._route(observation, done)
        return (
            Decision(paths, reason="plants beside sick ones" if self._away else "rows")
            if paths
            else NO_CHANGE
        )

    def _begin(self, observation: PolicyObservation) -> Decision:
        vehicles = observation.steerable
        if not vehicles:
            return NO_CHANGE
        parts = shared(vehicles, STRIPS)
        self._rows, self._away = {}, set()
        for one in vehicles:
            self._terrains[one.system_id] = Terrain(one.request.area, one.request.footprint_m)
            points = affordable(one, self._plan(one, parts[one.system_id], observation))
            self._rows[one.system_id] = _Rows(points, np.asarray(one.position_m))
        return Decision({system_id: rows.rest for system_id, rows in self._rows.items()}, reason="rows")

    def _plan(self, vehicle: VehicleReport, part: Area, observation: PolicyObservation) -> Points:
        """Return the rows of one land after the other, as long as the budget for rows lasts."""
        request, cell_m = vehicle.request, observation.farm.cell_size_m
        points, here = _NOTHING, vehicle.position_m
        for number, land in enumerate(self._lands(vehicle, part, observation)):
            spent = vehicle.travel_cost.rest([points])[0] if len(points) else 0.0
            left = self._coarse * vehicle.left - spent
            if left <= 0.0:
                break
            gap_m = max(self._gaps[min(number, 1)] * cell_m, request.footprint_m)
            planner = make_planner("lawnmower")
            budget = _PartOf(request.budget, left)
            # Rows that each see a strip as wide as the gap, half of it from the border.
            task = replace(
                request, area=land, start_xy_m=here, budget=budget, crop_areas=(), footprint_m=gap_m
            )
            try:
                more = planner(task).points_m
            except PlanningError:
                continue
            more = self._terrains[vehicle.system_id].join([more], here)
            points = np.vstack((points, more))
            here = (float(points[-1, 0]), float(points[-1, 1]))
        if len(points):
            return points
        return make_planner("lawnmower")(replace(request, area=part)).points_m

    @staticmethod
    def _lands(vehicle: VehicleReport, part: Area, observation: PolicyObservation) -> list[Area]:
        """Return the land of the crops in a part of the area, that of the weightiest disease first."""
        fields, weights = observation.fields, observation.weights.field
        weight_of = {
            crop: max(
                weights[k] for k, one in enumerate(fields) if one.kind == "disease" and crop in one.crops
            )
            for crop in {crop for one in fields.diseases for crop in one.crops}
        }
        grown = [one for one in vehicle.request.crop_areas if weight_of.get(one.crop.name.lower(), 0.0) > 0.0]
        grown.sort(key=lambda one: -weight_of[one.crop.name.lower()])
        lands = []
        for one in grown:
            pieces = shapely.get_parts(shapely.intersection(one.area, part))
            polygons = [piece for piece in pieces if isinstance(piece, shapely.Polygon)]
            if polygons:
                lands.append(polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons))
        return lands or [part]

    def _path(
        self, vehicle: VehicleReport, rows: _Rows, observation: PolicyObservation, new: dict[int, Points]
    ) -> Points | None:
        """Return a vehicle's new path while it has rows, and note where it is on them; None to go on."""
        here = np.asarray(vehicle.position_m)
        if len(vehicle.rest_m) <= len(rows.rest):
            rows.rest, rows.begin = vehicle.rest_m, here
            self._away.discard(vehicle.system_id)
        promised = [
            np.vstack((np.asarray(other.position_m), new.get(other.system_id, other.rest_m)))
            for other in observation.vehicles
            if other.system_id != vehicle.system_id and other.system_id in self._away
        ]
        route = detour(vehicle, observation, promised, self._least_rate)
        if len(route):
            self._away.add(vehicle.system_id)
            return self._joined(vehicle, [route, rows.resumed(route[-1])])
        if vehicle.system_id not in self._away:
            return None
        self._away.discard(vehicle.system_id)
        return self._joined(vehicle, [rows.resumed(here)])

    def _joined(self, vehicle: VehicleReport, pieces: list[Points]) -> Points:
        """Join pieces of a path, so that it stays in the area, as far as the vehicle can pay for it.

        Rows may be left, and a path may be cut, on the way from one part of the area to another.
        """
        area = shapely.buffer(vehicle.request.area, TOLERANCE_M)
        kept = [piece[shapely.covers(area, shapely.points(piece))] for piece in pieces if len(piece)]
        kept = [piece for piece in kept if len(piece)]
        if not kept:
            return _NOTHING
        path = affordable(vehicle, self._terrains[vehicle.system_id].join(kept, vehicle.position_m))
        return path[:-1] if len(path) and not shapely.covers(area, shapely.Point(path[-1])) else path

    def _route(self, observation: PolicyObservation, done: list[int]) -> dict[int, Points]:
        """Return routes of the vehicles whose rows are flown."""
        found = self._after.decide(observation).paths
        return {system_id: found[system_id] for system_id in done if system_id in found}


@dataclass(frozen=True, slots=True)
class _PartOf:
    """A part of a budget."""

    whole: Budget
    limit: float

    @property
    def unit(self) -> str:
        return self.whole.unit

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        return self.whole.cost(path_xy_m)


def _nearly_flown(vehicle: VehicleReport, cell_m: float) -> bool:
    path = np.vstack((np.asarray(vehicle.position_m)[None], vehicle.rest_m))
    return path_length(path) <= _RENEW_CELLS * cell_m
