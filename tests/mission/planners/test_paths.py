"""The four planners: within the budget, inside the area, as dense as can be, as in the paper."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from sweeps import sweep

from geo.grid import Crop
from mission.errors import PlanningError
from mission.planners import CropArea, LengthBudget, PlanningRequest, StepBudget, make_planner
from mission.planners.lawnmower import adaptive_lawnmower, lawnmower
from mission.planners.random_waypoint import random_waypoint
from mission.planners.spiral import SPACING_RATIO, rectangle_spiral, spiral, spiral_pieces
from mission.planners.sweep import Sweep, sweep_angle
from mission.planners.terrain import Terrain

GOLDEN = Path(__file__).parents[2] / "data" / "golden"
SQUARE = shapely.box(0, 0, 30, 30)
NAMES = ("adaptive-lawnmower", "lawnmower", "random-waypoint", "spiral")
SQUARE_CROPS = (
    CropArea(Crop.STRAWBERRY, shapely.box(0, 0, 30, 15)),
    CropArea(Crop.TOMATO, shapely.box(0, 15, 30, 30)),
)


@st.composite
def simple_polygons(draw):
    corners = draw(st.integers(3, 18))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radius = rng.uniform(0.1, 1.0, corners) * draw(st.floats(5.0, 400.0))
    points = np.column_stack((radius * np.cos(angle), radius * np.sin(angle))) + rng.uniform(-500, 500, 2)
    area = Polygon(points)
    assume(area.is_valid and area.area > 1.0)
    return area


rectangles = st.builds(
    lambda x, y, width, height: shapely.box(x, y, x + width, y + height),
    st.floats(-500, 500),
    st.floats(-500, 500),
    st.floats(0.2, 500),
    st.floats(0.2, 500),
)
places = st.tuples(st.floats(-1, 2), st.floats(-1, 2))


def problem(area, start, use, back, footprint, step_budget=False):
    """A request with its start in fractions of the bounds and its budget in multiples of the border."""
    x_min, y_min, x_max, y_max = area.bounds
    place = (x_min + start[0] * (x_max - x_min), y_min + start[1] * (y_max - y_min))
    limit = use * area.length
    budget = StepBudget(max(limit, 1), 1.0) if step_budget else LengthBudget(limit, place if back else None)
    middle = (y_min + y_max) / 2
    crops = []
    for crop, half in (
        (Crop.STRAWBERRY, shapely.box(x_min, y_min, x_max, middle)),
        (Crop.TOMATO, shapely.box(x_min, middle, x_max, y_max)),
    ):
        parts = [p for p in shapely.get_parts(area.intersection(half)) if isinstance(p, Polygon)]
        if parts:
            crops.append(CropArea(crop, MultiPolygon(parts)))
    width = footprint * math.sqrt(area.area)
    return PlanningRequest(area, place, budget, footprint_m=width, crop_areas=tuple(crops), seed=5)


def line_of(path):
    return LineString(path.points_m) if len(path.points_m) > 1 else Point(path.points_m[0])


@pytest.mark.parametrize("name", NAMES)
@given(
    st.one_of(rectangles, simple_polygons()),
    places,
    st.floats(0.01, 20.0),
    st.booleans(),
    st.floats(0.003, 0.3),
    st.booleans(),
)
@sweep(few=20, many=100)
def test_paths_are_within_the_budget_and_inside_the_area(name, area, start, use, back, footprint, steps):
    request = problem(area, start, use, back, footprint, steps)
    try:
        path = make_planner(name)(request)
    except PlanningError as error:
        assert "too small" in str(error)  # the budget; nothing else is wrong with the request
        assert "\n" not in str(error)
        return
    assert request.cost(path.points_m) <= request.budget.limit
    assert area.buffer(1e-6).covers(line_of(path))
    assert path.spacing_m is None or path.spacing_m >= 0


@pytest.mark.parametrize("name", NAMES)
@given(simple_polygons(), places, st.booleans())
@sweep(few=5, many=30)
def test_the_least_budget_of_the_error_suffices(name, area, start, back):
    request = problem(area, start, 0.002, back, 0.05)
    try:
        make_planner(name)(request)
    except PlanningError as error:
        least = float(str(error).split("needs at least ")[1].split()[0])
        budget = LengthBudget(least, request.start_xy_m if back else None)
        path = make_planner(name)(
            PlanningRequest(
                area, request.start_xy_m, budget, request.footprint_m, request.crop_areas, request.seed
            )
        )
        assert budget.cost(np.vstack((request.start_xy_m, path.points_m))) <= least


def planned(planner, request):
    """The planned path; an example without one is left out."""
    try:
        return planner(request)
    except PlanningError:
        assume(False)


@given(st.one_of(rectangles, simple_polygons()), places, st.floats(0.5, 10.0), st.booleans())
@sweep(few=10, many=50)
def test_no_denser_lawnmower_is_feasible(area, start, use, back):
    request = problem(area, start, use, back, 0.02)
    path = planned(lawnmower, request)
    terrain = Terrain(area, request.footprint_m)
    sweep = Sweep(terrain.flyable, request.footprint_m, sweep_angle(terrain.flyable))
    rows = round(sweep.spacing_m(2) / path.spacing_m) + 1 if sweep.most_rows > 1 else 1
    assert path.spacing_m >= request.footprint_m * (1 - 1e-6) or rows == 1
    for denser in range(rows + 1, min(2 * rows + 4, sweep.most_rows) + 1):
        points = terrain.join(sweep.pieces(denser, request.start_xy_m), request.start_xy_m)
        assert request.cost(points) > request.budget.limit


@given(rectangles, places, st.floats(1.0, 10.0), st.booleans())
@sweep(few=15, many=80)
def test_no_denser_spiral_is_feasible(area, start, use, back):
    request = problem(area, start, use, back, 0.02)
    path = planned(spiral, request)
    terrain = Terrain(area, request.footprint_m)
    for fraction in (SPACING_RATIO, 0.01, 0.03, 0.1, 0.3):
        denser = path.spacing_m * (1 - fraction)
        if denser >= request.footprint_m:
            points = terrain.join(
                spiral_pieces(terrain.flyable, denser, request.start_xy_m), request.start_xy_m
            )
            assert request.cost(points) > request.budget.limit


def test_the_lawnmower_is_the_papers():
    golden = np.load(GOLDEN / "Miniberry-30_lawnmower_AD.npz")["waypoints"]
    path = lawnmower(PlanningRequest(SQUARE, (0, 0), LengthBudget(360.0), footprint_m=0.0))
    assert np.array_equal(path.points_m, golden)
    assert (path.spacing_m, path.length_m) == (3.0, 360.0)


def test_the_spiral_is_the_papers():
    golden = np.load(GOLDEN / "Miniberry-30_spiral_AD.npz")["waypoints"]
    points = rectangle_spiral((0, 0, 30, 30), golden[3, 0])
    assert np.array_equal(points, golden)
    path = spiral(PlanningRequest(SQUARE, (0, 0), LengthBudget(480.4434), footprint_m=0.0))
    assert path.spacing_m == pytest.approx(1.9756, rel=SPACING_RATIO)
    assert path.length_m <= 480.4434


def test_the_adaptive_lawnmower_begins_as_the_papers():
    budget = LengthBudget(360.0)
    path = adaptive_lawnmower(PlanningRequest(SQUARE, (0, 0), budget, 0.0, SQUARE_CROPS))
    assert np.array_equal(
        path.points_m[:14], np.vstack(Sweep(shapely.box(0, 15, 30, 30), 0.0).pieces(7, (0, 0)))
    )
    assert path.points_m[14].tolist() == [30.0, 15.0]
    assert path.points_m[14:, 1].max() == 15.0
    assert budget.cost(np.vstack(((0, 0), path.points_m))) <= 360.0
    assert path.spacing_m == 2.5


def test_the_tomatoes_get_what_the_strawberries_cannot_use_and_give_what_they_need():
    def request(limit, footprint):
        return PlanningRequest(SQUARE, (0, 0), LengthBudget(limit), footprint, SQUARE_CROPS)

    scarce = adaptive_lawnmower(request(220.0, 0.5))
    assert scarce.points_m[:, 1].min() < 1
    with pytest.raises(PlanningError, match="needs at least"):
        adaptive_lawnmower(request(60.0, 0.5))
    crops = (CropArea(Crop.STRAWBERRY, shapely.box(0, 0, 30, 2)), SQUARE_CROPS[1])
    path = adaptive_lawnmower(PlanningRequest(SQUARE, (0, 0), LengthBudget(500.0), 1.0, crops))
    assert path.length_m > 460
    with pytest.raises(PlanningError, match="share"):
        adaptive_lawnmower(request(360.0, 0.0), tomato_share=1.0)


def test_random_waypoints_use_the_budget_up_and_follow_the_seed():
    def plan(limit, seed):
        return random_waypoint(
            PlanningRequest(SQUARE, (5, 5), LengthBudget(limit, (5, 5)), seed=seed)
        ).points_m

    for seed in (0, 1, np.random.SeedSequence(9)):
        points = plan(500.0, seed)
        cost = LengthBudget(1.0, (5, 5)).cost(points)
        assert 499.5 < cost <= 500.0
        longer = plan(900.0, seed)
        assert np.array_equal(points[:-1], longer[: len(points) - 1])
        assert np.array_equal(points, plan(500.0, seed))
    assert not np.array_equal(plan(500.0, 1)[1], plan(500.0, 2)[1])


@pytest.mark.parametrize("name", NAMES)
def test_hostile_areas(name):
    teeth = [(x + dx, y) for x in range(0, 100, 10) for dx, y in ((0, 1), (0, 50), (4, 50), (4, 1))]
    areas = {
        "comb": Polygon([*teeth, (100, 1), (100, 0), (0, 0)]),
        "neck": shapely.union_all(
            [shapely.box(0, 0, 50, 50), shapely.box(49, 25, 101, 25.01), shapely.box(100, 0, 150, 50)]
        ),
        "sliver": shapely.affinity.rotate(shapely.box(0, 0, 500, 0.05), 17),
        "tiny": shapely.box(0, 0, 0.01, 0.01),
        "hole at the border": Polygon(
            [(0, 0), (100, 0), (100, 100), (0, 100)], [[(0, 50), (20, 40), (20, 60)]]
        ),
        "far away": shapely.affinity.translate(shapely.box(0, 0, 90, 90), 5e5, 3.1e6),
        "holes": shapely.box(0, 0, 90, 90).difference(
            shapely.union_all(
                [Point(x, y).buffer(6, quad_segs=3) for x in (20, 45, 70) for y in (20, 45, 70)]
            )
        ),
    }
    for what, area in areas.items():
        start = area.representative_point().coords[0]
        limit = 20 * area.length
        budget = LengthBudget(limit, start)
        path = make_planner(name)(PlanningRequest(area, start, budget, footprint_m=1.0, seed=2))
        assert budget.cost(np.vstack((start, path.points_m))) <= limit, what
        assert area.buffer(1e-6).covers(line_of(path)), what


@pytest.mark.parametrize("side_m", [3.0, 5.0, 8.0])
@given(seed=st.integers(0, 1000))
@sweep(few=5, many=20)
def test_random_waypoints_of_a_small_patch_are_not_left_out(side_m, seed):
    def walk(limit, least_leg_m):
        area, budget = shapely.box(0, 0, side_m, side_m), LengthBudget(limit)
        return random_waypoint(PlanningRequest(area, (0, 0), budget, seed=seed, least_leg_m=least_leg_m))

    path = walk(200.0, 2.0).points_m
    legs_m = np.hypot(*np.diff(path, axis=0).T)[:-1]
    assert not ((legs_m[1:] < 2.0) & (legs_m[:-1] < 2.0)).any()
    assert (legs_m < 2.0).sum() <= (0.2 * len(legs_m) if side_m < 4.0 else 0)
    # The same places in the same order, whatever the budget.
    shorter = walk(90.0, 2.0).points_m
    np.testing.assert_array_equal(shorter[:-1], path[: len(shorter) - 1])
    drawn = walk(200.0, 0.0).points_m
    assert len(drawn) >= len(path)
    assert (np.hypot(*np.diff(drawn, axis=0).T) < 2.0).any()
