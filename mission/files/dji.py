"""DJI's wayline files (WPML 1.0.2 in a KMZ archive), only written: waypoints, speeds, waits, camera, gimbal.

Heights are above the take-off. The vehicle stops at each waypoint and flies straight to the next. A take-off
gives the height to which the drone climbs first, a landing or return at the end what it does then. A heading
of 0 is taken as none, because ArduPilot's files have it everywhere.

Source: DJI Cloud API, "WPML" (developer.dji.com/doc/cloud-api-tutorial, github.com/dji-sdk/Cloud-API-Doc):
overview, template.kml, waylines.wpml, common elements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias
from xml.etree import ElementTree

from mission.errors import MissionFileError
from mission.files.common import Firmware
from mission.files.comparison import Loss, dropped, numbered
from mission.files.kml import archive_of
from mission.files.records import command_name, is_placed
from mission.files.xml import add, decimal, document
from mission.model import Command, Frame, Mission, MissionItem

# A Mavic 3 Multispectral and its camera (common elements, droneInfo and payloadInfo).
_DRONE = (77, 2)
_PAYLOAD = 68
_IMAGES = "visible,narrow_band"
_DRONE_NAME = "Mavic 3M"
_FASTEST_TRANSIT_M_S = 15.0
_USUAL_SPEED_M_S = 5.0
_SECURITY_HEIGHTS_M = (2.0, 1500.0)

Action: TypeAlias = tuple[str, Mapping[str, Any]]


@dataclass(slots=True)
class _Waypoint:
    latitude_deg: float
    longitude_deg: float
    height_m: float
    heading_deg: float | None
    speed_m_s: float
    actions: list[Action] = field(default_factory=list)


@dataclass(slots=True)
class _Group:
    """Actions from one waypoint to another; of what has no end yet it is None."""

    start: int
    end: int | None
    trigger: Mapping[str, Any]
    actions: Sequence[Action]


@dataclass(slots=True)
class _Route:
    """What a wayline file holds of a mission, and what it does not."""

    mission: Mission
    speed_m_s: float
    waypoints: list[_Waypoint] = field(default_factory=list)
    repeats: list[_Group] = field(default_factory=list)
    finish: str = "noAction"
    takeoff_m: float | None = None
    lost: dict[str, list[int]] = field(default_factory=dict)
    first_actions: list[Action] = field(default_factory=list)

    def act(self, function: str, **parameters: Any) -> None:
        """Let the drone do something at the last waypoint, or at the first where there is none yet."""
        (self.waypoints[-1].actions if self.waypoints else self.first_actions).append((function, parameters))

    def end_repeat(self) -> None:
        if self.repeats and self.repeats[-1].end is None:
            self.repeats[-1].end = max(len(self.waypoints) - 1, 0)

    def repeat(self, kind: str, every: float) -> None:
        """Take photos every so many metres or seconds, until the next call."""
        self.end_repeat()
        if every > 0.0:
            trigger = {"actionTriggerType": kind, "actionTriggerParam": float(every)}
            self.repeats.append(_Group(max(len(self.waypoints) - 1, 0), None, trigger, [("takePhoto", {})]))

    def groups(self) -> dict[int, list[tuple[int, _Group]]]:
        """Return the groups of actions by the waypoint at which they begin, each with its number."""
        reached = {"actionTriggerType": "reachPoint"}
        made = [_Group(k, k, reached, one.actions) for k, one in enumerate(self.waypoints) if one.actions]
        made = sorted(made + self.repeats, key=lambda group: group.start)
        found: dict[int, list[tuple[int, _Group]]] = {}
        for number, group in enumerate(made):
            found.setdefault(group.start, []).append((number, group))
        return found


def _waypoint(route: _Route, item: MissionItem, number: int) -> bool:
    if not is_placed(item):
        return False
    height_m, home = item.z, route.mission.home
    if item.frame == Frame.GLOBAL and home is not None:
        height_m -= home.altitude_m
    elif item.frame != Frame.GLOBAL_RELATIVE_ALT:
        msg = (
            f"item {number}: its altitude is in frame {item.frame}, a DJI file holds heights above the"
            " take-off; give frame 3, or frame 0 and a home"
        )
        raise MissionFileError(msg)
    heading_deg = item.param4 if item.command == Command.NAV_WAYPOINT and item.param4 else None
    made = _Waypoint(float(item.x), float(item.y), float(height_m), heading_deg, route.speed_m_s)
    made.actions, route.first_actions = route.first_actions, []
    route.waypoints.append(made)
    _hover(route, item, number)
    return True


def _hover(route: _Route, item: MissionItem, _number: int) -> bool:
    if item.param1 is not None and item.param1 > 0.0:
        route.act("hover", hoverTime=item.param1)
    return True


def _take_off(route: _Route, item: MissionItem, _number: int) -> bool:
    if route.waypoints or item.frame not in (Frame.GLOBAL_RELATIVE_ALT, Frame.MISSION):
        return False
    route.takeoff_m = item.z
    return True


def _return(route: _Route, _item: MissionItem, _number: int) -> bool:
    route.finish = "goHome"
    return True


def _land(route: _Route, item: MissionItem, _number: int) -> bool:
    if not route.waypoints:
        return False
    last = route.waypoints[-1]
    if is_placed(item) and (item.x, item.y) != (last.latitude_deg, last.longitude_deg):
        above = _Waypoint(float(item.x), float(item.y), last.height_m, None, route.speed_m_s)
        route.waypoints.append(above)
    route.finish = "autoLand"
    return True


def _speed(route: _Route, item: MissionItem, _number: int) -> bool:
    speed_m_s = item.param2
    if item.param1 not in (0.0, 1.0) or speed_m_s is None or speed_m_s <= 0.0:
        return False
    route.speed_m_s = speed_m_s
    if route.waypoints:  # of the leg that begins there
        route.waypoints[-1].speed_m_s = speed_m_s
    return True


def _photos(route: _Route, item: MissionItem, _number: int) -> bool:
    interval_s, count = item.param2 or 0.0, item.param3 or 0.0
    if count == 1.0:
        route.act("takePhoto")
    elif count == 0.0 and interval_s > 0.0:
        route.repeat("multipleTiming", interval_s)
    else:
        return False
    return True


def _shutter(route: _Route, item: MissionItem, _number: int) -> bool:
    if item.x == 1.0:
        route.act("takePhoto")
    return item.x == 1.0


def _distance(route: _Route, item: MissionItem, _number: int) -> bool:
    route.repeat("multipleDistance", item.param1 or 0.0)
    return True


def _interval(route: _Route, item: MissionItem, _number: int) -> bool:
    route.repeat("multipleTiming", (item.param1 or 0.0) / 1000.0)
    return True


def _stop(route: _Route, _item: MissionItem, _number: int) -> bool:
    route.end_repeat()
    return True


def _video(function: str) -> _Step:
    def record(route: _Route, _item: MissionItem, _number: int) -> bool:
        route.act(function)
        return True

    return record


def _gimbal(route: _Route, item: MissionItem, _number: int) -> bool:
    yaw = item.param3 if item.command == _MOUNT_CONTROL else item.param2
    if item.param1 is None or yaw:
        return False
    route.act("gimbalRotate", pitch=item.param1)
    return True


_Step: TypeAlias = Callable[[_Route, MissionItem, int], bool]
_MOUNT_CONTROL = 205
_STEPS: Mapping[int, _Step] = {
    Command.NAV_WAYPOINT: _waypoint,
    Command.NAV_SPLINE_WAYPOINT: _waypoint,
    Command.NAV_LOITER_TIME: _waypoint,
    Command.NAV_DELAY: _hover,
    Command.NAV_TAKEOFF: _take_off,
    Command.NAV_RETURN_TO_LAUNCH: _return,
    Command.NAV_LAND: _land,
    Command.DO_CHANGE_SPEED: _speed,
    Command.IMAGE_START_CAPTURE: _photos,
    Command.IMAGE_STOP_CAPTURE: _stop,
    203: _shutter,  # DO_DIGICAM_CONTROL
    Command.DO_SET_CAM_TRIGG_DIST: _distance,
    Command.DO_SET_CAM_TRIGG_INTERVAL: _interval,
    2500: _video("startRecord"),
    2501: _video("stopRecord"),
    _MOUNT_CONTROL: _gimbal,
    1000: _gimbal,  # DO_GIMBAL_MANAGER_PITCHYAW
}


def _route(mission: Mission) -> _Route:
    """Bring a mission into DJI's form; MissionFileError if there is no waypoint, or a height is not known."""
    route = _Route(mission, float(mission.hover_speed_m_s) or _USUAL_SPEED_M_S)
    for number, item in enumerate(mission.items, 1):
        ended = route.finish != "noAction"
        step = _STEPS.get(item.command)
        if ended or step is None or not step(route, item, number):
            route.lost.setdefault(command_name(item.command), []).append(number)
    if not route.waypoints:
        raise MissionFileError("the mission has no waypoint; a DJI file needs one")
    route.end_repeat()
    return route


def losses(mission: Mission) -> Sequence[Loss]:
    """Tell what a wayline file does not hold of a mission."""
    found = [
        Loss(f"{name} is not kept ({numbered('mission item', at)})", True)
        for name, at in _route(mission).lost.items()
    ]
    found += dropped("fence item", len(mission.fence), len(mission.fence))
    found += dropped("rally point", len(mission.rally), len(mission.rally))
    if mission.home is not None:
        found.append(Loss("home is not kept: heights count from where the drone takes off"))
    found.append(Loss(f"the drone it names is a {_DRONE_NAME}; for another change droneInfo and payloadInfo"))
    return found


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> bytes:  # noqa: ARG001  one signature
    """Write what DJI's drones can fly of a mission as a KMZ file; `losses` tells what is left out.

    MissionFileError if there is no waypoint, or a height above the take-off is not known.
    """
    route = _route(mission)
    return archive_of({"wpmz/template.kml": _template(route), "wpmz/waylines.wpml": _waylines(route)})


def _document() -> tuple[ElementTree.Element, ElementTree.Element]:
    spaces = {"xmlns": "http://www.opengis.net/kml/2.2", "xmlns:wpml": "http://www.dji.com/wpmz/1.0.2"}
    root = ElementTree.Element("kml", spaces)
    return root, add(root, "Document")


def _put(parent: ElementTree.Element, values: Mapping[str, Any]) -> ElementTree.Element:
    """Add elements of DJI's namespace by their names; a mapping is an element with elements."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            _put(add(parent, f"wpml:{name}"), value)
        else:
            add(parent, f"wpml:{name}", decimal(value) if isinstance(value, float) else str(value))
    return parent


def _config(route: _Route, more: Mapping[str, Any]) -> Mapping[str, Any]:
    low_m, high_m = _SECURITY_HEIGHTS_M
    wanted_m = route.waypoints[0].height_m if route.takeoff_m is None else route.takeoff_m
    return {
        "missionConfig": {
            "flyToWaylineMode": "safely",
            "finishAction": route.finish,
            "exitOnRCLost": "executeLostAction",
            "executeRCLostAction": "goBack",
            "takeOffSecurityHeight": float(min(max(wanted_m, low_m), high_m)),
            "globalTransitionalSpeed": min(route.waypoints[0].speed_m_s, _FASTEST_TRANSIT_M_S),
            **more,
            "droneInfo": {"droneEnumValue": _DRONE[0], "droneSubEnumValue": _DRONE[1]},
            "payloadInfo": {
                "payloadEnumValue": _PAYLOAD,
                "payloadSubEnumValue": 0,
                "payloadPositionIndex": 0,
            },
        }
    }


def _template(route: _Route) -> str:
    root, top = _document()
    first = route.waypoints[0]
    _put(top, {"author": "wbf-mission", **_config(route, {})})
    folder = _put(
        add(top, "Folder"),
        {
            "templateType": "waypoint",
            "templateId": 0,
            "waylineCoordinateSysParam": {"coordinateMode": "WGS84", "heightMode": "relativeToStartPoint"},
            "autoFlightSpeed": first.speed_m_s,
            "globalHeight": first.height_m,
            "gimbalPitchMode": "manual",
            "globalWaypointHeadingParam": _heading(None),
            "globalWaypointTurnMode": _TURN,
        },
    )
    groups = route.groups()
    for index, waypoint in enumerate(route.waypoints):
        same_height = waypoint.height_m == first.height_m
        same_speed = waypoint.speed_m_s == first.speed_m_s
        heights = {} if same_height else {"ellipsoidHeight": waypoint.height_m, "height": waypoint.height_m}
        heading = waypoint.heading_deg
        values = {
            "useGlobalHeight": int(same_height),
            **heights,
            "useGlobalSpeed": int(same_speed),
            **({} if same_speed else {"waypointSpeed": waypoint.speed_m_s}),
            "useGlobalHeadingParam": int(heading is None),
            **({} if heading is None else {"waypointHeadingParam": _heading(heading)}),
            "useGlobalTurnParam": 1,
        }
        _placemark(folder, index, waypoint, values, groups.get(index, ()))
    _put(folder, {"payloadParam": {"payloadPositionIndex": 0, "imageFormat": _IMAGES}})
    return document(root)


def _waylines(route: _Route) -> str:
    root, top = _document()
    highest_m = max(_SECURITY_HEIGHTS_M[0], *(waypoint.height_m for waypoint in route.waypoints))
    _put(top, _config(route, {"globalRTHHeight": highest_m}))
    folder = _put(
        add(top, "Folder"),
        {
            "templateId": 0,
            "executeHeightMode": "relativeToStartPoint",
            "waylineId": 0,
            "autoFlightSpeed": route.waypoints[0].speed_m_s,
        },
    )
    groups = route.groups()
    for index, waypoint in enumerate(route.waypoints):
        values = {
            "executeHeight": waypoint.height_m,
            "waypointSpeed": waypoint.speed_m_s,
            "waypointHeadingParam": _heading(waypoint.heading_deg),
            "waypointTurnParam": {"waypointTurnMode": _TURN, "waypointTurnDampingDist": 0},
        }
        _placemark(folder, index, waypoint, values, groups.get(index, ()))
    return document(root)


_TURN = "toPointAndStopWithDiscontinuityCurvature"


def _heading(heading_deg: float | None) -> Mapping[str, Any]:
    if heading_deg is None:
        return {"waypointHeadingMode": "followWayline", "waypointHeadingPathMode": "followBadArc"}
    return {
        "waypointHeadingMode": "smoothTransition",
        "waypointHeadingAngle": round((heading_deg + 180.0) % 360.0 - 180.0),
        "waypointHeadingPathMode": "followBadArc",
    }


def _placemark(
    folder: ElementTree.Element,
    index: int,
    waypoint: _Waypoint,
    values: Mapping[str, Any],
    groups: Sequence[tuple[int, _Group]],
) -> None:
    mark = add(folder, "Placemark")
    place = f"{decimal(waypoint.longitude_deg)},{decimal(waypoint.latitude_deg)}"
    add(add(mark, "Point"), "coordinates", place)
    _put(mark, {"index": index, **values})
    for number, group in groups:
        element = _put(
            add(mark, "wpml:actionGroup"),
            {
                "actionGroupId": number,
                "actionGroupStartIndex": group.start,
                "actionGroupEndIndex": group.end,
                "actionGroupMode": "sequence",
                "actionTrigger": group.trigger,
            },
        )
        for action_id, (function, given) in enumerate(group.actions):
            action = {"actionId": action_id, "actionActuatorFunc": function}
            parameters = _parameters(function, given, index)
            _put(add(element, "wpml:action"), {**action, "actionActuatorFuncParam": parameters})


def _parameters(function: str, given: Mapping[str, Any], index: int) -> Mapping[str, Any]:
    """Return the parameters that DJI requires of an action."""
    if function == "hover":
        return {"hoverTime": float(given["hoverTime"])}
    payload: dict[str, Any] = {"payloadPositionIndex": 0}
    if function == "gimbalRotate":
        return {
            **payload,
            "gimbalHeadingYawBase": "north",
            "gimbalRotateMode": "absoluteAngle",
            "gimbalPitchRotateEnable": 1,
            "gimbalPitchRotateAngle": float(given["pitch"]),
            **dict.fromkeys(("gimbalRollRotateEnable", "gimbalRollRotateAngle"), 0),
            **dict.fromkeys(("gimbalYawRotateEnable", "gimbalYawRotateAngle"), 0),
            **dict.fromkeys(("gimbalRotateTimeEnable", "gimbalRotateTime"), 0),
        }
    if function == "stopRecord":
        return payload
    return {**payload, "fileSuffix": f"point{index}", "useGlobalPayloadLensIndex": 1}
