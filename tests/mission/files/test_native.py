"""Our own JSON: complete, strict, versioned."""

import json

import pytest

from mission.errors import MissionFileError
from mission.files import native
from mission.model import GeoPoint, Mission, MissionItem

MISSION = Mission(
    (MissionItem.waypoint(28.05, -82.15, 10.0, yaw_deg=None), MissionItem(20)),
    home=GeoPoint(28.05, -82.15, 30.0),
    fence=(MissionItem(5003, 0, 50.0, x=28.05, y=-82.15),),
    rally=(MissionItem(5100, 3, x=28.05, y=-82.15, z=10.0),),
    cruise_speed_m_s=12.5,
    hover_speed_m_s=4.0,
)


def document():
    return json.loads(native.dumps(MISSION))


def read(document):
    return native.loads(json.dumps(document).encode())


def test_form():
    assert document() == {
        "format": "wbf-mission",
        "version": 1,
        "home": {"latitude_deg": 28.05, "longitude_deg": -82.15, "altitude_m": 30.0},
        "cruise_speed_m_s": 12.5,
        "hover_speed_m_s": 4.0,
        "items": [
            {"command": 16, "frame": 3, "params": [0, 0, 0, None], "x": 28.05, "y": -82.15, "z": 10.0,
             "autocontinue": True},
            {"command": 20, "frame": 2, "params": [0, 0, 0, 0], "x": 0, "y": 0, "z": 0, "autocontinue": True},
        ],
        "fence": [
            {"command": 5003, "frame": 0, "params": [50, 0, 0, 0], "x": 28.05, "y": -82.15, "z": 0,
             "autocontinue": True},
        ],
        "rally": [
            {"command": 5100, "frame": 3, "params": [0, 0, 0, 0], "x": 28.05, "y": -82.15, "z": 10,
             "autocontinue": True},
        ],
    }  # fmt: skip
    assert read(document()) == MISSION


def test_what_may_be_left_out():
    mission = native.loads(b'{"format": "wbf-mission", "version": 1, "items": []}')
    assert mission == Mission(())


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        (("format",), "other", "not a wbf-mission file"),
        (("version",), 2, "version 2 of the wbf-mission format is not known"),
        (("items",), None, "items: it is null; give a list"),
        (("items", 0, "command"), 70000, "item 1, command"),
        (("items", 0, "params"), [0, 0, 0], "item 1, params"),
        (("items", 0, "x"), 90.5, "item 1: mission item (command 16): latitude 90.5"),
        (("items", 0, "extra"), 1, "extra is unknown"),
        (("fence", 0, "y"), 181, "fence item 1"),
        (("rally", 0, "z"), 1e9, "rally point 1"),
        (("home", "latitude_deg"), -91, "home: point: latitude -91"),
    ],
)
def test_bad_values_are_named(path, value, part):
    made = place = document()
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(MissionFileError) as caught:
        read(made)
    assert part in str(caught.value)


def test_too_many_items():
    item = '{"command":20,"frame":2,"params":[0,0,0,0],"x":0,"y":0,"z":0}'
    text = '{"format":"wbf-mission","version":1,"items":[' + ",".join([item] * 65_536) + "]}"
    with pytest.raises(MissionFileError, match=r"items: .*65535"):
        native.loads(text.encode())
