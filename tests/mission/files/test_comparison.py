"""What is said of two missions that are not the same."""

from dataclasses import replace

import pytest

from mission.files.formats import differences
from mission.model import GeoPoint, Mission, MissionItem

POINT = MissionItem.waypoint(28.05, -82.15, 10.0)
MISSION = Mission(
    (POINT, MissionItem(178, 3, 1.0, 5.0), POINT),
    home=GeoPoint(28.05, -82.15, 30.0),
    fence=(MissionItem(5003, 0, 50.0, x=28.0, y=-82.0),),
    rally=(MissionItem(5100, 3, x=28.0, y=-82.0, z=5.0),),
)


def said(**changes):
    return [(loss.text, loss.changes_flight) for loss in differences(MISSION, replace(MISSION, **changes))]


def items(index, **changes):
    made = list(MISSION.items)
    made[index] = replace(made[index], **changes)
    return tuple(made)


HOME = "home, which is 28.0500000, -82.1500000, 30 m, is written as"
FRAME = "commands without a position are written in frame 2, with no effect on the flight (mission item 2)"


@pytest.mark.parametrize(
    ("changes", "texts"),
    [
        ({}, []),
        ({"home": None}, [(f"{HOME} unknown", False)]),
        ({"home": GeoPoint(28.05, -82.1500002, 30.0)}, [(f"{HOME} 28.0500000, -82.1500002, 30 m", False)]),
        ({"fence": ()}, [("fence items are not kept (1 of 1)", True)]),
        ({"rally": ()}, [("rally points are not kept (1 of 1)", True)]),
        ({"items": MISSION.items[:2]}, [("mission items are not kept (1 of 3)", True)]),
        ({"items": items(0, param4=0.0)}, [("an unset param4 is written as 0 (mission item 1)", False)]),
        ({"items": items(0, frame=0)}, [("frame is not kept (mission item 1)", True)]),
        ({"items": items(1, autocontinue=False)}, [("autocontinue is not kept (mission item 2)", True)]),
        ({"items": items(1, frame=2)}, [(FRAME, False)]),
        ({"fence": (replace(MISSION.fence[0], param1=9.0),)}, [("param1 is not kept (fence item 1)", True)]),
    ],
)
def test_a_difference_is_told_with_its_weight(changes, texts):
    assert said(**changes) == texts
