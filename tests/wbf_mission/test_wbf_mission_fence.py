"""Fences from the farm's border, and rally points."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from geo import Crop, Farm, LocalFrame, Obstacle, Patch, get_farm, save_farm
from mission.files import read_mission, write_mission
from mission.files.fence import polygon_at
from mission.model import Command
from mission.outcome import Outcome
from wbf_mission.flight import fly
from wbf_mission.planning.keep_out import MOST_VERTICES, border_fence
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario

INSIDE, OUTSIDE = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION


def farm_of(*lands, **more):
    patches = tuple(Patch(f"land {k}", Crop.TOMATO, "me", land) for k, land in enumerate(lands))
    return Farm("fenced", LocalFrame(28.05, -82.15), 400, 400, patches, "me", (0.0, 0.0), 1.0, **more)


def zones(fence, frame):
    """The polygons of a fence by their commands, in metres of the farm."""
    found, k = {INSIDE: [], OUTSIDE: []}, 0
    while k < len(fence):
        corners = polygon_at(fence, k)
        places = [frame.from_wgs84(one.x, one.y) for one in corners]
        found[fence[k].command].append(shapely.Polygon(places))
        k += len(corners)
    return found


@st.composite
def lands(draw):
    """A star with up to 200 corners."""
    count = draw(st.integers(3, 200))
    radius = np.array(draw(st.lists(st.floats(5.0, 90.0), min_size=count, max_size=count)))
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return shapely.Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle))) + 200.0)


@given(lands(), st.floats(1.0, 40.0), st.lists(st.tuples(st.floats(0, 400), st.floats(0, 400)), max_size=6))
@settings(max_examples=15, deadline=None)
def test_a_fence_holds_land_and_path_with_few_vertices(land, distance_m, path):
    farm = farm_of(land)
    pole = Obstacle(shapely.Point(200, 200).buffer(3.0, quad_segs=30))
    way = np.array([(200.0, 200.0), *path, (200.0, 200.0)])
    fence = border_fence(farm, way, distance_m, (pole,))
    assert len(fence) <= MOST_VERTICES
    found = zones(fence, farm.frame)
    (inside,), (outside,) = found[INSIDE], found[OUTSIDE]
    held = shapely.union(land, shapely.LineString(way))
    assert inside.is_valid and inside.contains(held)
    assert inside.exterior.distance(held) >= distance_m - 0.02
    assert outside.buffer(0.02).contains(pole.polygon) and outside.area < 1.4 * pole.polygon.area


def test_more_obstacles_than_an_autopilot_holds_are_told():
    sheds = tuple(Obstacle(shapely.box(x, 30, x + 4, 34)) for x in range(0, 100, 10))
    farm = farm_of(shapely.box(0, 0, 100, 50))
    with pytest.warns(UserWarning, match="excludes only the 7 obstacles nearest to the path, of 10"):
        fence = border_fence(farm, np.array([(0.0, 0.0), (10.0, 30.0)]), 10.0, sheds)
    kept_out = zones(fence, farm.frame)[OUTSIDE]
    assert len(kept_out) == 7 and len(fence) <= MOST_VERTICES
    assert max(one.bounds[0] for one in kept_out) < 70


def test_a_fenced_plan_passes_its_check_and_is_flown(tmp_path):
    base = get_farm("miniberry-30")
    low, mast = (
        Obstacle(shapely.box(2, 2, 3, 3), height_m=2.0),
        Obstacle(shapely.Point(5, 5).buffer(0.3), margin_m=0.5, name="mast"),
    )
    path = tmp_path / "farm.geojson"
    save_farm(replace(base, obstacles=(low, mast), rally_m=((-4.0, 3.0),)), path)
    scenario = Scenario(
        farm=str(path),
        planner="lawnmower",
        budget="150m",
        autopilot="ardupilot",
        fence_m=10,
        estimator="point",
    )
    made = plan(scenario)
    found = zones(made.mission.fence, base.frame)
    assert len(found[INSIDE]) == len(found[OUTSIDE]) == 1  # nothing bars what is flown over
    assert found[OUTSIDE][0].contains(shapely.Point(5, 5))
    (rally,) = made.mission.rally
    assert base.frame.from_wgs84(rally.x, rally.y) == pytest.approx((-4.0, 3.0), abs=0.02)
    circumstances = Circumstances(scenario.vehicle, scenario.weather, made.farm)
    assert {one.code for one in check_mission(made.mission, circumstances).report.findings} == {"flight"}
    write_mission(made.mission, tmp_path / "a.plan")
    assert read_mission(tmp_path / "a.plan").fence == made.mission.fence
    result = fly(scenario)
    assert result.outcome is Outcome.COMPLETED
    assert len(result.flights[0].plan.mission.fence) == len(made.mission.fence)


def test_sharp_corners_keep_the_distance():
    wedge = shapely.Polygon([(205.0, 200.0), (197.5, 204.33), (197.5, 195.67)])
    farm = farm_of(wedge)
    way = np.array([(200.0, 200.0), (0.0, 0.0), (200.0, 200.0)])
    (inside,) = zones(border_fence(farm, way, 14.0), farm.frame)[INSIDE]
    assert inside.exterior.distance(shapely.union(wedge, shapely.LineString(way))) >= 13.98
