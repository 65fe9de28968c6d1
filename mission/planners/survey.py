"""The planner survey: rows that cover a whole area, in the direction of the least cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from geo.linear_algebra import product
from geo.texts import is_number
from mission.errors import PlanningError
from mission.planners.path import Area, PlannedPath, Points, distinct, path_length
from mission.planners.request import PlanningRequest
from mission.planners.search import (
    cannot_be_flown,
    gaps_of,
    swept_lands,
    too_small,
    with_gaps,
)
from mission.planners.spiral import ring_from
from mission.planners.strips import (
    Swath,
    cut_parts,
    hull_angles,
    is_narrow,
    ring_strips,
    rows_that_see,
    strip_lines,
    without_arms,
)
from mission.planners.sweep import fly_cells
from mission.planners.terrain import Terrain, parts_of, smoothed

NAME = "survey"
BEST = "best"
SEEN, OVERLAP = "seen", "overlap"
MOST_PASSES = 20
_EVERY_DEG = 30  # Step between the directions tried first, together with the directions of the hull's edges.
_FINER_DEG = (12.0, 6.0, 3.0)  # Steps for refining the best direction.
_HULL_ANGLES = 6
# Longer paths are compared by length and number of turns: predicting all their flights takes minutes.
_PRICED_M = 400_000.0
_TURN_M = 20.0  # Length of a row that costs about as much as a turn.
_LONGER = 2.5  # Layouts longer than this multiple of the shortest layout are not evaluated.
_AS_MUCH = 0.02  # A layout may cover less than the best layout by this fraction of the area.
_ROW_M = 0.01  # Half the width of the line that stands for a row.
_FINALISTS = 3  # Number of layouts for which the best order of cells is computed.
_SMOOTHED = 0.125  # Greatest smoothing of borders with many vertices (fraction of an image).
_MOST_TOGGLED = 6  # Greatest number of gaps or parts tried one by one, with one or two predictions each.
# To remove short legs, a corner is shifted across and along the transit by these multiples of the least leg.
_ASIDE = (0.25, 0.5, 1.0, 1.5, 2.0)
_ALONG = (0.0, -0.5, 0.5, -1.0, 1.0)
# Points this close to the direct leg (in least legs) are dropped: the autopilot cuts such corners anyway.
_NEAR = 0.5


def survey(
    request: PlanningRequest,
    /,
    *,
    angle: str | float = BEST,
    spacing_m: float | None = None,
    overshoot_m: float = 0.0,
    headland_passes: int = 0,
    headland: str = "first",
    border: str = SEEN,
) -> PlannedPath:
    """Plan rows that cover the whole area, with the row spacing for the wanted image overlap.

    Borders split the rows into cells, which are flown in an order with short transits. To reduce the cost,
    parts of the area may have rows in different directions, concave parts may be cut, and rows may cross
    passable land outside the area.

    Parameters
    ----------
    angle : str or float
        Direction of the rows in degrees anticlockwise from the x axis, or ``"best"``: the direction of the
        least cost. The cost includes the wind.
    spacing_m : float, optional
        Row spacing. Default: the request's row spacing, from the side overlap.
    overshoot_m : float
        Length of rows beyond their strips, also across the border. A negative value shortens the rows.
    headland_passes : int
        Number of passes along the area's borders and round its holes.
    headland : str
        When the headland passes are flown: ``"first"`` before the rows, ``"last"`` after the rows.
    border : str
        ``"seen"``: images cover the area up to its border. ``"overlap"``: images overlap at the border as
        much as inside, for photogrammetry; the outermost rows then lie half a spacing inside, and rows end
        at the border.

    Raises
    ------
    PlanningError
        If the whole area costs more than the budget (the text names the cost) or a parameter is out of range.

    Examples
    --------
    >>> from mission.planners.budget import LengthBudget
    >>> request = PlanningRequest(shapely.box(0, 0, 40, 20), (0, 0), LengthBudget(1000.0), footprint_m=10.0)
    >>> survey(request).points_m.tolist()
    [[5.0, 5.0], [35.0, 5.0], [35.0, 15.0], [5.0, 15.0]]
    """
    _check(angle, headland_passes, headland, border)
    swath = _swath(request, spacing_m, overshoot_m, border)
    request = _smooth(request, swath)
    plans = _Plans(request, swath, headland_passes, last=headland == "last")
    if angle == BEST:
        layouts = _Search(plans).best()
    else:
        layouts = [plans.common(request.area, math.radians(float(angle)))]
    finals = [
        plans.path(layout, exact=True, returns=returns) for layout in layouts for returns in (True, False)
    ]
    priced = sorted(zip(request.costs(finals), map(path_length, finals), range(len(finals)), strict=True))
    cost, points = priced[0][0], finals[priced[0][2]]
    what = f"survey of the whole area with rows {swath.spacing_m:.3g} m apart"
    if not math.isfinite(cost):
        raise cannot_be_flown(request, points, what)
    if cost > request.budget.limit:
        error = too_small(request, points, cost, what)
        raise PlanningError(f"{error}; with an unlimited budget the survey is planned for several flights")
    return PlannedPath(points, swath.spacing_m, NAME)


def _swath(request: PlanningRequest, spacing_m: float | None, overshoot_m: float, border: str) -> Swath:
    if not is_number(overshoot_m):
        raise PlanningError(f"{NAME}: overshoot_m {overshoot_m!r} is not a distance in metres")
    if spacing_m is not None and not (is_number(spacing_m) and spacing_m > 0):
        msg = f"{NAME}: spacing_m {spacing_m!r} is not a distance in metres; give a number above zero"
        raise PlanningError(msg)
    if not request.footprint_m > 0:
        raise PlanningError(f"{NAME}: a survey needs a footprint above zero")
    spacing = spacing_m or request.row_spacing_m or request.footprint_m
    along = request.footprint_along_m or request.footprint_m
    if border == OVERLAP:
        return Swath(min(request.footprint_m, spacing), 0.0, spacing, overshoot_m, _ROW_M)
    return Swath(request.footprint_m, along, spacing, overshoot_m)


def _smooth(request: PlanningRequest, swath: Swath) -> PlanningRequest:
    """Return the request with borders smoothed to the resolution of the rows."""
    most_m = _SMOOTHED * min(swath.across_m, swath.along_m or swath.across_m, swath.spacing_m)
    area = smoothed(request.area, most_m, request.least_leg_m)
    if request.passable is None:
        return replace(request, area=area)
    passable = with_gaps(smoothed(request.passable, most_m, request.least_leg_m), parts_of(area))
    return replace(request, area=area, passable=passable)


def _check(angle: str | float, headland_passes: int, headland: str, border: str) -> None:
    if angle != BEST and not is_number(angle):
        raise PlanningError(f"{NAME}: angle {angle!r} is neither {BEST} nor degrees")
    if type(headland_passes) is not int or not 0 <= headland_passes <= MOST_PASSES:
        raise PlanningError(
            f"{NAME}: headland_passes must be a whole number from 0 to {MOST_PASSES}, not {headland_passes!r}"
        )
    if border not in (SEEN, OVERLAP):
        raise PlanningError(f"{NAME}: border {border!r} is neither {SEEN} nor {OVERLAP}")
    if headland not in ("first", "last"):
        raise PlanningError(f"{NAME}: headland {headland!r} is neither first nor last")


Layout: TypeAlias = tuple[tuple[Polygon, float], ...]
"""Parts of the area, each with its row direction (rad)."""


class _Plans:
    """Builds paths from layouts, with headland passes before the rows, or after the rows with `last`."""

    def __init__(self, request: PlanningRequest, swath: Swath, passes: int, *, last: bool) -> None:
        self.request, self.swath = request, swath
        self._passes, self._last = passes, last
        self._room = _room(request.room, swath.overshoot_m)
        self._terrain = Terrain(self._room, 0.0)
        self._strips: dict[Polygon, list[Points] | None] = {}
        self._ring_lines = ring_strips(request.area, swath, passes, request.least_leg_m)[0]

    def common(self, land: Area, angle_rad: float) -> Layout:
        """Return the layout of the land with this row direction in all parts except narrow parts."""
        return tuple((part, 0.0 if self.is_narrow(part) else angle_rad) for part in self.core(land))

    def core(self, land: Area) -> list[Polygon]:
        """Return the parts of the land inside the headland passes."""
        return ring_strips(land, self.swath, self._passes)[1]

    def is_narrow(self, part: Polygon) -> bool:
        """Return whether the part's rows follow its middle line, so that their direction is fixed."""
        return self._lines_of(part) is not None

    def _lines_of(self, part: Polygon) -> list[Points] | None:
        if part not in self._strips:
            narrow = is_narrow(part, self.swath)
            self._strips[part] = strip_lines(part, self._room, self.swath) if narrow else None
        return self._strips[part]

    def _rows(self, part: Polygon, angle: float) -> list[NDArray[np.float64]]:
        lines = self._lines_of(part)
        return rows_that_see(part, self._room, self.swath, angle) if lines is None else lines

    def path(self, layout: Layout, *, exact: bool = False, returns: bool = True) -> Points:
        """Return the path of a layout.

        With `exact`, transit lengths go round corners, and short legs are removed. With `returns`, the
        order of the cells takes the return to the start into account.
        """
        start = np.asarray(self.request.start_xy_m)
        pieces = [] if self._last else self._rings(start)
        cells = [rows for part, angle in layout for rows in self._rows(part, angle)]
        if cells:
            here = pieces[-1][-1] if pieces else start
            pieces += fly_cells(cells, self._terrain, here, home_m=start if returns else None, exact=exact)
        if self._last:
            pieces += self._rings(pieces[-1][-1] if pieces else start)
        if not pieces:
            raise PlanningError(f"{NAME}: no row lies on land that the path may cross")
        legs, least_m = self._terrain.legs(pieces, start), self.request.least_leg_m
        points = np.vstack(legs)
        kept = distinct(points, 1e-6)
        if not exact or least_m <= 0.0:
            return points[kept]
        corner = np.concatenate(
            [np.arange(len(leg)) < len(leg) - len(piece) for leg, piece in zip(legs, pieces, strict=True)]
        )
        return without_short_legs(points[kept], corner[kept], least_m, self._terrain)

    def rough_m(self, layout: Layout) -> float:
        """Return the approximate length of a layout's rows, with turns as additional length."""
        length_m = 0.0
        for part, angle in layout:
            across = np.array([-math.sin(angle), math.cos(angle)])
            rows = np.ptp(product(shapely.get_coordinates(part), across)) / self.swath.spacing_m + 1.0
            length_m += part.area / self.swath.spacing_m
            length_m += 0.0 if self.is_narrow(part) else 2.0 * _TURN_M * float(rows)
        return length_m

    def seen_share(self, path: Points) -> float:
        """Return the fraction of the area that images along the path cover."""
        seen = self.swath.seen_from(path)
        return float(shapely.intersection(self.request.area, seen).area / self.request.area.area)

    def _rings(self, start_m: Points) -> list[Points]:
        """Return the headland passes in flight order from `start_m`: always the nearest ring next."""
        here, waiting, turns = start_m, list(self._ring_lines), []
        while waiting:
            lines = [shapely.linestrings(ring) for ring in waiting]
            nearest = int(np.argmin(shapely.distance(shapely.points(here), lines)))
            turns.append(ring_from(waiting.pop(nearest), here, 0.0))
            here = turns[-1][-1]
        return turns


def _room(room: Area, overshoot_m: float) -> Area:
    """Return the land that rows may cross: `room`, extended beyond its outer border, but not into holes."""
    if overshoot_m <= 0.0:
        return room
    holes = [Polygon(ring) for part in parts_of(room) for ring in part.interiors]
    wide = shapely.buffer(room, overshoot_m, join_style="mitre", mitre_limit=2.0)
    return shapely.difference(wide, shapely.union_all(holes))


class _Search:
    """The search for the cheapest layout."""

    def __init__(self, plans: _Plans) -> None:
        self._plans, self._request = plans, plans.request
        self._known: dict[Layout, float] = {}
        self._seen: dict[Layout, float] = {}  # Fraction of the area that each layout covers
        self._rough, self._shortest_m = False, math.inf

    def best(self) -> list[Layout]:
        """Return the cheapest layouts; their costs and the order of their cells are approximate."""
        lands = swept_lands(self._request)
        even = [math.radians(degrees) for degrees in range(0, 180, _EVERY_DEG)]
        angles = [*hull_angles(lands[0])[:_HULL_ANGLES], *even]
        self._price([self._plans.common(lands[0], angle) for angle in angles])
        # Row directions at decreasing angles to both sides of the best direction.
        for step in _FINER_DEG:
            angle = self._angle(self._best())
            beside = (angle - math.radians(step), angle + math.radians(step))
            self._price([self._plans.common(lands[0], turned % math.pi) for turned in beside])
        angle = self._angle(self._best())
        for land in lands[1:]:
            self._price([self._plans.common(land, turned) for turned in {angle, *hull_angles(land)[:1]}])
        if len(lands) > 1:
            self._toggle_gaps(lands[0], angle)
        self._turn_parts()
        self._cut(lambda part: [without_arms(part, self._plans.swath)])
        self._cut(lambda part: cut_parts(part, self._plans.swath.spacing_m))
        return self._ranked()[:_FINALISTS]

    def _best(self) -> Layout:
        return self._ranked()[0]

    def _ranked(self) -> list[Layout]:
        """Return layouts, cheapest first; layouts that cover clearly less than other layouts come last."""
        enough = max(self._seen.values(), default=0.0) - _AS_MUCH
        return sorted(self._known, key=lambda layout: (self._seen[layout] < enough, self._known[layout]))

    def _angle(self, layout: Layout) -> float:
        """Return the row direction of the layout's first part with more than one row."""
        return next((angle for part, angle in layout if not self._plans.is_narrow(part)), 0.0)

    def _price(self, layouts: Sequence[Layout]) -> None:
        new = [layout for layout in dict.fromkeys(layouts) if layout not in self._known]
        rough_m = [self._plans.rough_m(layout) for layout in new]
        self._shortest_m = min([self._shortest_m, *rough_m])
        # Layouts with many short rows are never the cheapest, and ordering their rows is slow.
        new = [layout for layout, m in zip(new, rough_m, strict=True) if m <= _LONGER * self._shortest_m]
        paths = [self._plans.path(layout) for layout in new]
        if not self._known:
            self._rough = max(map(path_length, paths), default=0.0) > _PRICED_M
        if self._rough:
            costs = [path_length(path) + _TURN_M * len(path) for path in paths]
        else:
            costs = self._request.costs(paths)
        self._known.update(zip(new, costs, strict=True))
        self._seen.update(zip(new, map(self._plans.seen_share, paths), strict=True))
        done = len(self._known)
        self._request.progress(done, done + len(new))

    def _toggle_gaps(self, land: Area, angle: float) -> None:
        """Try rows across each gap alone, then across all the gaps where crossing reduced the cost."""
        passable = self._request.room
        gaps = gaps_of(land, passable)[:_MOST_TOGGLED]
        alone = {k: self._plans.common(with_gaps(land, [gap]), angle) for k, gap in enumerate(gaps)}
        self._price(list(alone.values()))
        cut = self._known.get(self._plans.common(land, angle), math.inf)
        better = [gaps[k] for k, layout in alone.items() if self._known.get(layout, math.inf) < cut]
        if better:
            self._price([self._plans.common(with_gaps(land, better), angle)])

    def _turn_parts(self) -> None:
        """Try, for each part, two row directions along edges of the part's convex hull."""
        for number in range(min(len(self._best()), _MOST_TOGGLED)):
            layout = self._best()
            if number < len(layout) > 1 and not self._plans.is_narrow(part := layout[number][0]):
                self._price(
                    [
                        (*layout[:number], (part, angle), *layout[number + 1 :])
                        for angle in hull_angles(part)[:2]
                    ]
                )

    def _cut(self, ways: Callable[[Polygon], list[list[Polygon]]]) -> None:
        """Try each part's decompositions by `ways`, with a common row direction and with one per piece."""
        layout = self._best()
        angle = self._angle(layout)
        found: list[Layout] = []
        for number, (part, _) in enumerate(layout[:_MOST_TOGGLED]):
            if self._plans.is_narrow(part):
                continue
            for parts in filter(None, ways(part)):
                own = tuple((piece, hull_angles(piece)[0]) for piece in parts)
                mixed = tuple((piece, angle) for piece in parts)
                found += [(*layout[:number], *pieces, *layout[number + 1 :]) for pieces in (own, mixed)]
        self._price(found)
        if found:
            self._turn_parts()


def without_short_legs(points: Points, corner: NDArray[np.bool_], least_m: float, terrain: Terrain) -> Points:
    """Return the path without short legs next to a transit corner or next to another short leg.

    `corner`, bool[n], marks the points that are corners of transits between rows. Legs below `least_m` are
    short. Transit corners on the border are moved into the land, and points close to the path are removed.
    Short legs remain where neither is possible. A single short leg from row to row is kept.
    """
    k = 0
    while k < len(points) - 1:
        bad = _short_beside(points, corner, least_m)
        if not bad[k:].any():
            break
        k += int(np.argmax(bad[k:]))
        count = int(bad.sum())
        found = [
            (left, path_length(other), other, corners)
            for other, corners in _without_leg(points, corner, k, least_m, terrain)
            if (left := int(_short_beside(other, corners, least_m).sum())) < count
        ]
        if found:
            *_, points, corner = min(found, key=lambda change: change[:2])
            k = max(k - 2, 0)
        else:
            k += 1
    return points


def _short_beside(points: Points, corner: NDArray[np.bool_], least_m: float) -> NDArray[np.bool_]:
    """Return whether each leg is short and next to a transit corner or another short leg, bool[n - 1]."""
    short = np.hypot(*np.diff(points, axis=0).T) < least_m
    beside = corner[:-1] | corner[1:]
    beside[1:] |= short[:-1]
    beside[:-1] |= short[1:]
    return short & beside


def _without_leg(
    points: Points, corner: NDArray[np.bool_], k: int, least_m: float, terrain: Terrain
) -> Iterator[tuple[Points, NDArray[np.bool_]]]:
    """Yield changed paths in which leg k may no longer be short, each with its `corner` array."""
    for j in (k, k + 1):
        if not 0 < j < len(points) - 1:
            continue
        first, last = j, j
        if corner[j]:
            # All corners of a transit between two rows are replaced by a single corner.
            while first > 1 and corner[first - 1]:
                first -= 1
            while last < len(points) - 2 and corner[last + 1]:
                last += 1
            before, after = points[first - 1], points[last + 1]
            for place in _corners_instead(before, points[first : last + 1], after, least_m, terrain):
                yield (
                    np.vstack((points[:first], place, points[last + 1 :])),
                    np.concatenate((corner[:first], [True], corner[last + 1 :])),
                )
        before, after = points[j - 1], points[j + 1]
        if _from_leg_m(points[j], before, after) <= _NEAR * least_m and terrain.sees(before, after)[0]:
            yield np.delete(points, j, axis=0), np.delete(corner, j)


def _corners_instead(before: Points, way: Points, after: Points, least_m: float, terrain: Terrain) -> Points:
    """Return candidate positions of a corner that replaces a transit, `least_m` or more from both ends."""
    along = after - before
    along = along / max(float(np.hypot(*along)), 1e-9)
    across = np.array((-along[1], along[0]))
    side = np.sign(((way - before) * across).sum(axis=1))
    shifts = least_m * np.array([(aside, ahead) for aside in _ASIDE for ahead in _ALONG])
    places = np.vstack(
        [
            point + shifts[:, :1] * (sign or 1.0) * across + shifts[:, 1:] * along
            for point, sign in zip(way, side, strict=True)
        ]
    )
    far = (np.hypot(*(places - before).T) >= least_m) & (np.hypot(*(places - after).T) >= least_m)
    places = places[far]
    seen = terrain.sees(np.broadcast_to(before, places.shape), places)
    seen &= terrain.sees(places, np.broadcast_to(after, places.shape))
    return places[seen]


def _from_leg_m(point: Points, start: Points, end: Points) -> float:
    """Return the distance from a point to a leg."""
    leg = end - start
    share = float(((point - start) * leg).sum()) / max(float((leg * leg).sum()), 1e-12)
    return float(np.hypot(*(start + min(max(share, 0.0), 1.0) * leg - point)))
