"""A user's planner for convex land: rows along x, as dense as the budget allows."""

import numpy as np
from shapely import LineString

from wbf_mission import PlannedPath, PlanningError


def zigzag(request, *, spacing_m=1.0):
    """Return rows that are at least `spacing_m` metres apart."""
    west, south, east, north = request.area.bounds
    while spacing_m < north - south:
        heights = np.arange(south + spacing_m / 2, north, spacing_m)
        rows = [request.area.intersection(LineString([(west, y), (east, y)])) for y in heights]
        ends = [np.array(row.coords)[:: (-1) ** k] for k, row in enumerate(rows) if row.length > 0]
        points = np.vstack(ends)
        if request.cost(points) <= request.budget.limit:
            return PlannedPath(points, spacing_m, "zigzag")
        spacing_m *= 1.1
    raise PlanningError("the budget is too small for two rows")
