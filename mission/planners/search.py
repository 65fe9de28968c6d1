"""The densest candidate that a budget allows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from mission.errors import PlanningError
from mission.planners.budget import BatchBudget
from mission.planners.path import Points
from mission.planners.request import PlanningRequest

LOOK_AHEAD = (1, 2, 3)
# Of a round, the second guess halves what the first one leaves.
_APART = 2
_SLOPE_OVER = 0.9


@dataclass(frozen=True, slots=True)
class Found:
    """The result of a search."""

    index: int  # The densest candidate within the budget
    points_m: Points  # float64[n, 2]: its points
    cost: float  # Its cost


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
    """Return the largest index whose candidate costs no more than the limit, by default that of the budget.

    The cost is only roughly monotone (rows that end on the far side have a longer way home), so the search
    brackets the last feasible index by interpolation and bisection, then tries a few candidates beyond it
    (`look_ahead`), and goes on from there if one of them is feasible. Only a candidate whose own cost was
    seen to be within the limit is returned.

    A budget that prices many paths at once gets them in rounds: a guess together with an index a little
    beyond it, which bound the last feasible one if the guess is good, and all of those beyond the last one.

    The cost is about linear in the `density` of an index. PlanningError if not even the sparsest candidates
    are within the limit; it says what they are (`what`: ``lawnmower with 2 rows``), and the least budget.
    """
    bound = request.budget.limit if limit is None else limit
    seen: dict[int, float] = {}
    best: Found | None = None
    cheapest: tuple[float, Points] | None = None
    rounds = 0

    at_once = isinstance(request.budget, BatchBudget)

    def feasible(*indices: int) -> bool:
        """Tell whether any is feasible; prices what is not priced yet, in one round if the budget can."""
        nonlocal best, cheapest, rounds
        for some in [indices] if at_once else [(index,) for index in indices]:
            new = [index for index in dict.fromkeys(some) if index not in seen]
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
            if any(seen[index] <= bound for index in some):
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
    """Return how many rounds bisection would take from here, and one for those beyond."""
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
    """Return an index strictly between good and bad (beyond good while no bad one is known)."""
    if bad is not None and bisect:
        return (good + bad) // 2
    last = highest if bad is None else bad - 1
    low, low_density = seen[good], density(good)
    if bad is not None:
        slope = (seen[bad] - low) / (density(bad) - low_density)
    else:
        # The slope between neighbours says little.
        apart = [index for index in seen if density(index) <= _SLOPE_OVER * low_density]
        below = max(apart, default=None)
        rise = low - (seen[below] if below is not None else 0.0)
        run = low_density - (density(below) if below is not None else 0.0)
        slope = rise / run if run > 0 else 0.0
    wanted = low_density + (bound - low) / slope if slope > 0 else density(last)
    return _last_below(density, wanted, good + 1, last)


def _last_below(density: Callable[[int], float], wanted: float, first: int, last: int) -> int:
    """Return the largest index in first..last whose density is not above the wanted one, at least first."""
    while first < last:
        middle = (first + last + 1) // 2
        if density(middle) <= wanted * (1 + 1e-12):
            first = middle
        else:
            last = middle - 1
    return first


def cannot_be_flown(request: PlanningRequest, points_m: Points, what: str) -> PlanningError:
    """Return the error of a sparsest path, ``what``, that has no finite cost."""
    budget = request.budget
    reason = request.reason(points_m) or "the vehicle cannot come back from it"
    return PlanningError(
        f"budget of {budget.limit:g} {budget.unit}: {what} cannot be flown: {reason}; "
        "take a smaller area, a nearer start, less wind or another vehicle"
    )


def too_small(request: PlanningRequest, points_m: Points, least: float, what: str) -> PlanningError:
    """Return the error of a budget below the least cost, that of the points.

    Where the vehicle cannot fly them either, the cost is what it spends until then: the error says why.
    """
    budget = request.budget
    reason = request.reason(points_m)
    besides = f"; the vehicle cannot fly it: {reason}" if reason else ""
    needed = least * (1 + 1e-9)
    digits = 0 if budget.unit == "steps" else 1
    scale = 10**digits
    rounded = -(-needed * scale // 1) / scale
    return PlanningError(
        f"budget of {budget.limit:g} {budget.unit} is too small: {what} needs at least "
        f"{rounded:.{digits}f} {budget.unit} with approach and return{besides}"
    )


def spacing_limits(
    planner: str, footprint_m: float, min_spacing_m: float | None, max_spacing_m: float | None
) -> tuple[float, float]:
    """Return the least and the greatest spacing that a planner may choose, metres."""
    for name, value in (("min_spacing_m", min_spacing_m), ("max_spacing_m", max_spacing_m)):
        if value is not None and not (is_number(value) and value > 0):
            msg = f"{planner}: {name} {value!r} is no distance in metres; give a number above zero"
            raise PlanningError(msg)
    least = max(footprint_m, min_spacing_m or 0.0)
    most = math.inf if max_spacing_m is None else max_spacing_m
    if most < least:
        reason = "the footprint" if least == footprint_m else "min_spacing_m"
        msg = f"{planner}: max_spacing_m {most:g} is less than {reason} of {least:g} m; give more"
        raise PlanningError(msg)
    return least, most


def is_number(value: object) -> bool:
    """Tell whether a planner's parameter is a finite number (True and False are none)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
