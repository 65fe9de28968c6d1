"""Land that nobody wants to see between what is to be seen: rows are cut there, or lead over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import shapely
from shapely.geometry import Polygon

from mission.errors import PlanningError
from mission.planners.path import Area, PlannedPath
from mission.planners.request import PlanningRequest
from mission.planners.terrain import area_of, parts_of, polygons_of

# Of the area: what is smaller comes of rounding.
_LEAST_SHARE = 1e-6
_WORTH = 1.05


def gaps_of(area: Area, passable: Area) -> list[Polygon]:
    """Return the passable land that lies within the convex hull of an area and not in it, largest first.

    Examples
    --------
    >>> field = shapely.box(0, 0, 9, 9)
    >>> [gap.area for gap in gaps_of(field - shapely.box(3, 3, 5, 5), field)]
    [4.0]
    """
    hull = shapely.intersection(area.convex_hull, passable)
    least_m2 = _LEAST_SHARE * area.area
    return sorted(polygons_of(shapely.difference(hull, area), least_m2), key=lambda gap: -gap.area)


def with_gaps(area: Area, gaps: Sequence[Polygon]) -> Area:
    """Return an area with gaps."""
    return area_of(polygons_of(shapely.union_all([area, *gaps])))


def swept_lands(request: PlanningRequest) -> list[Area]:
    """Return the lands over which rows may be laid: the area, it with what it encloses, and with all gaps.

    Which one is best only their prices tell: a row that leaves out a pond is shorter and has two more turns.
    """
    area = request.area
    if request.passable is None or not (gaps := gaps_of(area, request.passable)):
        return [area]
    solid = shapely.union_all([Polygon(part.exterior) for part in parts_of(area)])
    enclosed = [gap for gap in gaps if shapely.covers(solid, gap.representative_point())]
    lands = [area]
    if enclosed:
        lands.append(with_gaps(area, enclosed))
    if len(gaps) > len(enclosed):
        lands.append(with_gaps(area, gaps))
    return lands


def densest_over(request: PlanningRequest, plan: Callable[[Area], PlannedPath]) -> PlannedPath:
    """Return the path with the least spacing, of those that `plan` lays over each of `swept_lands`.

    One in more pieces has to be denser by a twentieth: pieces end in turns, which are flown worse than rows.
    PlanningError if there is none.
    """
    lands = swept_lands(request)
    if len(lands) == 1:
        return plan(lands[0])
    paths, refused = [], []
    for land in lands:
        try:
            paths.append(plan(land))
        except PlanningError as error:
            refused.append(error)
    if not paths:
        raise refused[0]
    # The land in the fewest pieces, that with all gaps, comes last.
    best = paths.pop()
    for path in reversed(paths):
        if _density(path) > _WORTH * _density(best):
            best = path
    return best


def _density(path: PlannedPath) -> float:
    return 1.0 / path.spacing_m if path.spacing_m else 0.0
