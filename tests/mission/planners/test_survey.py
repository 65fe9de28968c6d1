"""The survey sees its whole area, in a direction that nothing tried beats, and in a short order."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import MultiPolygon, Polygon
from swath import seen_share
from sweeps import sweep

from mission.errors import PlanningError
from mission.planners import LengthBudget, PlanningRequest, make_planner
from mission.planners.cornering import Cornering
from mission.planners.path import Area, path_length
from mission.planners.strips import Swath, cut_parts, ring_strips, rows_that_see, width
from mission.planners.survey import survey, without_short_legs
from mission.planners.sweep import fly_cells
from mission.planners.terrain import Terrain

L = Polygon([(0, 0), (200, 0), (200, 50), (50, 50), (50, 200), (0, 200)])
FIELD = shapely.box(0, 0, 200, 150)
POND = Polygon([(60, 40), (60, 100), (130, 110), (140, 50)])
APART = MultiPolygon([shapely.box(0, 0, 60, 150), Polygon([(90, 0), (250, 60), (240, 110), (85, 60)])])
HOME = (-10.0, -10.0)


class WindBudget:
    """Seconds at 8 m/s through the air, in a wind along x, with 3 s a turn, and home."""

    unit = "s"

    def __init__(self, wind_m_s: float, limit: float = 1e6) -> None:
        self.limit, self._wind = limit, wind_m_s

    def cost(self, path_xy_m: np.ndarray) -> float:
        steps = np.diff(np.vstack((path_xy_m, HOME)), axis=0)
        length = np.maximum(np.hypot(*steps.T), 1e-9)
        along, across = self._wind * steps[:, 0] / length, self._wind * steps[:, 1] / length
        ground = np.minimum(np.sqrt(64.0 - across**2) + along, 8.0)
        return float((length / ground).sum() + 3.0 * len(steps))


def ask(area: Area, spacing_m: float = 9.0, wind_m_s: float = 0.0, **more: Any) -> PlanningRequest:
    more = {"budget": WindBudget(wind_m_s), "footprint_along_m": 8.0, **more}
    return PlanningRequest(area, HOME, footprint_m=12.0, row_spacing_m=spacing_m, **more)


def inside(path: np.ndarray, room: Area) -> bool:
    return bool(shapely.covers(shapely.buffer(room, 1e-6), shapely.LineString(path)))


@pytest.mark.parametrize(
    ("area", "wanted"),
    [
        (L, {"headland_passes": 1}),
        (FIELD, {}),
        (FIELD - POND, {"headland_passes": 2, "headland": "last"}),
        (APART, {}),
    ],
    ids=["L", "field", "pond", "apart"],
)
def test_the_whole_area_is_seen_from_within(area: Area, wanted: dict[str, Any]) -> None:
    path = survey(ask(area), **wanted)
    assert seen_share(path, area, 12.0) > 0.985
    assert inside(path.points_m, area.convex_hull if area is APART else area)
    assert path.spacing_m == 9.0


@pytest.mark.parametrize("passes", [1, 2])
def test_headland_passes_that_see_everything_leave_no_rows(passes: int) -> None:
    area = shapely.box(0, 0, 40, 20)
    path = survey(ask(area), headland_passes=passes)
    # A detour of 2 m into each corner, which images along the other legs do not show
    south = [[6, 4], [6, 6], [34, 6], [36, 6], [34, 6]]
    north = [[34, 14], [34, 16], [34, 14], [6, 14], [4, 14], [6, 14]]
    assert path.points_m.tolist() == [*south, *north, [6, 6], [6, 4]]


@pytest.mark.parametrize("spike_m", [20.0, 60.0, 119.0])
def test_headland_passes_show_the_corners_of_the_land(spike_m: float) -> None:
    """Images are 12 m wide and 8 m long, and turned into the direction of flight."""
    area = Polygon([(0, 0), (150, 0), (150 - spike_m, 90), (30, 90)])
    path = survey(ask(area), headland_passes=1).points_m
    legs = shapely.linestrings(np.stack((path[:-1], path[1:]), axis=1))
    ahead = [affinity.scale(leg, 1 + 8 / leg.length, 1 + 8 / leg.length) for leg in legs if leg.length]
    seen = shapely.union_all([shapely.buffer(leg, 6.0, cap_style="flat") for leg in ahead])
    assert shapely.difference(area, seen).area < 0.001 * area.area
    assert inside(path, area)


@pytest.mark.parametrize(
    ("area", "footprint_m", "spacing_m", "along_m"),
    [
        # Turned so that its rows are level, this border crosses itself.
        (
            "-108.65717794247765 53.264338208641696, -12.461996105379335 23.550870741611345,"
            " 18.112755358197298 127.03884313278371, 35.8034648419513 36.92780567592745,"
            " 80.40734129933305 14.012584669953243, 81.72348192351895 -17.523011298951847,"
            " -114.01510068903931 24.44692578682459, -108.65717794247765 53.264338208641696",
            5.539256305993103,
            3.9154,
            4.0,
        ),
        # Images along one of the layouts of this field have an outline that crosses itself.
        (
            "0 0, 0 150, 200 150, 200 0, 84.75203368260594 0, 84.75203368260594 89.18803161776263,"
            " 60 89.18803161776263, 60 0, 0 0",
            5.2887498332057294,
            5.2887498332057294 * 0.6855762465495452,
            5.2887498332057294 * 0.5,
        ),
    ],
    ids=["turned", "seen"],
)
def test_an_outline_that_rounding_lets_cross_itself_is_no_error(
    area: str, footprint_m: float, spacing_m: float, along_m: float
) -> None:
    land = shapely.from_wkt(f"POLYGON (({area}))")
    more = {"row_spacing_m": spacing_m, "footprint_along_m": along_m}
    request = PlanningRequest(land, HOME, LengthBudget(1e7), footprint_m, **more)
    assert seen_share(survey(request), land, footprint_m) > 0.985


@st.composite
def stars(draw: st.DrawFn) -> Polygon:
    count = draw(st.integers(3, 12))
    radii = draw(st.lists(st.floats(25.0, 120.0), min_size=count, max_size=count))
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False) + draw(st.floats(0.0, 1.0))
    return Polygon(np.column_stack((radii * np.cos(angles), radii * np.sin(angles))))


@sweep(few=12, many=60)
@given(stars(), st.floats(0.0, 180.0))
def test_rows_with_overlap_see_any_star_wholly(area: Polygon, angle: float) -> None:
    swath = Swath(12.0, 8.0, 5.0)
    cells = rows_that_see(area, area, swath, math.radians(angle))
    rows = [row for cell in cells for row in cell]
    lines = shapely.buffer(shapely.linestrings(rows), 6.0, quad_segs=4)
    assert area.difference(shapely.union_all(lines)).area < 0.01 * area.area
    assert all(inside(row, area) for row in rows if not np.allclose(row[0], row[1]))


def test_what_lies_beside_a_row_that_has_to_stay_out_has_rows_of_its_own() -> None:
    """The one row of a strip would lead through the pond; above and below it there is land to be seen."""
    area = shapely.box(0, 0, 100, 12) - shapely.box(20, 4, 80, 8)
    rows = [row for cell in rows_that_see(area, area, Swath(12.0, 8.0, 12.0), 0.0) for row in cell]
    assert sorted({float(row[0, 1]) for row in rows}) == [2.0, 6.0, 10.0]
    assert all(inside(row, area) for row in rows)


@pytest.mark.parametrize("wind_m_s", [0.0, 6.5])
def test_no_fixed_angle_is_cheaper_than_the_best(wind_m_s: float) -> None:
    request = ask(shapely.box(0, 0, 160, 150), wind_m_s=wind_m_s)
    best = request.cost(survey(request).points_m)
    fixed = [request.cost(survey(request, angle=float(one)).points_m) for one in range(0, 180, 15)]
    assert best <= min(fixed) + 1e-6


def test_the_direction_is_refined_between_those_that_are_tried_first() -> None:
    """Across a strong wind from 45 degrees, over an octagon, none of the first directions is the best."""
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / math.sqrt(2.0)

    class Turned(WindBudget):
        def cost(self, path_xy_m: np.ndarray) -> float:
            return super().cost(path_xy_m @ turn)

    disc = shapely.Point(0.0, 0.0).buffer(150.0, quad_segs=2)
    path = survey(ask(disc, budget=Turned(7.0))).points_m
    steps = np.diff(path, axis=0)
    longest = steps[np.hypot(*steps.T).argmax()]
    assert math.degrees(math.atan2(longest[1], longest[0])) % 180.0 == pytest.approx(135.0, abs=8.0)


def test_parts_have_rows_of_their_own_direction() -> None:
    """Both arms of the L have rows along them, which is cheaper than any common direction."""
    request = ask(L)
    both = request.cost(survey(request).points_m)
    assert both < 0.95 * min(request.cost(survey(request, angle=one).points_m) for one in (0.0, 45.0, 90.0))
    assert sum(map(width, cut_parts(L, 9.0)[0])) == pytest.approx(100.0)
    assert cut_parts(FIELD, 9.0) == []


def test_a_row_leads_over_a_pond_where_that_is_cheaper() -> None:
    small = shapely.box(98, 60, 102, 80)
    for pond, over in ((small, True), (shapely.box(6, 4, 194, 146), False)):
        path = survey(ask(FIELD - pond, passable=FIELD))
        over_it = shapely.LineString(path.points_m).intersection(pond).length / (pond.area / 9.0)
        assert (over_it > 0.5) is over
    cut = ask(FIELD - small)
    assert not shapely.LineString(survey(cut).points_m).intersects(shapely.buffer(small, -0.01))


def test_the_order_of_cells_is_the_best_of_all() -> None:
    """Of every order of the cells, each begun at any of its corners."""
    corners = np.random.default_rng(5).uniform(0, 400, (4, 2))
    cells = [
        np.array([[[x, y + 5 * k], [x + 30, y + 5 * k]] for k in range(count)])
        for (x, y), count in zip(corners, (1, 2, 3, 4), strict=True)
    ]

    def length(rows: Any) -> float:
        return path_length(np.vstack((HOME, *rows, HOME)))

    ways = [
        [
            [row[:: (-1) ** (k + first)] for k, row in enumerate(rows)]
            for rows in (cell, cell[::-1])
            for first in (0, 1)
        ]
        for cell in cells
    ]
    best = min(
        length(itertools.chain(*flown))
        for order in itertools.permutations(ways)
        for flown in itertools.product(*order)
    )
    terrain = Terrain(shapely.box(-50, -50, 500, 500), 0.0)
    assert length(fly_cells(cells, terrain, HOME, home_m=HOME)) == pytest.approx(best)


def test_rings_and_rows_overlap_and_leave_nothing() -> None:
    swath = Swath(12.0, 8.0, 9.0)
    rings, left = ring_strips(FIELD, swath, 2, least_leg_m=0.0)
    assert [shapely.LinearRing(ring).bounds for ring in rings] == [(4, 4, 196, 146), (15, 15, 185, 135)]
    # The outer ring lies 6 m inside, with detours of 2 m into the corners.
    assert np.min(np.abs(rings[0][:, 1] - 6.0)) == 0.0
    # A detour along the bisector is longer, 6 √2 - 4 m.
    bisecting, short = (ring_strips(FIELD, swath, 1, least_leg_m=m)[0] for m in (3.0, 5.0))
    assert np.min(bisecting[0]) == pytest.approx(6.0 - (6.0 - 4.0 / math.sqrt(2.0)))
    assert shapely.LinearRing(short[0]).bounds == (6, 6, 194, 144)
    # Two passes see 21 m from the border; the rows' land begins 3 m within that.
    assert [part.bounds for part in left] == [(18, 18, 182, 132)]


def test_overshoot_leads_beyond_the_border_but_not_over_holes() -> None:
    path = survey(ask(FIELD - POND), angle=0.0, overshoot_m=20.0).points_m
    assert path[:, 0].min() == pytest.approx(-16.0)
    assert path[:, 0].max() == pytest.approx(216.0)
    assert not shapely.LineString(path).intersects(shapely.buffer(POND, -0.01))
    shorter = survey(ask(FIELD), angle=0.0, overshoot_m=-5.0).points_m
    assert shorter[:, 0].min() == pytest.approx(9.0)


def test_the_border_may_be_seen_as_often_as_the_rest() -> None:
    """Rows lie half a spacing from the sides, and end at the border."""
    path = survey(ask(FIELD), angle=0.0, border="overlap").points_m
    rows = np.unique(np.round(path[:, 1], 6))
    assert (rows[0], rows[-1]) == pytest.approx((4.5, 145.5))
    assert np.diff(rows).max() <= 9.0 + 1e-6
    assert (path[:, 0].min(), path[:, 0].max()) == pytest.approx((0.0, 200.0), abs=1e-6)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"angle": "north"}, "neither best nor degrees"),
        ({"spacing_m": 0.0}, "spacing_m 0.0"),
        ({"overshoot_m": math.nan}, "overshoot_m nan"),
        ({"headland_passes": -1}, "headland_passes"),
        ({"headland": "middle"}, "neither first nor last"),
        ({"border": "fence"}, "neither seen nor overlap"),
    ],
)
def test_wrong_parameters_are_refused(wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(PlanningError, match=told):
        survey(ask(FIELD), **wrong)


def ask_high(area: Area) -> PlanningRequest:
    """Ask for a survey by a mapping camera at 50 m."""
    more: dict[str, Any] = {"footprint_m": 51.3, "row_spacing_m": 15.4, "footprint_along_m": 17.1}
    return PlanningRequest(area, HOME, LengthBudget(1e7), **more)


def turned(area: Area, degrees: float) -> Area:
    return affinity.rotate(area, degrees, origin=(0.0, 0.0))


@pytest.mark.parametrize("height_m", [80.0, 100.0, 200.0])
def test_land_round_a_small_hole_is_seen_on_all_sides(height_m: float) -> None:
    area = shapely.box(0, 0, 215, 222) - shapely.box(97, 100, 118, 122)
    across, along = 1.194 * height_m, 0.896 * height_m
    more: dict[str, Any] = {"row_spacing_m": 0.3 * across, "footprint_along_m": along}
    path = survey(PlanningRequest(area, HOME, LengthBudget(1e7), footprint_m=across, **more)).points_m
    ways = np.diff(path, axis=0)
    ends = 0.5 * along * ways / np.hypot(*ways.T)[:, None]
    legs = shapely.linestrings(np.stack((path[:-1] - ends, path[1:] + ends), axis=1))
    seen = shapely.union_all(shapely.buffer(legs, 0.5 * across, cap_style="flat"))
    assert shapely.intersection(area, seen).area > 0.985 * area.area


@sweep(few=5, many=25)
@given(st.floats(60.0, 900.0), st.floats(0.5, 50.0), st.floats(0.0, 180.0))
@example(854.0, 3.0, 17.5)
@example(854.0, 10.0, 57.0)
def test_a_strip_is_one_row_in_any_direction(length_m: float, width_m: float, degrees: float) -> None:
    strip = turned(shapely.box(0.0, 0.0, length_m, width_m), degrees)
    path = survey(ask_high(strip))
    longer_m = max(length_m, width_m)
    assert len(path.points_m) == 2
    assert path.length_m == pytest.approx(longer_m - 17.1, abs=0.1)
    assert seen_share(path, strip, 51.3) > 0.99 and inside(path.points_m, strip)


@pytest.mark.parametrize(
    ("line", "most"),
    [
        (shapely.LineString([(x, 100.0 * math.sin(x / 48.0)) for x in range(0, 601, 5)]), 24),
        (shapely.MultiLineString([[(0, 0), (400, 0)], [(200, 0), (200, 200)]]), 6),
        (shapely.box(0, 0, 300, 200).exterior, 9),
    ],
    ids=["waves", "branch", "ring"],
)
def test_strips_of_any_form(line: shapely.Geometry, most: int) -> None:
    strip = line.buffer(3.0)
    path = survey(ask_high(strip))
    assert len(path.points_m) <= most
    assert seen_share(path, strip, 51.3) > 0.99


@pytest.mark.parametrize("planner", ["survey", "spiral", "lawnmower", "random-waypoint"])
def test_every_planner_takes_rings_of_very_many_vertices(planner: str) -> None:
    angles = np.linspace(0.0, 2.0 * math.pi, 4000, endpoint=False)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    area = Polygon(200.0 * circle, [50.0 * circle])
    asked = ask_high(area) if planner == "survey" else PlanningRequest(area, HOME, LengthBudget(9000.0))
    path = make_planner(planner)(asked)
    assert inside(path.points_m, area)
    assert planner != "survey" or seen_share(path, area, 51.3) > 0.98


def rough_field(seed: int, corners: int, roughness: float) -> Polygon:
    rng = np.random.default_rng(seed)
    angles = np.linspace(0.0, 2.0 * math.pi, corners, endpoint=False)
    radii = 40.0 * (1.0 + roughness * rng.standard_normal(corners))
    return Polygon(np.column_stack((1.3 * radii * np.cos(angles), radii * np.sin(angles)))).buffer(0)


def left_out_legs(path: np.ndarray) -> int:
    """Count the legs between the waypoints of a path that are short, one after the other."""
    sent = Cornering(2.0, overshoots=True).waypoints(path, HOME).points_m
    short = np.hypot(*np.diff(sent, axis=0).T) < 2.0
    return int(np.count_nonzero(short[1:] & short[:-1]))


@pytest.mark.parametrize(("seed", "corners", "roughness"), [(2, 60, 0.05), (0, 200, 0.02)])
def test_no_two_legs_in_a_row_are_left_out_on_a_rough_border(
    monkeypatch: pytest.MonkeyPatch, seed: int, corners: int, roughness: float
) -> None:
    field = rough_field(seed, corners, roughness)
    asked = ask(field, 4.0, budget=LengthBudget(1e6), least_leg_m=2.0)
    path = survey(asked)
    monkeypatch.setattr("mission.planners.survey.without_short_legs", lambda points, *_: points)
    before = survey(asked)
    assert left_out_legs(before.points_m) > 0 == left_out_legs(path.points_m)
    assert inside(path.points_m, field)
    assert seen_share(path, field, 12.0) > seen_share(before, field, 12.0) - 0.01
    assert path.length_m < 1.02 * before.length_m


def test_a_corner_of_a_way_is_moved_into_the_land_and_what_is_passed_is_left_out() -> None:
    terrain = Terrain(shapely.box(-10, -10, 60, 20), 0.0)
    path = np.array([(0.0, 0.0), (50.0, 0.0), (51.0, 1.0), (50.5, 2.5), (0.0, 2.5)])
    corner = np.array([False, False, True, False, False])
    found = without_short_legs(path, corner, 2.0, terrain)
    assert len(found) <= 5 and (np.hypot(*np.diff(found, axis=0).T) >= 2.0).all()
    passed = np.array([(0.0, 0.0), (50.0, 0.0), (50.2, 0.7), (50.0, 1.4), (0.0, 1.4)])
    rows = np.zeros(5, np.bool_)
    assert len(without_short_legs(passed, rows, 2.0, terrain)) == 4
    assert without_short_legs(passed, rows, 0.5, terrain) is passed
    # Nowhere to go: the path stays.
    narrow = Terrain(shapely.buffer(shapely.LineString(path), 0.05), 0.0)
    assert without_short_legs(path, corner, 2.0, narrow) is path


@pytest.mark.parametrize(("degrees", "width_m"), [(33.0, 3.0), (0.0, 9.0)])
def test_an_arm_narrower_than_an_image_is_one_row(degrees: float, width_m: float) -> None:
    arm = affinity.rotate(shapely.box(190, 70 - width_m / 2, 420, 70 + width_m / 2), degrees, (190.0, 70.0))
    field = shapely.union(FIELD, arm)
    path = survey(replace(ask_high(field), budget=WindBudget(0.0)))
    outside = path.points_m[shapely.distance(shapely.points(path.points_m), FIELD) > 1e-6]
    assert 1 <= len(outside) <= 4
    assert seen_share(path, field, 51.3) > 0.98 and inside(path.points_m, field)
