"""How the vehicles of a fleet share land, and who takes over what a lost one has not flown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.named import ParameterError
from mission.errors import PlanningError
from mission.planners.partition import PARTITIONS, STRIPS, balanced, strips
from mission.planners.path import Area, PlannedPath, Points
from mission.planners.request import Planner
from mission.planners.terrain import area_of, polygons_of
from mission.policies.observation import VehicleReport, pays_for_return

WHOLE = "none"
"""No parts: everybody has the whole farm."""
PARTITION_NAMES = (*PARTITIONS, WHOLE)
_ALIKE = 0.01


def check_partition(partition: str) -> str:
    """Return the name of a way to share land; ParameterError if there is no such way."""
    if partition not in PARTITION_NAMES:
        msg = f"partition {partition!r}: give {', '.join(PARTITION_NAMES[:-1])} or {PARTITION_NAMES[-1]}"
        raise ParameterError(msg)
    return partition


def reach_m(vehicle: VehicleReport) -> float:
    """Return how many metres a vehicle can roughly fly with what is left of its budget."""
    low_x, low_y, high_x, high_y = vehicle.request.area.bounds
    length = max(high_x - low_x, high_y - low_y)
    here = np.array([[0.5 * (low_x + high_x), 0.5 * (low_y + high_y)]])
    around = here + length * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    cost = float(np.mean(vehicle.travel_cost.legs(here, around)))
    return vehicle.left * length / cost if cost > 0.0 else math.inf


def shared(vehicles: Sequence[VehicleReport], partition: str) -> dict[int, Area]:
    """Return the part of its land that each vehicle has, by system id.

    Strips of equal area for vehicles that can fly equally far; otherwise, and for the Voronoi cells always,
    each vehicle flies the same share of what it can fly, with the ways to its part and back
    (`mission.planners.partition.balanced`). Of vehicles that are alike, the
    first one has the nearer one of the outer strips.
    """
    check_partition(partition)
    area = vehicles[0].request.area
    own = any(one.request.area != area for one in vehicles)
    if own or partition == WHOLE or len(vehicles) == 1:
        return {one.system_id: one.request.area for one in vehicles}
    divide = PARTITIONS[partition]
    reach = [reach_m(one) for one in vehicles]
    if not np.isfinite(reach).all():
        reach = [1.0] * len(vehicles)
    if partition == STRIPS and max(reach) <= (1.0 + _ALIKE) * min(reach):
        parts = divide(area, [1.0] * len(vehicles))
        home = shapely.Point(vehicles[0].request.start_xy_m)
        if home.distance(parts[-1]) < home.distance(parts[0]):
            parts.reverse()
    else:
        ways = [2.0 if pays_for_return(one) else 1.0 for one in vehicles]
        parts = balanced(
            area,
            divide,
            reach,
            lambda number, part: ways[number] * _distance_m(vehicles[number], part),
        )
    return {one.system_id: part for one, part in zip(vehicles, parts, strict=True)}


def _distance_m(vehicle: VehicleReport, part: Area) -> float:
    """Return how far a part is away."""
    return float(shapely.distance(part, shapely.Point(vehicle.position_m)))


# Rows count as seen to a little more than half of their distance, so that no gaps are left between them.
_OF_SPACING = 0.55
# Rows over the other's land at most so much farther apart than one's own, or everything is planned anew.
_COARSER = 1.5


@dataclass(frozen=True, slots=True)
class OnwardBudget:
    """What a vehicle in flight has left, for planners: paths go on from here, or after other points."""

    vehicle: VehicleReport
    before_m: Points  # float64[n, 2]: points that are flown before the planned path

    @property
    def limit(self) -> float:
        """What is left."""
        return self.vehicle.left

    @property
    def unit(self) -> str:
        """Of the vehicle's budget."""
        return self.vehicle.request.budget.unit

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the cost of flying on; the first row of the path is where it begins."""
        return self.costs([path_xy_m])[0]

    def costs(self, paths_xy_m: Sequence[NDArray[np.float64]]) -> list[float]:
        """Return the `cost` of each path."""
        return self.vehicle.travel_cost.rest([np.vstack((self.before_m, path[1:])) for path in paths_xy_m])


@dataclass(frozen=True, slots=True)
class Share:
    """What a vehicle has to fly."""

    part: Area  # Its land
    spacing_m: float | None  # Distance of its rows; None if its path has no such thing

    def unflown(self, vehicle: VehicleReport) -> Area:
        """Return the land along the rest of the vehicle's path; its whole land if the path has no rows."""
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
    """Return new rests of the takers' paths, which see the land that lost vehicles have not seen.

    The land is divided among the takers by what each has to spare. Each flies its own path to the end and
    then rows over its piece; if it has too little for that, everything that it has still to see is planned
    anew, in rows farther apart. Who cannot afford that either goes on as before.
    """
    left = [shares[one.system_id].unflown(one) for one in lost]
    flying = [one for one in takers if one.system_id in shares]
    if not flying or not left:
        return {}
    footprint = flying[0].request.footprint_m
    land = _land(shapely.union_all(left), footprint)
    if land.is_empty:
        return {}
    found: dict[int, tuple[Points, Share]] = {}
    for vehicle, piece in zip(flying, _pieces(land, flying), strict=True):
        mine = shares[vehicle.system_id]
        planned = _more(vehicle, mine, piece, planner)
        if planned is None:
            continue
        spacing = planned[1] if planned[1] is not None else mine.spacing_m
        part = _land(shapely.union(mine.part, piece), 0.0)
        found[vehicle.system_id] = planned[0], Share(part, spacing)
    return found


def _pieces(land: Area, takers: Sequence[VehicleReport]) -> list[Area]:
    """Return the piece of each taker: by what it has to spare beyond its own path."""
    spare = np.array(
        [max(one.left - one.travel_cost.rest([one.rest_m])[0], 0.0) / one.left for one in takers]
    )
    if not spare.any():
        spare[:] = 1.0
    try:
        return strips(land, np.maximum(spare / spare.sum(), 0.02).tolist())
    except PlanningError:
        # Too little to be divided: it is the nearest one's.
        nearest = min(takers, key=lambda one: shapely.distance(land, shapely.Point(one.position_m)))
        return [land if one is nearest else shapely.Polygon() for one in takers]


def _more(
    vehicle: VehicleReport, mine: Share, piece: Area, planner: Planner
) -> tuple[Points, float | None] | None:
    """Return a path that sees what a vehicle has to see and another piece, and its spacing."""
    if piece.is_empty or vehicle.left <= 0.0:
        return None
    after = _planned(vehicle, piece, vehicle.rest_m, planner)
    near = after is not None and (
        after.spacing_m is None
        or mine.spacing_m is None
        or after.spacing_m <= _COARSER * max(mine.spacing_m, vehicle.request.footprint_m)
    )
    anew = None
    if not near:
        whole = _land(shapely.union(mine.unflown(vehicle), piece), vehicle.request.footprint_m)
        anew = _planned(vehicle, whole, vehicle.rest_m[:0], planner)
    if anew is not None:
        return anew.points_m, anew.spacing_m
    if after is not None:
        return np.vstack((vehicle.rest_m, after.points_m)), after.spacing_m
    return None


def _planned(vehicle: VehicleReport, land: Area, before_m: Points, planner: Planner) -> PlannedPath | None:
    """Return the path over a piece of land that begins where the vehicle is after other points."""
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
    """Return the polygons of a geometry that are no mere slivers."""
    least = max(0.25 * footprint_m**2, 1e-9)
    tidy = shapely.simplify(shapely.make_valid(geometry), 0.05 * footprint_m) if footprint_m else geometry
    return area_of(polygons_of(tidy, least))
