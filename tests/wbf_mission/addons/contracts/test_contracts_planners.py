from __future__ import annotations

import numpy as np
import pytest

from geo.named import ParameterError
from mission.errors import PlanningError
from mission.planners import PlannedPath, PlanningRequest
from mission.planners.lawnmower import lawnmower
from mission.planners.random_waypoint import random_waypoint
from mission.planners.spiral import rectangle_spiral
from wbf_mission import check_planner


@pytest.mark.parametrize(
    "text", ["lawnmower:direction=0.3", "adaptive-lawnmower", "spiral:min_spacing_m=4", "random-waypoint"]
)
def test_ours_conform(text):
    check_planner(text)


def test_an_object_is_checked_as_a_function_is():
    class Rows:
        def __call__(self, request, /, *, direction="x"):
            return lawnmower(request, direction=direction)

    check_planner(Rows(), direction="longest-side")
    with pytest.raises(ParameterError, match="planner Rows: unknown parameter 'angle': choose direction"):
        check_planner(Rows(), angle=1)


def over_budget(request):
    return PlannedPath(rectangle_spiral(request.area.bounds, 0.05), 0.05, "over")


def outside(request):
    return PlannedPath(np.array([request.start_xy_m]), None, "outside")


def random_state(request):
    np.random.default_rng()
    np.random.rand()  # noqa: NPY002
    return lawnmower(request)


def different_each_time(request):
    seed = np.random.default_rng().integers(1 << 30)
    changed = PlanningRequest(request.area, request.start_xy_m, request.budget, seed=int(seed))
    return random_waypoint(changed)


def not_a_path(request):
    return lawnmower(request).points_m


def nothing(request):
    return None


def never(request):
    raise PlanningError("not today")


@pytest.mark.parametrize(
    ("planner", "text"),
    [
        (over_budget, "costs"),
        (outside, "leaves"),
        (random_state, "global generator"),
        (different_each_time, "different"),
        (not_a_path, "planner not_a_path returned a ndarray, not a PlannedPath"),
        (nothing, "planner nothing returned a NoneType, not a PlannedPath"),
        (never, "no path"),
    ],
)
def test_the_kit_finds_what_is_wrong(planner, text):
    with pytest.raises(AssertionError, match=text):
        check_planner(planner)


def takes_anything(request, /, **parameters):
    return lawnmower(request)


def needs_a_parameter(request, /, *, direction):
    return lawnmower(request, direction=direction)


def takes_a_parameter_by_place(request, direction="x"):
    return lawnmower(request, direction=direction)


@pytest.mark.parametrize(
    ("planner", "text"),
    [
        (takes_anything, "parameters: it takes any name"),
        (needs_a_parameter, "direction: it has no default"),
        (takes_a_parameter_by_place, "direction: it is not keyword-only"),
    ],
)
def test_parameters_have_names_and_defaults(planner, text):
    with pytest.raises(AssertionError, match=text):
        check_planner(planner)
