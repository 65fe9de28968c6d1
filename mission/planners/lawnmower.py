"""The planners lawnmower and adaptive-lawnmower: as many parallel rows as the budget allows."""

from __future__ import annotations

from dataclasses import dataclass

import shapely

from geo.farm import united
from geo.grid import Crop
from geo.texts import is_number
from mission.errors import PlanningError
from mission.planners.path import Area, PlannedPath, Points, drop_coincident
from mission.planners.request import PlanningRequest
from mission.planners.search import Found, densest_feasible, densest_over, spacing_limits
from mission.planners.sweep import Sweep, sweep_angle
from mission.planners.terrain import Terrain, area_of, inset, polygons_of


def lawnmower(
    request: PlanningRequest,
    /,
    *,
    direction: str | float | None = None,
    min_spacing_m: float | None = None,
    max_spacing_m: float | None = None,
) -> PlannedPath:
    """Plan as many equidistant parallel rows from border to border as the budget allows.

    There are at least two rows; rows lie at least a footprint apart. The number of rows may be odd or even
    (odd only in the paper's code). An area narrower than the footprint has one row. A non-convex area is
    decomposed into boustrophedon cells, flown in nearest-first order. Rows run on across passable gaps in
    the area. Rows that stop at the gaps are chosen only if they are over 5 % denser in the same budget.

    Parameters
    ----------
    direction : str or float, optional
        Direction of the rows, see `mission.planners.sweep.sweep_angle`. Default: along x for an axis-aligned
        rectangle, as in the paper, otherwise the direction with the fewest turns.
    min_spacing_m, max_spacing_m : float, optional
        Least and greatest row spacing. Default: a footprint, no limit.

    Raises
    ------
    PlanningError
        If the budget is too small for two rows, or for rows at `max_spacing_m`; the text gives the least
        budget. If a parameter is out of range.

    Examples
    --------
    >>> import shapely
    >>> from mission.planners.budget import LengthBudget
    >>> request = PlanningRequest(shapely.box(0, 0, 30, 30), (0, 0), LengthBudget(360.0), footprint_m=0.0)
    >>> path = lawnmower(request)
    >>> path.spacing_m, path.length_m
    (3.0, 360.0)
    """
    limits = spacing_limits("lawnmower", request.footprint_m, min_spacing_m, max_spacing_m)
    return densest_over(request, lambda land: _rows(request, land, limits, direction))


def _rows(
    request: PlanningRequest, land: Area, limits: tuple[float, float], direction: str | float | None
) -> PlannedPath:
    """Return the densest rows over the land within the budget."""
    least, most = limits
    terrain = Terrain(land, request.footprint_m, request.passable, request.least_leg_m)
    sweep = Sweep(terrain.flyable, least, sweep_angle(terrain.flyable, direction), max_spacing_m=most)

    def build(rows: int) -> Points:
        path = terrain.join(sweep.pieces(rows, request.start_xy_m), request.start_xy_m)
        return drop_coincident(path, 1e-6)

    what = f"lawnmower with {sweep.least_rows} row{'s' if sweep.least_rows > 1 else ''}"
    found = densest_feasible(request, build, sweep.least_rows, sweep.most_rows, what=what)
    return PlannedPath(found.points_m, sweep.spacing_m(found.index), "lawnmower")


TOMATO_SHARE = 2 / 3
LEAST_ROWS = 1
NAME = "adaptive-lawnmower"
_SPARSEST = f"{NAME} with one row over each crop"


def adaptive_lawnmower(
    request: PlanningRequest,
    /,
    *,
    tomato_share: float = TOMATO_SHARE,
    direction: str | float | None = None,
    min_spacing_m: float | None = None,
) -> PlannedPath:
    """Plan rows over the tomatoes with two thirds of the budget, then over the strawberries with the rest.

    The paper gives the tomatoes two thirds of the budget. The strawberries get a third, less a tenth as a
    safety margin, because the paper does not count the legs to the first row and between the crops. This
    planner counts all legs and needs no margin. Each crop has as many rows as its share allows. If the
    strawberries already have rows a footprint apart, the tomatoes also get the remaining budget. If the
    budget is too small for one row over the strawberries, the tomatoes get fewer rows.

    A farm with a single crop spends the whole budget on that crop. Without crop areas the rows cover the
    whole area. `PlannedPath.spacing_m` is the smaller of the two crops' row spacings.

    Parameters
    ----------
    tomato_share : float
        Share of the budget for the tomatoes, including the approach, between 0 and 1.
    direction, min_spacing_m
        Direction and least spacing of the rows, as for `lawnmower`.

    Raises
    ------
    PlanningError
        If the budget is too small for one row over each crop; the text gives the least budget.
    """
    if not (is_number(tomato_share) and 0 < tomato_share < 1):
        raise PlanningError(f"{NAME}: tomato_share must be between 0 and 1, not {tomato_share!r}")
    least, _ = spacing_limits(NAME, request.footprint_m, min_spacing_m, None)
    lands = [land for crop in (Crop.TOMATO, Crop.STRAWBERRY) if (land := _land(request, crop)) is not None]
    terrain = Terrain(request.area, request.footprint_m, request.passable, request.least_leg_m)
    flyable = [inset(land, request.footprint_m / 2) for land in lands or [request.area]]
    plan = _Plan(request, terrain, [Sweep(land, least, sweep_angle(land, direction)) for land in flyable])
    if len(plan.sweeps) == 1:
        most = plan.sweeps[0].most_rows
        found = densest_feasible(request, lambda rows: plan.path(rows), LEAST_ROWS, most, what=_SPARSEST)
        return plan.result(found, found.index)
    return _both(plan, tomato_share)


@dataclass(frozen=True, slots=True)
class _Plan:
    request: PlanningRequest
    terrain: Terrain
    sweeps: list[Sweep]

    def path(self, *rows: int) -> Points:
        """Return the path with the given number of rows over each crop, in the order of `sweeps`."""
        pieces: list[Points] = []
        here = self.request.start_xy_m
        for sweep, count in zip(self.sweeps, rows, strict=False):
            pieces += sweep.pieces(count, here)
            here = (float(pieces[-1][-1, 0]), float(pieces[-1][-1, 1]))
        return drop_coincident(self.terrain.join(pieces, self.request.start_xy_m), 1e-6)

    def result(self, found: Found, *rows: int) -> PlannedPath:
        spacings = [sweep.spacing_m(count) for sweep, count in zip(self.sweeps, rows, strict=True)]
        return PlannedPath(found.points_m, min(spacings), NAME)


def _both(plan: _Plan, tomato_share: float) -> PlannedPath:
    request = plan.request
    tomato, strawberry = plan.sweeps

    def most_tomatoes(strawberries: int, highest: int) -> Found:
        return densest_feasible(
            request, lambda rows: plan.path(rows, strawberries), LEAST_ROWS, highest, what=_SPARSEST
        )

    def most_strawberries(tomatoes: int) -> Found:
        return densest_feasible(
            request,
            lambda rows: plan.path(tomatoes, rows),
            LEAST_ROWS,
            strawberry.most_rows,
            what=_SPARSEST,
        )

    share = request.budget.limit * tomato_share
    try:
        tomatoes = densest_feasible(
            request, lambda rows: plan.path(rows), LEAST_ROWS, tomato.most_rows, what=NAME, limit=share
        ).index
    except PlanningError:
        tomatoes = LEAST_ROWS
    try:
        found = most_strawberries(tomatoes)
    except PlanningError:
        tomatoes = most_tomatoes(LEAST_ROWS, tomatoes).index
        found = most_strawberries(tomatoes)
    strawberries = found.index
    if strawberries == strawberry.most_rows and tomatoes < tomato.most_rows:
        found = most_tomatoes(strawberries, tomato.most_rows)
        tomatoes = found.index
    return plan.result(found, tomatoes, strawberries)


def _land(request: PlanningRequest, crop: Crop) -> Area | None:
    """Return the part of the request's area that the crop covers, or None."""
    areas = [land.area for land in request.crop_areas if land.crop == crop]
    parts = polygons_of(shapely.intersection(united(areas), request.area))
    return area_of(parts) if parts else None
