"""QGroundControl plans: what our files hold, what we read of others, and what is refused."""

import json
from pathlib import Path

import pytest

from mission.errors import MissionFileError
from mission.files import Firmware, plan, read_mission
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem

PLANS = Path(__file__).parents[2] / "data" / "plans"
HOME = GeoPoint(28.05, -82.15, 30.0)
MISSION = Mission(
    (
        MissionItem(Command.NAV_TAKEOFF, 3, param4=None, x=28.05, y=-82.15, z=10.0),
        MissionItem(Command.DO_CHANGE_SPEED, 3, 1.0, 5.0, -1.0),
        MissionItem.waypoint(28.051, -82.151, 10.0, acceptance_radius_m=1.0),
        MissionItem(Command.DO_JUMP, Frame.MISSION, 2.0, 3.0),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION),
    ),
    home=HOME,
)


def document(mission=MISSION, firmware=Firmware.PX4):
    return json.loads(plan.dumps(mission, firmware))


def read(document):
    return plan.loads(json.dumps(document).encode())


def simple(command=16, frame=3, params=(0, 0, 0, None, 28.0, -82.0, 10.0), **more):
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": frame,
        "params": list(params),
        "autoContinue": True,
    } | more


def with_items(*items):
    made = document()
    made["mission"]["items"] = list(items)
    return made


@pytest.mark.parametrize(("name", "count"), [("climbs-holds", 8), ("spiral-8", 23)])
def test_recorded_plans_are_read_and_written_back(name, count):
    path = PLANS / f"{name}.plan"
    mission = read_mission(path)
    assert len(mission.items) == count
    assert json.loads(plan.dumps(mission)) == json.loads(path.read_text())


def test_keys_that_the_loaders_ask_for():
    made = document()
    assert set(made) == {"fileType", "geoFence", "groundStation", "mission", "rallyPoints", "version"}
    assert (made["fileType"], made["version"], made["groundStation"]) == ("Plan", 1, "QGroundControl")
    assert made["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert made["rallyPoints"] == {"points": [], "version": 2}
    mission = made["mission"]
    assert mission["version"] == 2
    assert mission["vehicleType"] == 2
    assert mission["plannedHomePosition"] == [28.05, -82.15, 30.0]
    assert mission["globalPlanAltitudeMode"] == 1
    for number, item in enumerate(mission["items"], start=1):
        assert item["type"] == "SimpleItem"
        assert item["doJumpId"] == number
        assert len(item["params"]) == 7
        assert isinstance(item["autoContinue"], bool)
        altitude_keys = {"Altitude", "AltitudeMode", "AMSLAltAboveTerrain"} & set(item)
        assert len(altitude_keys) == (3 if item["frame"] == 3 else 0)
    assert [item["frame"] for item in mission["items"]] == [3, 2, 3, 2, 2]
    assert mission["items"][0]["params"][3] is None
    assert mission["items"][3]["params"][0] == 3


@pytest.mark.parametrize(
    ("position", "home"),
    [([28.0, -82.0], GeoPoint(28.0, -82.0, 0.0)), ([28.0], None), ([None, -82.0, 5.0], None)],
)
def test_a_home_needs_two_coordinates(position, home):
    assert read(changed(("mission", "plannedHomePosition"), position)).home == home


def test_jump_is_mapped_through_the_ids():
    made = with_items(
        simple(doJumpId=10), simple(178, 2, (1, 5, -1, 0, 0, 0, 0), doJumpId=20), simple(doJumpId=30),
        simple(177, 2, (30, 2, 0, 0, 0, 0, 0), doJumpId=40),
    )  # fmt: skip
    assert read(made).items[3].param1 == 2.0
    assert document(read(made))["mission"]["items"][3]["params"][0] == 3
    without_ids = with_items(simple(), simple(177, 2, (1, 2, 0, 0, 0, 0, 0)))
    assert read(without_ids).items[1].param1 == 0.0, "counted from one"


@pytest.mark.parametrize(
    ("target", "part"), [(9, "does not exist"), (1, "more than once"), (1.5, "1.5"), (None, "None")]
)
def test_bad_jump(target, part):
    made = with_items(
        simple(doJumpId=1), simple(doJumpId=1), simple(177, 2, (target, 2, 0, 0, 0, 0, 0), doJumpId=3)
    )
    with pytest.raises(MissionFileError, match="DO_JUMP") as caught:
        read(made)
    assert part in str(caught.value)
    assert "mission, item 3" in str(caught.value)


def survey_document():
    return json.loads((PLANS / "survey.plan").read_text())


SURVEY = survey_document()["mission"]["items"][1]


@pytest.mark.parametrize("version", [2, 6])
def test_the_commands_of_a_survey_are_those_of_any_version(version):
    older = {key: value for key, value in SURVEY.items() if key != "splitConcavePolygons"}
    calc = {"CameraName": "Sony", "DistanceToSurfaceRelative": True, "version": 1, "ImageDensity": 1.5}
    transect = SURVEY["TransectStyleComplexItem"] | {"version": 1, "FollowTerrain": False, "CameraCalc": calc}
    older |= {"version": version, "TransectStyleComplexItem": transect}
    assert read(with_items(older)).items == read(with_items(SURVEY)).items


def test_corridor_and_unknown_complex_items_with_commands_are_flattened():
    corridor = SURVEY | {"complexItemType": "CorridorScan"}
    assert len(read(with_items(corridor)).items) == 4
    assert len(read(with_items({"type": "ComplexItem", "Items": [simple()]})).items) == 1


def test_complex_items_that_are_not_known_are_refused_by_name():
    with pytest.raises(MissionFileError, match=r"mission, item 2.*'SpiralScan'.*simple items"):
        read(with_items(simple(), {"type": "ComplexItem", "complexItemType": "SpiralScan", "version": 2}))


def test_items_of_older_versions_have_their_place_apart():
    older = simple(params=(0, 0, 0, 0)) | {"coordinate": [28.0, -82.0, 12.0]}
    item = read(with_items(older)).items[0]
    assert (item.x, item.y, item.z, item.param4) == (28.0, -82.0, 12.0, 0.0)
    with pytest.raises(MissionFileError, match=r"mission, item 1, params: 4 entries; give a list with 7"):
        read(with_items(simple(params=(0, 0, 0, 0))))


def vertex(command=5001, count=3.0):
    return MissionItem(command, 0, count, x=1.0, y=2.0)


@pytest.mark.parametrize(
    ("fence", "part"),
    [
        ([vertex()] * 2, "fence item 1: a polygon of 3 vertices, but only 2"),
        ([vertex(count=2.0)] * 2, "param1 is 2.0"),
        ([vertex(5003, 0.0)], "radius 0.0"),
        ([vertex(5000, 0.0)] * 2, "fence item 2: a second return point"),
        ([vertex(16)], "command 16 is not a fence command"),
    ],
)
def test_bad_fence_is_not_written(fence, part):
    with pytest.raises(MissionFileError, match="fence item") as caught:
        plan.dumps(Mission((), fence=fence))
    assert part in str(caught.value)


def changed(path, value):
    made = survey_document()
    made["geoFence"]["polygons"] = [{"polygon": [[1, 2], [1, 3], [2, 3]], "inclusion": True, "version": 1}]
    made["geoFence"]["circles"] = [
        {"circle": {"center": [1, 2], "radius": 5}, "inclusion": True, "version": 1}
    ]
    made["rallyPoints"]["points"] = [[1, 2, 3]]
    place = made
    *parents, last = path
    for key in parents:
        place = place[key]
    if value is KeyError:
        del place[last]
    else:
        place[last] = value
    return made


ITEM = ("mission", "items", 0)


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        (("fileType",), "Parameters", 'fileType "Parameters", not a QGroundControl plan'),
        (("version",), 2, "version is 2, but must be 1"),
        (("mission",), [], "mission: it is a list; give a table of names and values"),
        (("mission", "plannedHomePosition"), [91, 0, 0], "plannedHomePosition: home: point: latitude 91"),
        (("mission", "hoverSpeed"), "fast", "mission, hoverSpeed: it is a text; give a number"),
        ((*ITEM, "type"), "Sample", "'Sample'"),
        ((*ITEM, "command"), "16", "mission, item 1, command: it is a text; give a whole number"),
        ((*ITEM, "params"), [0] * 6, "mission, item 1, params"),
        ((*ITEM, "params", 4), 95.0, "mission, item 1: mission item (command 22): latitude 95"),
        ((*ITEM, "params", 5), None, "mission, item 1: longitude of command 22 is missing"),
        ((*ITEM, "params", 0), "a", "mission, item 1, param 1"),
        (("geoFence", "polygons", 0, "polygon"), [[1, 2]], "geoFence, polygon 1: 1 vertices"),
        (("geoFence", "circles", 0, "circle", "radius"), 0, "geoFence, circle 1: radius"),
        (("geoFence", "polygon"), [[1, 2]], "draw it again"),
        (("rallyPoints", "points", 0), [1, 2], "rallyPoints, point 1"),
        (
            ("mission", "items", 1, "TransectStyleComplexItem", "Items", 2, "params", 4),
            99,
            "mission, item 2, TransectStyleComplexItem, Item 3",
        ),
    ],
)
def test_bad_values_are_named(path, value, part):
    with pytest.raises(MissionFileError) as caught:
        read(changed(path, value))
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b'{"fileType": "Plan",\n "version": NaN}', "line 2"),
        (b'{"fileType": "Plan",\n\n "version": 1', "line 3"),
        (b'{"fileType": "Plan", "x": ' + b"[" * 100_000, "nested too deeply"),
    ],
)
def test_broken_json(content, part):
    with pytest.raises(MissionFileError) as caught:
        plan.loads(content)
    assert part in str(caught.value)


def test_too_many_items():
    items = ",".join([json.dumps(simple(20, 2, (0,) * 7))] * 65_536)
    text = plan.dumps(Mission(())).replace('"items": []', f'"items": [{items}]')
    with pytest.raises(MissionFileError, match=r"mission, item 65536: more than 65535"):
        plan.loads(text.encode())


def test_too_large_a_fence():
    text = json.dumps(document() | {"geoFence": {"polygons": [{"polygon": ["VERTICES"]}]}})
    with pytest.raises(MissionFileError, match="geoFence: 9 MiB, but at most 8"):
        plan.loads(text.replace('"VERTICES"', ",".join(["[1,2]"] * 1_572_864)).encode())
