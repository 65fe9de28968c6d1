"""Search for the densest path within a budget, with rows that cross the gaps of the area or skip them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import shapely
from shapely.geometry import Polygon

from geo.farm import united
from geo.texts import is_number
from mission.errors import PlanningError
from mission.planners.budget import BatchBudget
from mission.planners.path import Area, PlannedPath, Points
from mission.planners.request import PlanningRequest
from mission.planners.terrain import area_of, parts_of, polygons_of

LOOK_AHEAD = (1, 2, 3)
# The second guess of a round is the midpoint between the first guess and the upper bound.
_APART = 2
_SLOPE_OVER = 0.9  # Cost slopes are measured between densities at least 10 % apart; closer pairs are noisy.
_LEAST_SHARE = 1e-6  # Smaller gaps, as a fraction of the area, are artefacts of rounding.
_WORTH = 1.05  # Turns cost flight quality: a path with more turns must be denser by this factor.


@dataclass(frozen=True, slots=True)
class Found:
    """The densest candidate path within a budget."""

    index: int  # Index of the candidate.
    points_m: Points  # Points of the path, float64[n, 2].
    cost: float  # Cost of the path.


def densest_feasible(
    request: PlanningRequest,
    build: Callable[[int], Points],
    lowest: int,
    highest: int,
    *,
    what: str,
    density: Callable[[int], float] = float,
    limit: float | None = None,
    look_ahead: tuple[int, ...] = LOOK_AHEAD,
) -> Found:
    """Return the candidate with the largest index that costs at most `limit` (default: the budget's limit).

    The cost grows only roughly with the index: rows that end on the far side have a longer return. The search
    therefore brackets the last feasible index by interpolation and bisection, then tries a few candidates
    beyond this index (`look_ahead`). If one of these is feasible, the search starts again from it. The cost
    of the returned candidate is always evaluated, never interpolated, and within the limit.

    With a `BatchBudget`, each round evaluates several candidates. The first round tests a guessed index and a
    larger index; if the guess is good, the last feasible index lies between the two. Further rounds narrow
    this interval, and the last round tests all candidates of `look_ahead`.

    The cost should be roughly linear in `density(index)`. If even the sparsest candidates cost more than the
    limit, a PlanningError states the minimum budget of `what` (such as ``lawnmower with 2 rows``).
    """
    bound = request.budget.limit if limit is None else limit
    seen: dict[int, float] = {}
    best: Found | None = None
    cheapest: tuple[float, Points] | None = None
    rounds = 0

    at_once = isinstance(request.budget, BatchBudget)

    def feasible(*indices: int) -> bool:
        """Return whether any of the indices is feasible; a `BatchBudget` evaluates them in one round."""
        nonlocal best, cheapest, rounds
        for batch in [indices] if at_once else [(index,) for index in indices]:
            new = [index for index in dict.fromkeys(batch) if index not in seen]
            paths = [build(index) for index in new]
            for index, points, cost in zip(new, paths, request.costs(paths), strict=True):
                seen[index] = cost
                if cheapest is None or cost < cheapest[0]:
                    cheapest = cost, points
                if cost <= bound and (best is None or index > best.index):
                    best = Found(index, points, cost)
            if new:
                rounds += 1
                request.progress(rounds, rounds + _rounds_left(best, seen, highest))
            if any(seen[index] <= bound for index in batch):
                return True
        return False

    sparsest = range(lowest, min(lowest + 3, highest) + 1)
    if not feasible(lowest) and not feasible(*sparsest):
        least = min(seen.values())
        if not math.isfinite(least):
            raise cannot_be_flown(request, build(lowest), what)
        assert cheapest is not None
        raise too_small(request, cheapest[1], least, what)
    while best is not None and best.index < highest:
        good = best.index
        bad = min((index for index in seen if index > good), default=None)
        halve = 0
        while bad is None or bad - good > 1:
            guess = _guess(seen, bound, good, bad, highest, density, bisect=halve >= 2)
            width = (bad or highest + 1) - good
            beyond = guess
            if at_once:
                beyond += 1 if bad is None else max(1, (bad - guess) // _APART)
            if feasible(guess, min(beyond, highest)):
                good = max(index for index in seen if seen[index] <= bound)
                bad = min((index for index in seen if index > good), default=None)
            else:
                bad = guess
            if good == highest:
                break
            halve = halve + 1 if (bad or highest + 1) - good > width / 2 else 0
        ahead = [good + step for step in look_ahead if good + step <= highest]
        if not ahead or not feasible(*ahead):
            break
    assert best is not None
    return best


def _rounds_left(best: Found | None, seen: dict[int, float], highest: int) -> int:
    """Return the number of rounds that bisection would still need, plus a round that looks ahead."""
    if best is None:
        return 1
    bad = min((index for index in seen if index > best.index), default=highest + 1)
    return (bad - best.index - 1).bit_length() + 1


def _guess(
    seen: dict[int, float],
    bound: float,
    good: int,
    bad: int | None,
    highest: int,
    density: Callable[[int], float],
    *,
    bisect: bool,
) -> int:
    """Return an index strictly between `good` and `bad`, or above `good` if `bad` is None."""
    if bad is not None and bisect:
        return (good + bad) // 2
    last = highest if bad is None else bad - 1
    low, low_density = seen[good], density(good)
    if bad is not None:
        slope = (seen[bad] - low) / (density(bad) - low_density)
    else:
        # The slope of the cost between neighbouring indices is mostly noise.
        apart = [index for index in seen if density(index) <= _SLOPE_OVER * low_density]
        below = max(apart, default=None)
        rise = low - (seen[below] if below is not None else 0.0)
        run = low_density - (density(below) if below is not None else 0.0)
        slope = rise / run if run > 0 else 0.0
    wanted = low_density + (bound - low) / slope if slope > 0 else density(last)
    return _last_below(density, wanted, good + 1, last)


def _last_below(density: Callable[[int], float], wanted: float, first: int, last: int) -> int:
    """Return the largest index in first..last whose density is at most `wanted`, else `first`."""
    while first < last:
        middle = (first + last + 1) // 2
        if density(middle) <= wanted * (1 + 1e-12):
            first = middle
        else:
            last = middle - 1
    return first


def cannot_be_flown(request: PlanningRequest, points_m: Points, what: str) -> PlanningError:
    """Return the error to raise if even the sparsest path, named `what`, has an infinite cost."""
    reason = request.reason(points_m) or "the vehicle cannot return from this path"
    remedy = "take a smaller area, a nearer start, less wind or another vehicle"
    return PlanningError(f"{what} cannot be flown: {reason}; {remedy}")


def too_small(request: PlanningRequest, points_m: Points, least: float, what: str) -> PlanningError:
    """Return the error for a budget below `least`, the cost of the cheapest path `points_m`.

    If the vehicle cannot fly this path to its end, `least` is the cost of the part that it can fly, and the
    error adds the reason.
    """
    budget = request.budget
    reason = request.reason(points_m)
    besides = f"; the vehicle cannot fly this path: {reason}" if reason else ""
    needed = least * (1 + 1e-9)
    digits = 0 if budget.unit == "steps" else 1
    scale = 10**digits
    rounded = -(-needed * scale // 1) / scale
    return PlanningError(
        f"budget of {budget.limit:g} {budget.unit} is too small: {what} needs at least "
        f"{rounded:.{digits}f} {budget.unit} with approach and return{besides}"
    )


def gaps_of(area: Area, passable: Area) -> list[Polygon]:
    """Return the gaps of an area, largest first: passable land inside its convex hull but outside the area.

    >>> field = shapely.box(0, 0, 9, 9)
    >>> [gap.area for gap in gaps_of(field - shapely.box(3, 3, 5, 5), field)]
    [4.0]
    """
    hull = shapely.intersection(area.convex_hull, passable)
    least_m2 = _LEAST_SHARE * area.area
    return sorted(polygons_of(shapely.difference(hull, area), least_m2), key=lambda gap: -gap.area)


def with_gaps(area: Area, gaps: Sequence[Polygon]) -> Area:
    """Return the union of an area and some of its gaps."""
    return area_of(polygons_of(united([area, *gaps])))


def swept_lands(request: PlanningRequest) -> list[Area]:
    """Return the areas to try for rows: the area itself, with its enclosed gaps, and with all its gaps.

    None of these is always best: rows that skip a pond are shorter than rows across it, but have more turns.
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
    """Call `plan` for each of the `swept_lands`, and return the path with the least spacing.

    A path that skips gaps is chosen only if it is 5 % denser. If `plan` always fails, its PlanningError is
    raised.
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
    # The last land includes all gaps, so its rows are in the fewest pieces.
    best = paths.pop()
    for path in reversed(paths):
        if _density(path) > _WORTH * _density(best):
            best = path
    return best


def _density(path: PlannedPath) -> float:
    return 1.0 / path.spacing_m if path.spacing_m else 0.0


def spacing_limits(
    planner: str, footprint_m: float, min_spacing_m: float | None, max_spacing_m: float | None
) -> tuple[float, float]:
    """Return the least and the greatest spacing that a planner may choose (m)."""
    for name, value in (("min_spacing_m", min_spacing_m), ("max_spacing_m", max_spacing_m)):
        if value is not None and not (is_number(value) and value > 0):
            msg = f"{planner}: {name} {value!r} is not a distance in metres; give a number above zero"
            raise PlanningError(msg)
    least = max(footprint_m, min_spacing_m or 0.0)
    most = math.inf if max_spacing_m is None else max_spacing_m
    if most < least:
        reason = "the footprint" if least == footprint_m else "min_spacing_m"
        msg = f"{planner}: max_spacing_m {most:g} is less than {reason} of {least:g} m; give more"
        raise PlanningError(msg)
    return least, most
