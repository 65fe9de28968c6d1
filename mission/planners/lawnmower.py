"""The lawnmower: parallel rows, as many as the budget allows."""

from __future__ import annotations

from mission.planners.inside_routing import Terrain
from mission.planners.path import PlannedPath, Points, drop_coincident
from mission.planners.request import PlanningRequest
from mission.planners.search import densest_feasible
from mission.planners.spacing import spacing_limits
from mission.planners.sweep import Sweep, sweep_angle


def lawnmower(
    request: PlanningRequest,
    /,
    *,
    direction: str | float | None = None,
    min_spacing_m: float | None = None,
    max_spacing_m: float | None = None,
) -> PlannedPath:
    """Plan equidistant rows from border to border, flown to and fro, as many as the budget allows.

    Any number of rows from two upwards is possible (the paper's implementation knows only odd ones), until
    rows are a footprint apart; an area that is narrower than the footprint has one row. Over areas that
    are not convex the rows are cut into boustrophedon cells, which are flown nearest first.

    Parameters
    ----------
    request : PlanningRequest
        The problem.
    direction : str or float, optional
        Direction of the rows, see `mission.planners.sweep.sweep_angle`; by default along x over a
        rectangle along the axes, as in the paper, otherwise the direction with the fewest turns.
    min_spacing_m, max_spacing_m : float, optional
        Rows are at least and at most so far apart. Default: at least a footprint.

    Returns
    -------
    PlannedPath
        Its spacing is the distance between rows.

    Raises
    ------
    PlanningError
        If the budget does not suffice for two rows, or for rows as near as asked for; the text says what
        would. If a parameter is out of its range.

    Examples
    --------
    >>> import shapely
    >>> from mission.planners.budget import LengthBudget
    >>> request = PlanningRequest(shapely.box(0, 0, 30, 30), (0, 0), LengthBudget(360.0), footprint_m=0.0)
    >>> path = lawnmower(request)
    >>> path.spacing_m, path.length_m
    (3.0, 360.0)
    """
    terrain = Terrain(request.area, request.footprint_m)
    least, most = spacing_limits("lawnmower", request.footprint_m, min_spacing_m, max_spacing_m)
    sweep = Sweep(terrain.flyable, least, sweep_angle(terrain.flyable, direction), max_spacing_m=most)

    def build(rows: int) -> Points:
        path = terrain.join(sweep.pieces(rows, request.start_xy_m), request.start_xy_m)
        return drop_coincident(path, 1e-6)

    what = f"lawnmower with {sweep.least_rows} row{'s' if sweep.least_rows > 1 else ''}"
    found = densest_feasible(request, build, sweep.least_rows, sweep.most_rows, what=what)
    return PlannedPath(found.points_m, sweep.spacing_m(found.index), "lawnmower")
