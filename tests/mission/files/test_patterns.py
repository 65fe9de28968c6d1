"""Landing patterns and structure scans of QGroundControl's plans, as its versions write them."""

import json

import numpy as np
import pytest

from geo.frame import LocalFrame
from mission.errors import MissionFileError
from mission.files import plan
from mission.model import Mission, MissionItem

HOME = [28.05, -82.15, 30.0]
TAKEOFF = MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=10.0)
LANDING = {
    "type": "ComplexItem",
    "altitudesAreRelative": True,
    "complexItemType": "fwLandingPattern",
    "landCoordinate": [28.05, -82.15, 0],
    "landingApproachCoordinate": [28.054, -82.15, 40],
    "loiterClockwise": True,
    "loiterRadius": 75,
    "stopTakingPhotos": True,
    "stopVideoPhotos": True,
    "useLoiterToAlt": True,
    "valueSetIsDistance": True,
    "version": 2,
}
CAMERA = {
    "AdjustedFootprintFrontal": 10,
    "AdjustedFootprintSide": 8,
    "CameraName": "Manual (no camera specs)",
    "DistanceMode": 1,
    "DistanceToSurface": 12,
    "version": 2,
}
SIDE = 0.001
SCAN = {
    "type": "ComplexItem",
    "CameraCalc": CAMERA,
    "EntranceAltitude": 50,
    "GimbalPitch": -10,
    "Layers": 2,
    "ScanBottomAlt": 5,
    "StartFromTop": False,
    "StructureHeight": 25,
    "complexItemType": "StructureScan",
    "polygon": [[28.05, -82.15], [28.05 + SIDE, -82.15], [28.05 + SIDE, -82.149], [28.05, -82.149]],
    "version": 3,
}


def read(*complex_items):
    document = json.loads(plan.dumps(Mission((TAKEOFF,))))
    document["mission"]["plannedHomePosition"] = HOME
    document["mission"]["items"] += complex_items
    return plan.loads(json.dumps(document).encode()).items[1:]


def told(item):
    return (
        item.command,
        item.frame,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
    )


START = (189, 2, 0, 0, 0, 0, 0, 0, 0)
STOP_PHOTOS = [(206, 2, 0, 0, 0, 0, 0, 0, 0), (2001, 2, 0, None, None, None, 0, 0, 0)]
STOP_VIDEO = (2501, 2, 0, None, None, None, 0, 0, 0)
LOITER = (31, 3, 1, 75, 0, 1, 28.054, -82.15, 40)
LAND = (21, 3, 0, 0, 0, 0, 28.05, -82.15, 0)
PLAIN = {"stopTakingPhotos": False, "stopVideoPhotos": False}


@pytest.mark.parametrize(
    ("changes", "commands"),
    [
        ({}, [START, *STOP_PHOTOS, STOP_VIDEO, LOITER, LAND]),
        (PLAIN, [START, LOITER, LAND]),
        (PLAIN | {"loiterClockwise": False}, [START, (31, 3, 1, -75, *LOITER[4:]), LAND]),
        (PLAIN | {"useLoiterToAlt": False}, [START, (16, 3, 0, 0, 0, None, *LOITER[6:]), LAND]),
        (PLAIN | {"altitudesAreRelative": False}, [START, (31, 0, *LOITER[2:]), (21, 0, *LAND[2:])]),
        (PLAIN | {"useDoChangeSpeed": True, "finalApproachSpeed": 14.7},
         [START, (178, 2, 0, 14, -1, 0, 0, 0, 0), LOITER, LAND]),
        (PLAIN | {"complexItemType": "vtolLandingPattern", "version": 1},
         [START, LOITER, (85, 3, 0, 0, 0, None, *LAND[6:])]),
    ],
)  # fmt: skip
def test_a_landing_pattern_is_the_commands_of_qgroundcontrol(changes, commands):
    assert [told(item) for item in read(LANDING | changes)] == commands


def test_the_first_version_of_a_landing_pattern_has_other_keys():
    older = {
        key: LANDING[key]
        for key in ("type", "complexItemType", "landCoordinate", "loiterClockwise", "loiterRadius")
    }
    older |= {
        "version": 1,
        "loiterCoordinate": [28.054, -82.15, 40],
        "loiterAltitudeRelative": True,
        "landAltitudeRelative": True,
    }
    assert [told(item) for item in read(older)] == [START, LOITER, LAND]
    with pytest.raises(MissionFileError, match="loiterAltitudeRelative and landAltitudeRelative differ"):
        read(older | {"landAltitudeRelative": False})


@pytest.mark.parametrize("from_top", [False, True])
def test_a_structure_scan_goes_around_in_layers_outside_of_the_structure(from_top):
    items = read(SCAN | {"StartFromTop": from_top})
    layer = [16, 206, 16, 16, 16, 16, 206]
    assert [item.command for item in items] == [16, 196, *layer, *layer, 197, 16]
    assert told(items[1]) == (196, 2, 0, 0, 0, 0, -10, 0, 90)
    assert [told(items[k])[2:5] for k in (3, 8)] == [(8, 0, 1), (0, 0, 0)]
    heights_m = [item.z for item in items if item.command == 16]
    low, high = (10.0, 20.0)
    assert heights_m == [50, *([high] * 5 + [low] * 5 if from_top else [low] * 5 + [high] * 5), 50]
    frame = LocalFrame(28.05, -82.15, 0.0)
    x_m, y_m = frame.from_wgs84(*np.array([(item.x, item.y) for item in items[2:8] if item.command == 16]).T)
    east_m, north_m = frame.from_wgs84(28.05 + SIDE, -82.149)
    expected = [(-12, -12), (-12, north_m + 12), (east_m + 12, north_m + 12), (east_m + 12, -12), (-12, -12)]
    assert np.column_stack([x_m, y_m]) == pytest.approx(np.array(expected), abs=0.05)
    assert (items[0].x, items[0].y) == (items[2].x, items[2].y) == (items[-1].x, items[-1].y)


@pytest.mark.parametrize(
    ("item", "changes", "part"),
    [
        (LANDING, {"version": 3}, "fwLandingPattern of version 3, not 1 or 2"),
        (LANDING, {"landCoordinate": None}, "landCoordinate is missing"),
        (LANDING, {"landCoordinate": [28.05, -82.15]}, "mission, item 2, landCoordinate"),
        (SCAN, {"version": 2}, "StructureScan of version 2, not 3; save it with QGroundControl 4"),
        (SCAN, {"CameraCalc": {}}, "AdjustedFootprintSide is missing"),
        (SCAN, {"Layers": 0}, "Layers is 0, AdjustedFootprintFrontal is 10; give numbers above 0"),
        (SCAN, {"Layers": 1e12}, "more than 65535 items"),
        (SCAN, {"polygon": [[1, 2], [3, 4]]}, "polygon has 2 vertices"),
        (SCAN, {"polygon": [[1, 2], [3, 400], [5, 6]]}, "polygon, vertex 2: longitude 400"),
        (SCAN, {"polygon": [[28, 2], [28.001, 2], [28.002, 2], [28, 2.1]]}, "no corner at vertex 2"),
    ],
)
def test_patterns_that_cannot_be_made_are_refused_by_name(item, changes, part):
    with pytest.raises(MissionFileError, match="mission, item 2") as caught:
        read(item | changes)
    assert part in str(caught.value)


def test_a_jump_over_a_pattern_leads_to_the_same_item():
    jump = {"type": "SimpleItem", "command": 177, "frame": 2, "params": [1, 2, 0, 0, 0, 0, 0],
            "autoContinue": True, "doJumpId": 9}  # fmt: skip
    items = read(LANDING, jump)
    assert items[-1].param1 == 0.0
