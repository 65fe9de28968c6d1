"""Planned and flown paths stay away from obstacles; what does not is refused before the take-off."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
from command_line import ran
from hypothesis import example, given, settings
from hypothesis import strategies as st

from geo import get_farm, save_farm
from geo.farm import Farm, Obstacle, Patch
from geo.frame import LocalFrame
from geo.grid import Crop
from mission.errors import PlanningError
from mission.files import read_mission, write_mission
from mission.outcome import Outcome
from mission.planners import CropArea, PlannedPath, PlanningRequest, make_planner
from mission.planners.budget import LengthBudget
from mission.planners.terrain import parts_of
from wbf_mission.flight import fly
from wbf_mission.planning import MissionBuilder
from wbf_mission.planning.keep_out import KeepOut
from wbf_mission.preflight.finding import PreflightError
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError

PLANNERS = ("lawnmower", "spiral", "adaptive-lawnmower", "random-waypoint")
POLICIES = ("greedy", "orienteering", "rolling-horizon", "refining-lawnmower", "market", "confidence-guided")
AUTOPILOTS = ("px4", "ardupilot")
WINDY = {"wind_speed_m_s": 5.0, "wind_direction_deg": 270.0, "wind_gust_m_s": 2.0}
SIDE = 70.0
HOME = (3.0, 3.0)
CROPS = {Crop.TOMATO: shapely.box(0, 0, 35, SIDE), Crop.STRAWBERRY: shapely.box(35, 0, SIDE, SIDE)}
OBSTACLES = (
    shapely.Polygon([(24, 26), (44, 26), (44, 30), (28, 30), (28, 46), (24, 46)]),  # concave
    shapely.Point(54, 52).buffer(3.0),  # convex
    shapely.box(13, 2, 15, 5),  # near home
    shapely.box(52, -2, 57, 4),  # over the border
)


def builder_of(scenario):
    """What makes missions of a scenario's vehicle."""
    return MissionBuilder.of(scenario, get_farm(scenario.farm.name))


def yard(*obstacles):
    """A farm of 70 x 70 m; obstacles are polygons or `Obstacle`."""
    obstacles = [one if isinstance(one, Obstacle) else Obstacle(one) for one in obstacles]
    patches = tuple(Patch(crop, crop, "me", land) for crop, land in CROPS.items())
    frame = LocalFrame(28.05, -82.15, 20.0)
    return Farm("yard", frame, int(SIDE), int(SIDE), patches, "me", HOME, 1.0, obstacles=tuple(obstacles))


@pytest.fixture(scope="module")
def farm(tmp_path_factory):
    path = tmp_path_factory.mktemp("farm") / "yard.geojson"
    save_farm(yard(*OBSTACLES), path)
    return str(path)


def nearest_m(points, obstacles=OBSTACLES):
    """How near a polyline comes to the obstacles."""
    return shapely.distance(shapely.LineString(points), shapely.union_all(list(obstacles)))


def obstacle_findings(scenario, made):
    circumstances = Circumstances(scenario.vehicle, scenario.weather, made.farm, scenario.mission.margin_m)
    report = check_mission(made.mission, circumstances).report
    assert not report.has_errors
    return [one for one in report.findings if "obstacle" in one.code]


def check_flown(scenario):
    result = fly(scenario)
    (flight,) = result.flights
    assert result.outcome is Outcome.COMPLETED
    track = flight.true_track or flight.track
    assert nearest_m(np.column_stack((track.x_m, track.y_m))) >= scenario.mission.margin_m
    assert not obstacle_findings(scenario, flight.plan)
    return result


@pytest.mark.parametrize(
    ("planner", "autopilot"), [("lawnmower", "px4"), ("spiral", "ardupilot"), ("random-waypoint", "px4")]
)
def test_plans_keep_the_margin_in_calm_air(farm, planner, autopilot):
    scenario = Scenario(farm=farm, planner=planner, autopilot=autopilot, budget="5min", margin_m=3.0)
    made = plan(scenario)
    builder = builder_of(scenario)
    home = made.farm.home_m
    away_m = nearest_m(builder.flown_way(np.vstack((home, made.path_m, home))))
    assert away_m > 3.0 + 0.5, "the margin, and what the vehicle strays"
    assert made.prediction.duration_s <= 1.03 * 300.0
    assert not obstacle_findings(scenario, made)


@pytest.mark.parametrize(
    ("number", "policy"),
    [
        pytest.param(*one, marks=[] if one[1] == "market" else [pytest.mark.slow])
        for one in enumerate(POLICIES)
    ],
)
def test_flights_of_policies_keep_the_margin_in_wind(farm, number, policy):
    autopilot = AUTOPILOTS[number % 2]
    check_flown(
        Scenario(
            farm=farm, policy=policy, autopilot=autopilot, budget="300m", estimator="adaptive-disk", **WINDY
        )
    )


def test_an_error_of_the_satellites_counts(farm):
    exact = builder_of(Scenario(farm=farm))
    wrong = builder_of(Scenario(farm=farm, gps_noise_m=0.5))
    calm, windy = exact.keep_out, builder_of(Scenario(farm=farm, **WINDY)).keep_out
    assert wrong.keep_out.distance_m == pytest.approx(calm.distance_m + 1.5)
    assert windy.distance_m > calm.distance_m > 2.5


def test_a_farm_without_obstacles_pays_nothing_and_the_ideal_robot_flies_as_before(farm):
    assert builder_of(Scenario()).keep_out is None
    ideal = Scenario(farm=farm, vehicle="ideal", planner="spiral")
    assert builder_of(ideal).keep_out is None
    assert nearest_m(plan(ideal).path_m) < 1.0


def test_a_margin_that_leaves_nothing_says_so(farm):
    with pytest.raises(ScenarioError, match=r"no land is 1.* give a smaller --margin"):
        plan(Scenario(farm=farm, margin_m=100.0))


def polygons():
    corner = st.tuples(st.floats(12.0, SIDE), st.floats(-3.0, SIDE))
    box = st.builds(
        lambda at, size: shapely.box(*at, at[0] + size[0], at[1] + size[1]),
        corner,
        st.tuples(st.floats(0.5, 25.0), st.floats(0.5, 25.0)),
    )
    hull = st.lists(corner, min_size=3, max_size=6).map(lambda points: shapely.MultiPoint(points).convex_hull)
    bent = st.builds(lambda one, other: shapely.union(one, other), box, hull)
    return st.one_of(box, hull, bent).filter(lambda one: isinstance(one, shapely.Polygon) and one.area > 0.1)


@settings(max_examples=12, deadline=None)
@given(st.lists(polygons(), min_size=1, max_size=4), st.sampled_from(PLANNERS), st.floats(0.5, 4.0))
@example([shapely.box(12, -3, 20, SIDE + 3)], "lawnmower", 2.0)
@example(
    [
        shapely.box(12, 0, 13, 1),
        shapely.MultiPoint([(12.0, 0.0), (12.0, 68.44375608388897), (66.0, 0.0)]).convex_hull,
    ],
    "random-waypoint",
    1.0,
)
@example([shapely.box(12, 30, 60, 34), shapely.box(56, 34, 60, 60)], "random-waypoint", 3.0)
@example(
    [shapely.box(12, 0, 13, 1), shapely.MultiPoint([(12.0, 0.0), (13.0, 13.0), (27.0, 1.0)]).convex_hull],
    "lawnmower",
    4.0,
)
def test_legs_of_every_planner_keep_away_from_random_obstacles(obstacles, planner, stray_m):
    farm = yard(*obstacles)
    keep_out = KeepOut.of(farm.obstacles, 2.0, stray_m)
    free = shapely.difference(farm.owner_area, keep_out.area)
    parts = [part for part in parts_of(free) if not shapely.buffer(part, -1.0).is_empty]
    crops = [
        CropArea(crop, land) for crop, land in CROPS.items() if shapely.intersects(shapely.Point(1, 1), land)
    ]
    request = PlanningRequest(
        shapely.MultiPolygon(parts),
        HOME,
        LengthBudget(1500.0, HOME, lambda path: keep_out.around(path)[0]),
        1.0,
        tuple(crops),
    )
    try:
        path = make_planner(planner)(request).points_m
    except PlanningError:
        return
    flight = np.vstack((HOME, path, HOME))
    points, of_point = keep_out.around(flight)
    if not shapely.intersects(keep_out.area, shapely.Point(HOME)):
        # Round corners are eight chords a quarter, up to half a percent of the radius within the circle.
        assert nearest_m(points, obstacles) >= 0.995 * (2.0 + stray_m) - 0.02
    assert (np.diff(of_point) >= 0).all()
    # Each point of the path is the last of those that lead to it.
    last = np.append(np.diff(of_point) > 0, True)
    assert np.array_equal(points[last], flight)
    assert np.hypot(*np.diff(points, axis=0).T).sum() <= 1500.0 + 1e-6


def test_a_home_near_an_obstacle_is_left_on_the_shortest_way():
    keep_out = KeepOut.of(yard(shapely.box(5, -5, 9, 10)).obstacles, 2.0, 1.0)
    points, _ = keep_out.around(np.array([HOME, (40.0, 3.0)]))
    assert points[1] == pytest.approx((2.0, 3.0), abs=0.3), "away from it first"
    assert nearest_m(points[1:], [shapely.box(5, -5, 9, 10)]) >= 2.99


def test_a_mission_over_an_obstacle_is_refused_before_the_take_off(farm, tmp_path, capsys):
    file, out = tmp_path / "across.plan", tmp_path / "run"
    builder = replace(builder_of(Scenario(farm=farm)), keep_out=None)
    across = builder.mission(PlannedPath(np.array([[10.0, 28.0], [60.0, 28.0]]), None, "test"))
    write_mission(across, file)
    words = ("fly", "--farm", farm, "--mission", str(file), "--estimator", "point", "--out", str(out), "-q")
    err = ran(capsys, *words, code=2).err
    assert "this item crosses an obstacle of the farm" in err and "nothing was flown, --force" in err
    assert len(err.splitlines()) == 1 and not out.exists()
    assert "preflight error" in ran(capsys, *words, "--force", "--no-plots", code=0).err
    assert (out / "result.json").is_file()


def test_a_plan_with_an_error_is_not_written(tmp_path, capsys):
    farm, file = tmp_path / "shed.geojson", tmp_path / "spiral.plan"
    save_farm(yard(shapely.box(1, 1, 5, 5)), farm)
    words = ("plan", "--farm", str(farm), "--budget", "500m", "--out", str(file), "-q")
    err = ran(capsys, *words, code=2).err
    assert "obstacle" in err and "nothing was written, --force" in err and not file.exists()
    ran(capsys, *words, "--force", code=0)
    assert read_mission(file).items
    with pytest.raises(PreflightError, match="obstacle"):
        fly(Scenario(farm=str(farm), budget="500m", estimator="point"))


def test_gusts_that_no_margin_covers_are_told_with_a_plan(farm, capsys):
    words = ("plan", "--farm", farm, "--planner", "random-waypoint", "--budget", "300m", "--wind", "5,270,2")
    assert "farther than the margins to obstacles and fence allow for" in ran(capsys, *words, code=0).err
    assert "gusts" not in ran(capsys, *words[:-1], "5,270,1", code=0).err


def test_what_is_low_is_flown_over_and_counts_as_an_obstacle_below_its_margin():
    shed, mast = (
        Obstacle(shapely.box(20, 20, 40, 40), height_m=6.0),
        Obstacle(shapely.Point(60, 60).buffer(2.0)),
    )
    path = np.array([(10.0, 30.0), (50.0, 30.0), (50.0, 62.0)])
    for altitude_m, over in ((9.9, False), (10.1, True)):  # the quad's barometer is exact here
        scenario = Scenario(altitude_m=altitude_m, margin_m=4.0, estimate_errors=False, autopilot="ardupilot")
        builder = MissionBuilder.of(scenario, yard(shed, mast))
        assert builder.keep_out is not None
        flown = shapely.LineString(builder.flown_way(path))
        assert flown.intersects(shed.polygon) == over
        assert flown.distance(mast.polygon) >= 4.0
        circumstances = Circumstances(scenario.vehicle, scenario.weather, yard(shed), 4.0)
        straight = MissionBuilder.of(scenario, yard()).mission(PlannedPath(path, None, "straight"))
        codes = {one.code for one in check_mission(straight, circumstances).report.findings}
        assert ("near-obstacle" in codes) == (not over) and "obstacle" not in codes
    assert MissionBuilder.of(scenario, yard(shed)).keep_out is None


def test_an_obstacle_may_have_a_margin_of_its_own():
    pole, shed = Obstacle(shapely.box(30, 30, 31, 31), margin_m=9.0), Obstacle(shapely.box(60, 0, 61, 1))
    near = KeepOut.of((pole, shed), 2.0, 0.5).near
    assert near.bounds == pytest.approx((21.0, -2.0, 63.0, 40.0))
    assert sum(part.area for part in near.geoms if part.bounds[0] < 50.0) == pytest.approx(289.0, rel=0.02)


def test_farm_show_lists_obstacles(farm, capsys):
    told = json.loads(ran(capsys, "farm", "show", farm, "--json", code=0).out)
    assert len(told["obstacles"]) == 4
    assert told["obstacles"][2] == {
        "name": "obstacle 3",
        "height_m": None,
        "margin_m": None,
        "bounds_m": pytest.approx([13, 2, 15, 5], abs=1e-3),
        "area_m2": pytest.approx(6.0, abs=1e-2),
        "from_home_m": pytest.approx(10.0, abs=1e-3),
    }
    assert "obstacle 4" in ran(capsys, "farm", "show", farm, code=0).out
    assert not json.loads(ran(capsys, "farm", "show", "miniberry-30", "--json", code=0).out)["obstacles"]
    assert not get_farm("miniberry-30").obstacles
