"""Images that nobody could take while nothing was heard of the vehicle."""

import pytest

from mission.ground.items import Shots
from mission.model import Command, Mission, MissionItem
from wbf_mission.live.riding_camera import Silence, images_in

METRE = 1.0 / 111_195.0  # degrees of latitude
DISTANCE, INTERVAL = Command.DO_SET_CAM_TRIGG_DIST, Command.DO_SET_CAM_TRIGG_INTERVAL
PARTS = [(0.0, 0), (100.0, (DISTANCE, 2.0)), (150.0, (DISTANCE, 0.0)), (250.0, (DISTANCE, 5.0))]


def at(metres):
    return (27.0 + metres * METRE, -82.0)


def leg_to(metres):
    return MissionItem.waypoint(*at(metres), 10.0)


def mission(parts):
    """Legs north; before each what the camera is to do on it."""
    items = []
    for metres, order in parts:
        items += [MissionItem(order[0], param1=order[1])] if order else []
        items.append(leg_to(metres))
    return Mission((*items, MissionItem(Command.NAV_RETURN_TO_LAUNCH)))


PLAN = mission(PARTS)  # legs: items 0, 2, 4, 6; the return: 7


@pytest.mark.parametrize(
    ("before_m", "item", "after_m", "later", "images"),
    [
        (20.0, 2, 60.0, 2, 20),
        (20.0, 2, 120.0, 4, 40),
        (20.0, 2, 200.0, 6, 50),
        (120.0, 4, 200.0, 6, 10),  # it took none when the silence began
        (120.0, 4, 140.0, 4, 0),
        (20.0, 2, 0.0, 8, 60),  # it is down already
        (120.0, 4, 0.0, 7, 20),  # it returns
        (20.0, 4, 60.0, 2, 20),  # another mission
    ],
)
def test_they_are_those_of_the_mission(before_m, item, after_m, later, images):
    silence = Silence(at(before_m), at(after_m), item, 30.0, Shots())
    assert images_in(silence, PLAN, later) == pytest.approx(images, abs=1)


@pytest.mark.parametrize(
    ("reach_m", "images"),
    [(60.0, 30), (40.0, 20), (10.0, 5)],
)
def test_no_more_than_the_vehicle_can_have_flown_past(reach_m, images):
    """Of a mission that was changed meanwhile the items say that more was flown than the time allows."""
    plan = mission([(0.0, 0), (100.0, (DISTANCE, 2.0)), (0.0, 0), (100.0, 0), (0.0, 0)])
    silence = Silence(at(50.0), at(60.0), 2, 20.0, Shots(), reach_m)
    assert images_in(silence, plan, 5) == pytest.approx(images, abs=1)


def test_images_by_time_are_spread_over_the_way():
    plan = mission([(0.0, 0), (100.0, (INTERVAL, 500.0)), (150.0, (INTERVAL, 0.0))])
    silence = Silence(at(50.0), at(125.0), 2, 15.0, Shots())
    assert images_in(silence, plan, 4) == pytest.approx(20, abs=1)
    hovers = Silence(at(50.0), at(50.0), 2, 15.0, Shots())
    assert images_in(hovers, plan, 2) == pytest.approx(30, abs=1)


def test_outside_a_mission_the_camera_does_what_it_was_told():
    silence = Silence(at(0.0), at(50.0), -1, 10.0, Shots(distance_m=1.0))
    assert images_in(silence, PLAN, 8) == pytest.approx(50, abs=1)
    assert images_in(Silence(at(0.0), at(50.0), -1, 10.0, Shots()), PLAN, 8) == 0
