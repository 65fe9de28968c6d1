"""Shortest ways inside, rows through polygons, and the search for the densest."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Polygon

from mission.errors import PlanningError
from mission.planners import LengthBudget, PlanningRequest, make_planner, path_length
from mission.planners.search import densest_feasible
from mission.planners.sweep import Sweep, sweep_angle
from mission.planners.terrain import Region


def star(seed, corners, reach=100.0):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    radius = rng.uniform(0.15, 1.0, corners) * reach
    return Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))))


def length_through(start, way, end):
    return path_length(np.vstack((start, way, end)))


@given(st.integers(0, 10_000), st.integers(5, 25))
@settings(max_examples=30, deadline=None)
def test_ways_stay_inside_and_are_no_longer_than_any_over_the_whole_graph(seed, corners):
    polygon = star(seed, corners)
    if not polygon.is_valid or polygon.area < 10:
        return
    region = Region(polygon)
    rng = np.random.default_rng(seed)
    places = rng.uniform(-100, 100, (400, 2))
    places = places[shapely.contains_xy(polygon, *places.T)][:4]
    nodes = np.vstack((places, region.corners))
    sees = np.array([region.sees(nodes, node) for node in nodes])
    graph = np.where(sees, np.hypot(*np.moveaxis(nodes[:, None] - nodes[None], -1, 0)), np.inf)
    for middle in range(len(nodes)):
        graph = np.minimum(graph, graph[:, middle, None] + graph[middle])
    for first in range(len(places)):
        for second in range(first):
            way = region.route(places[first], places[second])
            assert way is not None
            assert length_through(places[first], way, places[second]) == pytest.approx(graph[first, second])
            line = LineString(np.vstack((places[first], way, places[second])))
            assert polygon.buffer(1e-6).covers(line)


@given(st.integers(0, 10_000), st.integers(3, 25), st.integers(2, 60), st.floats(0.0, math.pi), st.booleans())
@settings(max_examples=60, deadline=None)
def test_rows_are_what_shapely_cuts(seed, corners, rows, angle, pierced):
    area = star(seed, corners)
    if not area.is_valid or area.area < 10:
        return
    if pierced:
        area = area.difference(area.representative_point().buffer(math.sqrt(area.area) / 8, quad_segs=4))
        if not isinstance(area, Polygon):
            return
    sweep = Sweep(area, 0.0, angle)
    pieces = sweep.pieces(rows, (0.0, 0.0))
    flown = shapely.linestrings(np.array(pieces))
    assert area.buffer(1e-6).covers(shapely.MultiLineString(list(flown)))
    turned = shapely.affinity.rotate(area, -angle, origin=(0, 0), use_radians=True)
    x_min, y_min, x_max, y_max = turned.bounds
    heights = np.linspace(y_min, y_max, rows)[1:-1]
    cut = sum(turned.intersection(LineString([(x_min - 1, y), (x_max + 1, y)])).length for y in heights)
    ends = np.array(pieces) @ np.array([-math.sin(angle), math.cos(angle)])
    inner = (ends.mean(axis=1) > y_min + 1e-5) & (ends.mean(axis=1) < y_max - 1e-5)
    assert shapely.length(flown[inner]).sum() == pytest.approx(cut, rel=1e-6, abs=1e-4)


def test_directions():
    tilted = shapely.affinity.rotate(shapely.box(0, 0, 100, 20), 30)
    assert sweep_angle(tilted) == pytest.approx(math.radians(30))
    assert sweep_angle(tilted, "longest-side") == pytest.approx(math.radians(30))
    assert sweep_angle(tilted, "x") == 0.0
    assert sweep_angle(tilted, 0.5) == 0.5
    assert sweep_angle(tilted, 0.5236) == sweep_angle(tilted), "its rounding"
    assert sweep_angle(tilted, -0.5236) == -0.5236, "another direction"
    assert sweep_angle(tilted, 0.5237) == 0.5237
    assert sweep_angle(shapely.box(0, 0, 20, 100)) == 0.0
    assert sweep_angle(shapely.box(0, 0, 20, 100), "fewest-turns") == pytest.approx(math.pi / 2)
    for nonsense in ("y", math.nan, True, (1.0,)):
        with pytest.raises(PlanningError, match="direction"):
            sweep_angle(tilted, nonsense)


@given(st.lists(st.integers(0, 12), min_size=1, max_size=80), st.integers(1, 500))
@settings(max_examples=200, deadline=None)
def test_the_search_returns_a_feasible_candidate_that_no_neighbour_beats(noise, limit):
    costs = [10 * index + wobble + 5 for index, wobble in enumerate(noise)]
    request = PlanningRequest(shapely.box(0, 0, 1, 1), (0, 0), LengthBudget(limit))
    asked = []

    def build(index):
        asked.append(index)
        return np.array([(costs[index], 0.0)])

    feasible = [index for index, cost in enumerate(costs) if cost <= limit]
    try:
        found = densest_feasible(request, build, 0, len(costs) - 1, what="test")
    except PlanningError as error:
        assert not [index for index in feasible if index <= 3]
        assert "needs at least" in str(error)
    else:
        # The cost falls by no more than 2 from one candidate to the next: the look-ahead sees past it.
        assert found.index == max(feasible)
        assert found.cost == costs[found.index] <= limit
    assert len(asked) == len(set(asked)) <= 22


def test_the_error_names_a_budget_that_suffices():
    def build(_):
        return np.array([(123.456, 0.0)])

    request = PlanningRequest(shapely.box(0, 0, 1, 1), (0, 0), LengthBudget(100.0))
    with pytest.raises(PlanningError, match=r"100 m is too small: two rows needs at least 123\.5 m"):
        densest_feasible(request, build, 1, 3, what="two rows")


class Watched:
    """Metres, which remembers the paths that it priced; long paths cannot be flown."""

    unit = "m"

    def __init__(self, limit, flown=math.inf):
        self.limit, self.flown, self.paths = limit, flown, []

    def cost(self, path_xy_m):
        self.paths.append(path_xy_m)
        length = path_length(path_xy_m)
        return length if length <= self.flown else math.inf

    def reason(self, path_xy_m):
        return f"the wings fall off after {self.flown:g} m"


def test_what_cannot_be_flown_is_refused_with_the_reason():
    area = shapely.box(0, 0, 100, 100)
    with pytest.raises(PlanningError) as caught:
        make_planner("lawnmower")(PlanningRequest(area, (0, 0), Watched(500.0, flown=50.0)))
    assert str(caught.value) == (
        "lawnmower with 2 rows cannot be flown: the wings fall off after 50 m; "
        "take a smaller area, a nearer start, less wind or another vehicle"
    )


@pytest.mark.parametrize("name", ["lawnmower", "spiral", "random-waypoint"])
def test_the_work_grows_with_the_parts_of_an_area_and_not_with_their_square(name, monkeypatch):
    calls = {"contains": 0, "sees": 0}
    for method in calls:
        original = getattr(Region, method)

        def counted(self, *points, method=method, original=original):
            calls[method] += 1
            return original(self, *points)

        monkeypatch.setattr(Region, method, counted)
    parts = [shapely.box(8 * i, 8 * k, 8 * i + 6, 8 * k + 6) for i in range(15) for k in range(15)]
    budget = Watched(1e4)
    path = make_planner(name)(PlanningRequest(shapely.MultiPolygon(parts), (0, 0), budget, 2.0, seed=3))
    assert len(path.points_m) > 100
    assert sum(calls.values()) <= 2 * sum(len(points) for points in budget.paths)
