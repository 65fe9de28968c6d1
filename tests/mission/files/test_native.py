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


def test_one_item_a_line():
    assert sum('"command"' in line for line in native.dumps(MISSION).splitlines()) == 4


def test_what_may_be_left_out():
    mission = native.loads(b'{"format": "wbf-mission", "version": 1, "items": []}')
    assert mission == Mission(())


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        (("format",), "other", "not a wbf-mission file"),
        (("version",), 2, "version 2 of the wbf-mission format is not known"),
        (("version",), "1", "version: Expected `int`"),
        (("items",), None, "items: Expected `array`, got `null`"),
        (("items", 0, "command"), 70000, "items[0].command"),
        (("items", 0, "command"), 16.5, "items[0].command"),
        (("items", 0, "frame"), True, "items[0].frame: Expected `int`, got `bool`"),
        (("items", 0, "params"), [0, 0, 0], "items[0].params"),
        (("items", 0, "params", 3), "x", "items[0].params[3]"),
        (("items", 0, "x"), 90.5, "items[0]: mission item (command 16): latitude 90.5"),
        (("items", 0, "x"), None, "items[0].x"),
        (("items", 0, "extra"), 1, "unknown field `extra`"),
        (("fence", 0, "y"), 181, "fence[0]"),
        (("rally", 0, "z"), 1e9, "rally[0]"),
        (("home", "latitude_deg"), -91, "home: point: latitude -91"),
        (("home",), [1, 2], "home: Expected `object | null`"),
        (("cruise_speed_m_s",), -2, "cruise_speed_m_s is -2"),
        (("note",), "hello", "unknown field `note`"),
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


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b'{"format": "wbf-mission", "version": 1,\n"items": [NaN]}', "line 2"),
        (b'{"format": "wbf-mission", "version": 1, "items": [Infinity]}', "line 1"),
        (b'{"format": "wbf-mission", "items": []}', "version"),
        (b'{"format": "wbf-mission", "version": 1}', "items"),
        (b'{"format": "wbf-mission", "version": ' + b"[" * 100_000, "nested too deeply"),
        (b"{" * 100_000, "line 1"),
        (b'{"format": "wbf-mission", "version": 1, "items": [] } trailing', "line 1"),
    ],
)
def test_broken_json(content, part):
    with pytest.raises(MissionFileError) as caught:
        native.loads(content)
    assert part in str(caught.value)


def test_too_many_items():
    item = '{"command":20,"frame":2,"params":[0,0,0,0],"x":0,"y":0,"z":0}'
    text = '{"format":"wbf-mission","version":1,"items":[' + ",".join([item] * 65_536) + "]}"
    with pytest.raises(MissionFileError, match=r"items: .*65535"):
        native.loads(text.encode())
