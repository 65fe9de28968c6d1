"""Checks of the planner contract, also for planners of other packages."""

from __future__ import annotations

import inspect
import math
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from geo.grid import Crop
from geo.texts import unknown
from mission.errors import AnswerError, PlanningError
from mission.planners.budget import Budget, LengthBudget, StepBudget
from mission.planners.path import Area, PlannedPath
from mission.planners.request import CropArea, Planner, PlanningRequest, make_planner, planner_parameters

_INSIDE_M = 1e-6


class _TurnBudget:
    """A budget of flight time for all legs at 5 m/s, including the return leg, and 1.5 s per turn."""

    unit = "s"

    def __init__(self, limit: float, home: tuple[float, float]) -> None:
        self.limit = limit
        self._home = np.asarray(home)

    def cost(self, path_xy_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
        legs = np.hypot(*np.diff(np.vstack((path_xy_m, self._home)), axis=0).T)
        return float(legs.sum() / 5.0 + 1.5 * len(legs))


LANDS = ("convex", "concave", "pierced", "apart")
"""Kinds of land in the test problems: convex, concave, with a hole, in separate parts."""


def check_planner(planner: str | Planner, lands: Collection[str] = LANDS, /, **parameters: Any) -> None:
    """Check that a planner fulfils the contract.

    The problems have convex, concave, pierced and disconnected areas, budgets in several units, and starts
    inside and outside the area. The contract has these rules:

    - The result is a `PlannedPath` within the budget.
    - The path stays in the area, except for transits between separate parts.
    - Equal requests give equal paths.
    - The planner changes neither the request nor numpy's global generator.
    - A budget that is too small gives a path within the budget, or a `PlanningError` of one line.
    - Parameters are keyword-only arguments, each with a name and a default.

    Parameters
    ----------
    planner : str or Planner
        A name or a planner, as for `mission.planners.request.make_planner`.
    lands : collection of str
        Kinds of land (from `LANDS`) that the planner supports.
    **parameters
        Parameters of the planner.

    Raises
    ------
    AssertionError
        If a rule is broken; the text names the rule and the test problem.
    PlanningError, ParameterError
        If the object is not a planner, a parameter is unknown, or a kind of land is unknown.

    Examples
    --------
    >>> check_planner("random-waypoint", waypoints=20)
    """
    wrong = sorted(set(lands) - set(LANDS))
    if wrong or not lands:
        raise PlanningError(unknown("land", wrong[0], LANDS) if wrong else "no land to check on")
    chosen = make_planner(planner, **parameters)
    arguments = inspect.signature(chosen.planner).parameters
    by_place = [name for name, each in arguments.items() if each.kind is each.POSITIONAL_OR_KEYWORD][1:]
    _require(not by_place, f"parameter {', '.join(by_place)}", "it is not keyword-only; write *, before it")
    for name, argument in arguments.items():
        catches_all = argument.kind in (argument.VAR_KEYWORD, argument.VAR_POSITIONAL)
        _require(not catches_all, f"parameter {name}", "it takes any name, so a misspelt name goes unnoticed")
    for name, default in planner_parameters(chosen).items():
        _require(default is not inspect.Parameter.empty, f"parameter {name}", "it has no default")
    for what, request in conformance_requests(lands):
        _check_one(chosen, what, request)


def conformance_requests(lands: Collection[str] = LANDS) -> Iterator[tuple[str, PlanningRequest]]:
    """Yield the test problems on the given kinds of land, each as a description and a request."""
    areas: dict[str, tuple[str, Area]] = {
        "square": ("convex", shapely.box(0, 0, 60, 60)),
        "oblong off the origin": ("convex", shapely.box(1000, -500, 1100, -440)),
        "triangle": ("convex", Polygon([(0, 0), (80, 10), (20, 70)])),
        "L": ("concave", Polygon([(0, 0), (80, 0), (80, 20), (20, 20), (20, 80), (0, 80)])),
        "square with a pond": (
            "pierced",
            Polygon([(0, 0), (70, 0), (70, 70), (0, 70)], [[(20, 20), (20, 50), (50, 50), (50, 20)]]),
        ),
        "two fields": ("apart", MultiPolygon([shapely.box(0, 0, 30, 40), shapely.box(60, 10, 90, 50)])),
    }
    for name, (land, area) in areas.items():
        if land not in lands:
            continue
        inside = area.representative_point()
        x_min, y_min, x_max, y_max = area.bounds
        middle = (y_min + y_max) / 2
        crops = (
            *_crop(Crop.STRAWBERRY, shapely.intersection(area, shapely.box(x_min, y_min, x_max, middle))),
            *_crop(Crop.TOMATO, shapely.intersection(area, shapely.box(x_min, middle, x_max, y_max))),
        )
        outside = (x_min - 15.0, y_min - 5.0)
        budgets: dict[tuple[float, float], tuple[Budget, ...]] = {
            (inside.x, inside.y): (LengthBudget(1500.0), StepBudget(4000.0), LengthBudget(5.0)),
            outside: (
                LengthBudget(1200.0, return_to=outside),
                _TurnBudget(600.0, outside),
                LengthBudget(1.0, return_to=outside),
            ),
        }
        for start, choices in budgets.items():
            for budget in choices:
                request = PlanningRequest(area, start, budget, crop_areas=crops, seed=7)
                yield f"{name}, start {start}, budget {budget.limit:g} {budget.unit}", request


def _crop(crop: Crop, area: Area) -> tuple[CropArea, ...]:
    return (CropArea(crop, area),) if isinstance(area, Polygon | MultiPolygon) and area.area > 0 else ()


def _check_one(planner: Planner, what: str, request: PlanningRequest) -> None:
    before = shapely.to_wkb(request.area)
    state = np.random.get_state(legacy=False)  # noqa: NPY002
    path = _plan(planner, what, request)
    again = _plan(planner, what, request)
    after = np.random.get_state(legacy=False)  # noqa: NPY002
    _require(str(state) == str(after), what, "the planner drew from numpy's global generator")
    _require(shapely.to_wkb(request.area) == before, what, "the planner changed the area")
    _require((path is None) == (again is None), what, "of two equal requests, only one gave a path")
    if path is None or again is None:
        return
    same = np.array_equal(path.points_m, again.points_m) and path.spacing_m == again.spacing_m
    _require(same, what, "the same request gave two different paths")
    cost = request.cost(path.points_m)
    limit = request.budget.limit
    _require(math.isfinite(cost) and cost <= limit, what, f"the path costs {cost}, the budget is {limit}")
    points = path.points_m
    line = LineString(points) if len(points) > 1 else Point(points[0])
    # A path may cross between separate parts of the area in a straight line.
    room = request.room.convex_hull if isinstance(request.room, MultiPolygon) else request.room
    _require(bool(room.buffer(_INSIDE_M).covers(line)), what, "the path leaves the area")


def _plan(planner: Planner, what: str, request: PlanningRequest) -> PlannedPath | None:
    try:
        return planner(request)
    except AnswerError as error:
        raise AssertionError(f"{what}: {error}") from error
    except PlanningError as error:
        text = str(error)
        _require(
            bool(text.strip()) and "\n" not in text, what, f"the error is not one line of text: {text!r}"
        )
        _require(request.budget.limit < 1000 or request.budget.unit == "s", what, f"no path at all: {text}")
        return None


def _require(kept: bool, what: str, broken: str) -> None:
    if not kept:
        raise AssertionError(f"{what}: {broken}")
