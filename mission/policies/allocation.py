"""Allocation of land to the vehicles of a fleet, and reallocation after the loss of a vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.farm import united
from geo.named import ParameterError
from mission.errors import PlanningError
from mission.planners.partition import PARTITIONS, STRIPS, balanced, strips
from mission.planners.path import Area, PlannedPath, Points
from mission.planners.request import Planner
from mission.planners.terrain import area_of, polygons_of
from mission.policies.observation import VehicleReport, pays_for_return

WHOLE = "none"
"""Name for no partition: each vehicle gets the whole area."""
PARTITION_NAMES = (*PARTITIONS, WHOLE)
_ALIKE = 0.01  # Vehicles get strips of equal area if their reaches differ by less than this fraction


def check_partition(partition: str) -> str:
    """Return the name of a partition; raise ParameterError if the name is unknown."""
    if partition not in PARTITION_NAMES:
        msg = f"partition {partition!r}: give {', '.join(PARTITION_NAMES[:-1])} or {PARTITION_NAMES[-1]}"
        raise ParameterError(msg)
    return partition


def reach_m(vehicle: VehicleReport) -> float:
    """Return the approximate distance (m) that a vehicle can fly with its remaining budget."""
    low_x, low_y, high_x, high_y = vehicle.request.area.bounds
    length = max(high_x - low_x, high_y - low_y)
    here = np.array([[0.5 * (low_x + high_x), 0.5 * (low_y + high_y)]])
    around = here + length * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    cost = float(np.mean(vehicle.travel_cost.legs(here, around)))
    return vehicle.left * length / cost if cost > 0.0 else math.inf


def shared(vehicles: Sequence[VehicleReport], partition: str) -> dict[int, Area]:
    """Return each vehicle's part of the land, by system id.

    Vehicles of equal reach get strips of equal area; the first vehicle gets the outer strip nearer to home.
    Otherwise, and always with Voronoi cells, all vehicles fly the same fraction of their reach
    (`mission.planners.partition.balanced`). Vehicles that already have different areas keep these areas.
    """
    check_partition(partition)
    area = vehicles[0].request.area
    own = any(vehicle.request.area != area for vehicle in vehicles)
    if own or partition == WHOLE or len(vehicles) == 1:
        return {vehicle.system_id: vehicle.request.area for vehicle in vehicles}
    divide = PARTITIONS[partition]
    reach = list(map(reach_m, vehicles))
    if not np.isfinite(reach).all():
        reach = [1.0] * len(vehicles)
    if partition == STRIPS and max(reach) <= (1.0 + _ALIKE) * min(reach):
        parts = divide(area, [1.0] * len(vehicles))
        home = shapely.Point(vehicles[0].request.start_xy_m)
        if home.distance(parts[-1]) < home.distance(parts[0]):
            parts.reverse()
    else:
        places = [shapely.Point(vehicle.position_m) for vehicle in vehicles]
        ways = [2.0 if pays_for_return(vehicle) else 1.0 for vehicle in vehicles]
        parts = balanced(
            area, divide, reach, lambda number, part: ways[number] * float(part.distance(places[number]))
        )
    return {vehicle.system_id: part for vehicle, part in zip(vehicles, parts, strict=True)}


# Distance up to which a row covers the land on each side, in row spacings; more than 0.5 to avoid gaps.
_OF_SPACING = 0.55
# If rows over added land would be farther apart by this factor, the vehicle plans all its unflown land again.
_COARSER = 1.5


@dataclass(frozen=True, slots=True)
class OnwardBudget:
    """The remaining budget of a vehicle in flight, for a planner that plans the path ahead."""

    vehicle: VehicleReport
    before_m: Points  # Points that the vehicle flies before the planned path, float64[n, 2]

    @property
    def limit(self) -> float:
        """Remaining budget of the vehicle."""
        return self.vehicle.left

    @property
    def unit(self) -> str:
        """Unit of the vehicle's budget."""
        return self.vehicle.request.budget.unit

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the cost of flying through `before_m` and then through the path's points after the first."""
        return self.costs([path_xy_m])[0]

    def costs(self, paths_xy_m: Sequence[NDArray[np.float64]]) -> list[float]:
        """Return the cost of each path, as `cost` does."""
        return self.vehicle.travel_cost.rest([np.vstack((self.before_m, path[1:])) for path in paths_xy_m])


@dataclass(frozen=True, slots=True)
class Share:
    """The land of a vehicle, and the row spacing of its path."""

    part: Area
    spacing_m: float | None  # None: the path has no rows

    def unflown(self, vehicle: VehicleReport) -> Area:
        """Return the vehicle's land along its remaining path, or all its land if the path has no rows."""
        if self.spacing_m is None:
            return self.part
        if not len(vehicle.rest_m):
            return shapely.Polygon()
        line = shapely.LineString(np.vstack((vehicle.position_m, vehicle.rest_m)))
        width = max(self.spacing_m, vehicle.request.footprint_m)
        along = shapely.buffer(line, _OF_SPACING * width, cap_style="flat", join_style="mitre")
        return _land(shapely.intersection(along, self.part), vehicle.request.footprint_m)


def reallocate(
    lost: Sequence[VehicleReport],
    takers: Sequence[VehicleReport],
    shares: Mapping[int, Share],
    planner: Planner,
) -> dict[int, tuple[Points, Share]]:
    """Return new paths and land of the vehicles `takers`, which take over the lost vehicles' unflown land.

    Each of the `takers` gets a piece of this land, in proportion to its unused budget, and flies its own
    path, then rows over the piece. If the budget allows no rows or only rows much farther apart, all the
    vehicle's unflown land is planned again. If even this costs too much, the vehicle keeps its path.
    """
    left = [shares[vehicle.system_id].unflown(vehicle) for vehicle in lost]
    flying = [vehicle for vehicle in takers if vehicle.system_id in shares]
    if not flying or not left:
        return {}
    footprint = flying[0].request.footprint_m
    land = _land(united(left), footprint)
    if land.is_empty:
        return {}
    found: dict[int, tuple[Points, Share]] = {}
    for vehicle, piece in zip(flying, _pieces(land, flying), strict=True):
        mine = shares[vehicle.system_id]
        planned = _more(vehicle, mine, piece, planner)
        if planned is None:
            continue
        spacing = planned[1] if planned[1] is not None else mine.spacing_m
        part = _land(united([mine.part, piece]), 0.0)
        found[vehicle.system_id] = planned[0], Share(part, spacing)
    return found


def _pieces(land: Area, takers: Sequence[VehicleReport]) -> list[Area]:
    """Return each vehicle's piece of the land, in proportion to the budget that its path leaves unused."""
    spare = np.array(
        [max(taker.left - taker.travel_cost.rest([taker.rest_m])[0], 0.0) / taker.left for taker in takers]
    )
    if not spare.any():
        spare[:] = 1.0
    try:
        return strips(land, np.maximum(spare / spare.sum(), 0.02).tolist())
    except PlanningError:
        # Land that is too small to be divided goes to the nearest vehicle.
        nearest = min(takers, key=lambda taker: shapely.distance(land, shapely.Point(taker.position_m)))
        return [land if taker is nearest else shapely.Polygon() for taker in takers]


def _more(
    vehicle: VehicleReport, mine: Share, piece: Area, planner: Planner
) -> tuple[Points, float | None] | None:
    """Return a path over the vehicle's unflown land and `piece`, with its row spacing; None without one."""
    if piece.is_empty or vehicle.left <= 0.0:
        return None
    footprint_m = vehicle.request.footprint_m
    after = _planned(vehicle, piece, vehicle.rest_m, planner)
    if after is None or (
        after.spacing_m is not None
        and mine.spacing_m is not None
        and after.spacing_m > _COARSER * max(mine.spacing_m, footprint_m)
    ):
        whole = _land(united([mine.unflown(vehicle), piece]), footprint_m)
        anew = _planned(vehicle, whole, vehicle.rest_m[:0], planner)
        if anew is not None:
            return anew.points_m, anew.spacing_m
    return None if after is None else (np.vstack((vehicle.rest_m, after.points_m)), after.spacing_m)


def _planned(vehicle: VehicleReport, land: Area, before_m: Points, planner: Planner) -> PlannedPath | None:
    """Return the planner's path over the land after the points `before_m`, or None if planning fails."""
    start = before_m[-1] if len(before_m) else np.asarray(vehicle.position_m)
    request = replace(
        vehicle.request,
        area=land,
        start_xy_m=(float(start[0]), float(start[1])),
        budget=OnwardBudget(vehicle, before_m),
    )
    try:
        return planner(request)
    except PlanningError:
        return None


def _land(geometry: shapely.Geometry, footprint_m: float) -> Area:
    """Return the polygons of a geometry without slivers."""
    least = max(0.25 * footprint_m**2, 1e-9)
    tidy = shapely.simplify(shapely.make_valid(geometry), 0.05 * footprint_m) if footprint_m else geometry
    return area_of(polygons_of(tidy, least))
