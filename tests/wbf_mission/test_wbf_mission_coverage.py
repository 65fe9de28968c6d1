"""Coverage: one number, that of a plan, of its check and of what was flown."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from geo import Crop, Farm, FarmError, LocalFrame, Obstacle, Patch, save_farm
from mission.model import Command, GeoPoint, Mission, MissionItem
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.flight import fly
from wbf_mission.planning.coverage import image_places, predicted_coverage, seen_share
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError

FRAME = LocalFrame(28.05, -82.15)


def farm(*patches, **more):
    """A farm of 20 x 10 m about its origin, of cells of a metre."""
    return Farm("strip", FRAME, 20, 10, patches, "me", (0.0, 0.0), 1.0, **more)


def land(crop, *box, owner="me"):
    return Patch(crop, crop, owner, shapely.box(*box))


POTATOES = farm(
    land("potato", 0, 0, 10, 10),
    land(Crop.TOMATO, 10, 0, 20, 10),
    land(Crop.POND, 0, 0, 5, 2),
    land("potato", 18, 0, 20, 10, owner="neighbour"),
    obstacles=(Obstacle(shapely.box(0, 8, 10, 10)),),
)


def flown(places_m, items, orders):
    """A prediction that is at places at 0, 1, 2 ... s, flying these items, and its mission."""
    track = np.array([(x, y, 10.0) for x, y in places_m])
    waypoint = MissionItem.waypoint(28.05, -82.15, 10.0)
    mission = Mission(tuple(orders.get(k, waypoint) for k in range(max(items) + 1)), GeoPoint(28.05, -82.15))
    # An order is given where the last item before it ends.
    given = tuple((float(max(sum(item < k for item in items), 1)), k) for k in sorted(orders))
    made = Prediction(0.0, 0.0, 1.0, 0.0, track, 1.0, feasible=True, reason="", camera_orders=given)
    return mission, made


def by_distance(metres, at_once=1.0):
    return MissionItem(Command.DO_SET_CAM_TRIGG_DIST, param1=metres, param3=at_once)


@pytest.mark.parametrize(
    ("order", "places"),
    [
        (by_distance(1.9), [0, 1.9, 3.8, 5.7]),
        (by_distance(1.9, 0.0), [1.9, 3.8, 5.7]),
        (by_distance(0.0), []),
        (MissionItem(Command.DO_SET_CAM_TRIGG_INTERVAL, param1=500.0), [0, 1.5, 3, 4.5, 6]),
        (MissionItem(Command.IMAGE_START_CAPTURE, param2=2.0), [0, 6]),
        (MissionItem(Command.IMAGE_START_CAPTURE, param2=2.0, param3=1.0), [0]),
        (MissionItem(Command.IMAGE_START_CAPTURE, param3=1.0), [0]),
    ],
)
def test_images_are_where_the_camera_fires(order, places):
    # Item 0 turns the camera on, item 1 is flown, 2 turns it off, 3 is flown.
    mission, made = flown([(0, 5), (3, 5), (6, 5), (9, 5)], [1, 1, 1, 3], {0: order, 2: by_distance(0.0)})
    found = image_places(POTATOES, mission, made)
    assert found == pytest.approx(np.array([(x, 5.0) for x in places]).reshape(-1, 2), abs=0.02)


@pytest.mark.parametrize("order", [by_distance(1.9), MissionItem(214, param1=500.0)])
def test_images_over_the_date_line_are_on_the_farm(order):
    frame = LocalFrame(-17.0, 179.99997)
    mission, made = flown([(0, 5), (3, 5), (6, 5), (9, 5)], [1, 1, 1, 3], {0: order, 2: by_distance(0.0)})
    mission = replace(mission, home=GeoPoint(-17.0, 179.99997))
    found = image_places(replace(POTATOES, frame=frame), mission, made)
    assert frame.to_wgs84(3.0, 5.0)[1] > 0.0 > frame.to_wgs84(6.0, 5.0)[1]
    assert found[:, 0] == pytest.approx(
        [0, 1.9, 3.8, 5.7] if order.command == 206 else [0, 1.5, 3, 4.5, 6], abs=0.02
    )


def test_a_second_order_begins_anew_and_stopping_ends():
    orders = {0: by_distance(2.0), 2: by_distance(5.0), 4: MissionItem(Command.IMAGE_STOP_CAPTURE)}
    mission, made = flown([(0, 0), (7, 0), (14, 0), (20, 0)], [1, 1, 3, 5], orders)
    found = image_places(POTATOES, mission, made)[:, 0]
    assert found == pytest.approx([0, 2, 4, 6, 7, 12], abs=0.02)
    mission, made = flown([(0, 0), (7, 0)], [1, 1], {})
    assert (
        not len(image_places(POTATOES, mission, made))
        and predicted_coverage(POTATOES, mission, made, 3) == 0.0
    )


def test_the_land_to_be_seen_is_that_of_the_crops_without_ponds_obstacles_and_neighbours():
    assert POTATOES.grown == ("potato", "tomato")
    assert POTATOES.scouted_count == 100 - 10 - 20 + 80 == POTATOES.scouted_area.area
    potatoes = POTATOES.scouting(["potato", "rice"])
    assert potatoes.scouted_count == 70 == potatoes.scouted_area.area
    assert POTATOES.scouting(["rice"]) is POTATOES and POTATOES.scouting(["tomato", "potato"]) is POTATOES
    x, y = np.meshgrid(np.arange(-3, 25), np.arange(-3, 15))
    assert seen_share(POTATOES, x.ravel(), y.ravel()) == 1.0
    assert seen_share(potatoes, np.array([0, 7, 7, 7, 12]), np.array([0, 5, 5, 9, 5])) == pytest.approx(
        1 / 70
    )


@given(st.lists(st.tuples(st.integers(-2, 21), st.integers(-2, 11)), max_size=60))
def test_cells_count_once(cells):
    wanted = {(x, y) for x, y in cells if 0 <= x < 20 and 0 <= y < 10 and POTATOES.scouted_cells[x, y]}
    x, y = np.array(cells, dtype=np.int64).reshape(-1, 2).T
    assert seen_share(POTATOES, x, y) == pytest.approx(len(wanted) / 150)


def test_fields_that_grow_nowhere_are_refused(tmp_path):
    path = tmp_path / "potatoes.geojson"
    save_farm(replace(POTATOES, patches=POTATOES.patches[:1], obstacles=()), path)
    with pytest.raises(ScenarioError, match="grows potato, but the fields tylcv, ccr, soil are of tom"):
        fly(Scenario(farm=str(path), budget="100m"))
    assert plan(Scenario(farm=str(path), planner="lawnmower", budget="100m")).coverage > 0.3


def test_a_farm_of_too_many_crops_is_refused():
    with pytest.raises(FarmError, match="101 crops; give at most 100 crops"):
        farm(*(land(f"crop {k}", 0, 0, 1, 1) for k in range(96)))
