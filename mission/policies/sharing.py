"""How the vehicles of a fleet share land: whose is which part of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from geo.named import ParameterError
from mission.planners.partition import PARTITIONS, STRIPS, balanced
from mission.planners.path import Area
from mission.policies.observation import VehicleReport
from mission.policies.travel_cost import pays_for_return

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

    Parameters
    ----------
    vehicles : sequence of VehicleReport
        Those that do not have the same land keep what they have.
    partition : {"strips", "voronoi", "none"}

    Raises
    ------
    PlanningError
        If the land is too small for so many.
    ParameterError
        If there is no such partition.
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
