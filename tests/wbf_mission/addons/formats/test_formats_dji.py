"""DJI's wayline files against DJI's description of WPML: members, namespaces, names, required elements."""

import io
import zipfile
from xml.etree import ElementTree

import pytest

from mission.errors import MissionFileError
from mission.files import losses
from mission.model import GeoPoint, Mission, MissionItem
from wbf_mission.addons.formats import dji

KML, WPML = "{http://www.opengis.net/kml/2.2}", "{http://www.dji.com/wpmz/1.0.2}"
HOME = GeoPoint(28.05, -82.15, 30.0)


def waypoint(k, z=10.0, **more):
    return MissionItem.waypoint(28.05 + k * 1e-3, -82.15, z, **more)


TAKEOFF = MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=15.0)
FULL = (
    TAKEOFF,
    MissionItem(205, 2, -90.0),
    waypoint(1),
    MissionItem(178, 2, 1.0, 7.5, -1.0),
    MissionItem(206, 2, 5.0, 0.0, 1.0),
    waypoint(2, hold_s=3.0),
    waypoint(3, z=12.0, yaw_deg=270.0),
    MissionItem(206, 2),
    MissionItem(2000, 2, 0.0, 0.0, 1.0),
    MissionItem(2500, 2),
    waypoint(4),
    MissionItem(2501, 2),
    MissionItem(2000, 2, 0.0, 2.0, 0.0),
    waypoint(5),
    MissionItem(20),
)


def trees(*items, **more):
    content = dji.dumps(Mission(items, **more))
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
        return [ElementTree.fromstring(archive.read(name)) for name in archive.namelist()]


def plain(element):
    """Return an element as mappings and texts; names without their namespace, which has to be right."""
    found = {}
    for child in element:
        assert child.tag.startswith((KML, WPML)), child.tag
        assert child.tag.startswith(KML) == (
            child.tag.partition("}")[2] in ("Document", "Folder", "Placemark", "Point", "coordinates")
        )
        value = plain(child) if len(child) else child.text
        found.setdefault(child.tag.partition("}")[2], []).append(value)
    return found


# Marked as required in "Is it required" of DJI's tables, for a Mavic 3 Enterprise.
CONFIG = {
    "flyToWaylineMode", "finishAction", "exitOnRCLost", "executeRCLostAction", "takeOffSecurityHeight",
    "globalTransitionalSpeed", "droneInfo", "payloadInfo",
}  # fmt: skip
REQUIRED = {
    "template": {
        "missionConfig": CONFIG,
        "Folder": {
            "templateType", "templateId", "autoFlightSpeed", "waylineCoordinateSysParam", "globalHeight",
            "gimbalPitchMode", "globalWaypointHeadingParam", "globalWaypointTurnMode", "Placemark",
            "payloadParam",
        },
        "Placemark": {
            "Point", "index", "useGlobalHeight", "ellipsoidHeight", "height", "useGlobalSpeed",
            "waypointSpeed", "useGlobalHeadingParam", "waypointHeadingParam", "useGlobalTurnParam",
        },
    },
    "waylines": {
        "missionConfig": CONFIG | {"globalRTHHeight"},
        "Folder": {"templateId", "waylineId", "autoFlightSpeed", "executeHeightMode", "Placemark"},
        "Placemark": {
            "Point", "index", "executeHeight", "waypointSpeed", "waypointHeadingParam", "waypointTurnParam",
        },
    },
}  # fmt: skip
GROUP = {
    "actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex", "actionGroupMode", "actionTrigger",
    "action",
}  # fmt: skip
ACTIONS = {
    "takePhoto": {"payloadPositionIndex", "fileSuffix", "useGlobalPayloadLensIndex"},
    "startRecord": {"payloadPositionIndex", "fileSuffix", "useGlobalPayloadLensIndex"},
    "stopRecord": {"payloadPositionIndex"},
    "hover": {"hoverTime"},
    "gimbalRotate": {
        "payloadPositionIndex", "gimbalHeadingYawBase", "gimbalRotateMode", "gimbalPitchRotateEnable",
        "gimbalPitchRotateAngle", "gimbalRollRotateEnable", "gimbalRollRotateAngle", "gimbalYawRotateEnable",
        "gimbalYawRotateAngle", "gimbalRotateTimeEnable", "gimbalRotateTime",
    },
}  # fmt: skip


@pytest.mark.parametrize(("which", "name"), list(enumerate(REQUIRED)))
def test_every_required_element_is_there_once(which, name):
    root = trees(*FULL)[which]
    assert root.tag == f"{KML}kml"
    ((document,),) = plain(root).values()
    required = REQUIRED[name]
    (config,) = document["missionConfig"]
    (folder,) = document["Folder"]
    assert set(config) == required["missionConfig"]
    assert set(folder) == required["Folder"]
    assert config["droneInfo"] == [{"droneEnumValue": ["77"], "droneSubEnumValue": ["2"]}]
    marks = folder["Placemark"]
    assert [mark["index"] for mark in marks] == [[str(k)] for k in range(5)]
    numbers = []
    for index, mark in enumerate(marks):
        assert required["Placemark"] <= set(mark)
        longitude, latitude = map(float, mark["Point"][0]["coordinates"][0].split(","))
        assert (longitude, latitude) == (-82.15, pytest.approx(28.05 + (index + 1) * 1e-3))
        for group in mark.get("actionGroup", []):
            assert set(group) == GROUP
            numbers.append(int(group["actionGroupId"][0]))
            start, end = (int(group[key][0]) for key in ("actionGroupStartIndex", "actionGroupEndIndex"))
            assert start == index <= end <= 4
            assert group["actionGroupMode"] == ["sequence"]
            assert [action["actionId"] for action in group["action"]] == [
                [str(k)] for k in range(len(group["action"]))
            ]
            for action in group["action"]:
                (parameters,) = action["actionActuatorFuncParam"]
                assert set(parameters) == ACTIONS[action["actionActuatorFunc"][0]]
    assert numbers == list(range(len(numbers)))
    assert all(
        len(value) == 1 for part in (config, folder) for key, value in part.items() if key != "Placemark"
    )


def waylines(*items, **more):
    ((document,),) = plain(trees(*items, **more)[1]).values()
    (folder,) = document["Folder"]
    return document["missionConfig"][0], folder, folder["Placemark"]


def groups_of(mark):
    return [
        (
            group["actionTrigger"][0],
            group["actionGroupEndIndex"][0],
            [action["actionActuatorFunc"][0] for action in group["action"]],
        )
        for group in mark.get("actionGroup", [])
    ]


REACHED = {"actionTriggerType": ["reachPoint"]}


def test_the_flight_is_that_of_the_mission():
    config, folder, marks = waylines(*FULL)
    assert config["finishAction"] == ["goHome"]
    assert config["takeOffSecurityHeight"] == ["15.0"]
    assert config["globalRTHHeight"] == ["12.0"]
    assert folder["executeHeightMode"] == ["relativeToStartPoint"]
    assert [mark["executeHeight"][0] for mark in marks] == ["10.0", "10.0", "12.0", "10.0", "10.0"]
    # The speed of the leg that begins at the waypoint.
    assert [mark["waypointSpeed"][0] for mark in marks] == ["7.5"] * 5
    headings = [mark["waypointHeadingParam"][0] for mark in marks]
    assert headings[2] == {
        "waypointHeadingMode": ["smoothTransition"],
        "waypointHeadingAngle": ["-90"],
        "waypointHeadingPathMode": ["followBadArc"],
    }
    assert {heading["waypointHeadingMode"][0] for heading in (*headings[:2], *headings[3:])} == {
        "followWayline"
    }
    every = {"actionTriggerType": ["multipleDistance"], "actionTriggerParam": ["5.0"]}
    timed = {"actionTriggerType": ["multipleTiming"], "actionTriggerParam": ["2.0"]}
    assert [groups_of(mark) for mark in marks] == [
        [(REACHED, "0", ["gimbalRotate"]), (every, "2", ["takePhoto"])],
        [(REACHED, "1", ["hover"])],
        [(REACHED, "2", ["takePhoto", "startRecord"])],
        [(REACHED, "3", ["stopRecord"]), (timed, "4", ["takePhoto"])],
        [],
    ]
    assert losses(Mission(FULL), "a.wpml.kmz") == [
        dji.Loss("the file names the drone Mavic 3M; for another drone, edit droneInfo and payloadInfo")
    ]


def test_a_landing_is_where_it_was_planned():
    land = MissionItem(21, 3, x=28.06, y=-82.15, z=0.0)
    config, _, marks = waylines(waypoint(1), land)
    assert config["finishAction"] == ["autoLand"]
    assert [mark["Point"][0]["coordinates"][0] for mark in marks] == ["-82.15,28.051", "-82.15,28.06"]
    assert marks[1]["executeHeight"] == ["10.0"]
    assert len(waylines(waypoint(10), land)[2]) == 1
    assert waylines(waypoint(1))[0]["finishAction"] == ["noAction"]


def test_altitudes_above_the_sea_need_a_home():
    above_sea = MissionItem(16, 0, x=28.05, y=-82.15, z=45.0)
    _, _, marks = waylines(above_sea, home=HOME)
    assert marks[0]["executeHeight"] == ["15.0"]
    for item in (above_sea, MissionItem(16, 10, x=28.05, y=-82.15, z=45.0)):
        with pytest.raises(MissionFileError, match=r"item 1: its altitude is in frame .* give frame 3"):
            dji.dumps(Mission((item,)))
    with pytest.raises(MissionFileError, match="no waypoint"):
        dji.dumps(Mission((TAKEOFF, MissionItem(20))))


def test_what_dji_does_not_hold_is_said():
    mission = Mission(
        (
            MissionItem(21, 3, x=28.0, y=-82.0),
            waypoint(1),
            MissionItem(177, 2, 0.0, 2.0),
            MissionItem(201, 3, x=28.0, y=-82.0, z=1.0),
            MissionItem(1000, 2, -45.0, 90.0),
            MissionItem(178, 2, 2.0, 3.0),
            MissionItem(203, 2, x=0.0),
            MissionItem(2000, 2, 0.0, 1.0, 7.0),
            MissionItem(16, 3),
            MissionItem(20),
            waypoint(2),
            TAKEOFF,
        ),
        home=HOME,
        fence=(MissionItem(5003, 0, 50.0, x=28.0, y=-82.0),),
        rally=(MissionItem(5100, 3, x=28.0, y=-82.0),) * 2,
    )
    said = losses(mission, "a.wpml.kmz")
    assert [loss.text for loss in said if loss.changes_flight] == [
        "NAV_LAND is not kept (mission item 1)",
        "DO_JUMP is not kept (mission item 3)",
        "DO_SET_ROI is not kept (mission item 4)",
        "command 1000 is not kept (mission item 5)",
        "DO_CHANGE_SPEED is not kept (mission item 6)",
        "command 203 is not kept (mission item 7)",
        "IMAGE_START_CAPTURE is not kept (mission item 8)",
        "NAV_WAYPOINT is not kept (mission items 9, 11)",
        "NAV_TAKEOFF is not kept (mission item 12)",
        "fence items are not kept (1 of 1)",
        "rally points are not kept (2 of 2)",
    ]
    assert "home is not kept: heights are above the drone's take-off point" in [loss.text for loss in said]
