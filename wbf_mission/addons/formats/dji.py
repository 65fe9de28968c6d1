"""Writes DJI wayline files (WPML 1.0.2 in a KMZ archive): waypoints, speeds, waits, camera and gimbal.

Heights are above the take-off point. The drone stops at each waypoint and flies straight to the next. The
altitude of a take-off item is the height to which the drone climbs first. A landing or return at the end of
the mission sets the finish action. A heading of 0 is ignored, because waypoints in ArduPilot's files always
have the heading 0.

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
from mission.files.formats import Loss, dropped, numbered
from mission.model import Command, Frame, Mission, MissionItem
from wbf_mission.addons.base.archive import archive_of
from wbf_mission.addons.base.markup import add, decimal, document
from wbf_mission.addons.formats.records import command_name, is_placed

_DRONE_NAME = "Mavic 3M"
# DJI's enum values of the drone and its camera (in "common elements": droneInfo and payloadInfo).
_DRONE = {
    "droneInfo": {"droneEnumValue": 77, "droneSubEnumValue": 2},
    "payloadInfo": {"payloadEnumValue": 68, "payloadSubEnumValue": 0, "payloadPositionIndex": 0},
}
_IMAGES = {"payloadParam": {"payloadPositionIndex": 0, "imageFormat": "visible,narrow_band"}}
_TURN = "toPointAndStopWithDiscontinuityCurvature"
_FASTEST_TRANSIT_M_S = 15.0
_USUAL_SPEED_M_S = 5.0
_SECURITY_HEIGHTS_M = (2.0, 1500.0)
_REACHED = {"actionTriggerType": "reachPoint"}
_PAYLOAD = {"payloadPositionIndex": 0}
_STORED = {**_PAYLOAD, "fileSuffix": "wbf", "useGlobalPayloadLensIndex": 1}
_GIMBAL = {
    **_PAYLOAD,
    "gimbalHeadingYawBase": "north",
    "gimbalRotateMode": "absoluteAngle",
    "gimbalPitchRotateEnable": 1,
    **dict.fromkeys(("gimbalRollRotateEnable", "gimbalRollRotateAngle"), 0),
    **dict.fromkeys(("gimbalYawRotateEnable", "gimbalYawRotateAngle"), 0),
    **dict.fromkeys(("gimbalRotateTimeEnable", "gimbalRotateTime"), 0),
}

_OF_KML = ("Folder", "Placemark", "Point", "coordinates")  # All other elements are in DJI's namespace.

Action: TypeAlias = tuple[str, Mapping[str, Any]]


@dataclass(slots=True)
class _Waypoint:
    latitude_deg: float
    longitude_deg: float
    height_m: float
    heading_deg: float | None
    speed_m_s: float
    actions: list[Action]


@dataclass(slots=True)
class _Group:
    """Actions from waypoint `start` to waypoint `end`, which is None until it is known."""

    start: int
    end: int | None
    trigger: Mapping[str, Any]
    actions: Sequence[Action]


@dataclass(slots=True)
class _Route:
    """A mission as a wayline route, and the items that are lost. Methods return whether they keep an item."""

    mission: Mission
    speed_m_s: float
    waypoints: list[_Waypoint] = field(default_factory=list)
    repeats: list[_Group] = field(default_factory=list)
    finish: str = "noAction"
    takeoff_m: float | None = None
    lost: dict[str, list[int]] = field(default_factory=dict)
    first_actions: list[Action] = field(default_factory=list)

    def act(self, function: str, parameters: Mapping[str, Any]) -> bool:
        """Add an action at the latest waypoint; before the first waypoint, at the first waypoint."""
        (self.waypoints[-1].actions if self.waypoints else self.first_actions).append((function, parameters))
        return True

    def repeat(self, kind: str, every: float) -> bool:
        """Take a photo every `every` metres or seconds until the next call; 0 stops the photos."""
        here = max(len(self.waypoints) - 1, 0)
        if self.repeats and self.repeats[-1].end is None:
            self.repeats[-1].end = here
        if every > 0.0:
            trigger = {"actionTriggerType": kind, "actionTriggerParam": float(every)}
            self.repeats.append(_Group(here, None, trigger, [("takePhoto", _STORED)]))
        return True

    def fly_to(self, item: MissionItem, height_m: float, heading_deg: float | None = None) -> None:
        place = (float(item.x), float(item.y), float(height_m))
        self.waypoints.append(_Waypoint(*place, heading_deg, self.speed_m_s, self.first_actions))
        self.first_actions = []

    def wait(self, seconds: float | None) -> bool:
        return seconds is None or seconds <= 0.0 or self.act("hover", {"hoverTime": float(seconds)})

    def waypoint(self, item: MissionItem) -> bool:
        if not is_placed(item):
            return False
        height_m, home = item.z, self.mission.home
        if item.frame == Frame.GLOBAL and home is not None:
            height_m -= home.altitude_m
        elif item.frame != Frame.GLOBAL_RELATIVE_ALT:
            raise MissionFileError(
                f"its altitude is in frame {item.frame}, but a DJI file has heights above the take-off;"
                " give frame 3, or frame 0 and a home"
            )
        is_plain = item.command == Command.NAV_WAYPOINT
        self.fly_to(item, height_m, item.param4 if is_plain and item.param4 else None)
        return self.wait(item.param1)

    def take_off(self, item: MissionItem) -> bool:
        if self.waypoints or item.frame not in (Frame.GLOBAL_RELATIVE_ALT, Frame.MISSION):
            return False
        self.takeoff_m = item.z
        return True

    def go_home(self, _item: MissionItem) -> bool:
        self.finish = "goHome"
        return True

    def land(self, item: MissionItem) -> bool:
        if not self.waypoints:
            return False
        last = self.waypoints[-1]
        if is_placed(item) and (item.x, item.y) != (last.latitude_deg, last.longitude_deg):
            self.fly_to(item, last.height_m)
        self.finish = "autoLand"
        return True

    def speed(self, item: MissionItem) -> bool:
        if item.param1 not in (0.0, 1.0) or item.param2 is None or item.param2 <= 0.0:
            return False
        self.speed_m_s = item.param2
        if self.waypoints:  # The speed of a waypoint is for the leg that starts there.
            self.waypoints[-1].speed_m_s = item.param2
        return True

    def photos(self, item: MissionItem) -> bool:
        interval_s, count = item.param2 or 0.0, item.param3 or 0.0
        if count == 1.0:
            return self.act("takePhoto", _STORED)
        return count == 0.0 and interval_s > 0.0 and self.repeat("multipleTiming", interval_s)

    def pitch(self, pitch_deg: float | None, yaw_deg: float | None) -> bool:
        if pitch_deg is None or yaw_deg:
            return False
        return self.act("gimbalRotate", _GIMBAL | {"gimbalPitchRotateAngle": float(pitch_deg)})

    def groups(self) -> list[list[Mapping[str, Any]]]:
        """Return the action groups that start at each waypoint."""
        found: list[list[Mapping[str, Any]]] = [[] for _ in self.waypoints]
        made = [_Group(k, k, _REACHED, each.actions) for k, each in enumerate(self.waypoints) if each.actions]
        for number, group in enumerate(sorted(made + self.repeats, key=lambda group: group.start)):
            actions = [
                {"actionId": k, "actionActuatorFunc": function, "actionActuatorFuncParam": parameters}
                for k, (function, parameters) in enumerate(group.actions)
            ]
            found[group.start].append(
                {
                    "actionGroupId": number,
                    "actionGroupStartIndex": group.start,
                    "actionGroupEndIndex": group.end,
                    "actionGroupMode": "sequence",
                    "actionTrigger": group.trigger,
                    "action": actions,
                }
            )
        return found


_STEPS: Mapping[int, Callable[[_Route, MissionItem], bool]] = {
    **dict.fromkeys((16, 19, 82), _Route.waypoint),  # Waypoint, loiter for a time, spline
    Command.NAV_DELAY: lambda route, item: route.wait(item.param1),
    Command.NAV_TAKEOFF: _Route.take_off,
    Command.NAV_RETURN_TO_LAUNCH: _Route.go_home,
    Command.NAV_LAND: _Route.land,
    Command.DO_CHANGE_SPEED: _Route.speed,
    Command.IMAGE_START_CAPTURE: _Route.photos,
    Command.IMAGE_STOP_CAPTURE: lambda route, _: route.repeat("", 0.0),
    Command.DO_SET_CAM_TRIGG_DIST: lambda route, item: route.repeat("multipleDistance", item.param1 or 0.0),
    Command.DO_SET_CAM_TRIGG_INTERVAL: lambda route, item: route.repeat(
        "multipleTiming", (item.param1 or 0.0) / 1000.0
    ),
    203: lambda route, item: item.x == 1.0 and route.act("takePhoto", _STORED),  # DO_DIGICAM_CONTROL
    205: lambda route, item: route.pitch(item.param1, item.param3),  # DO_MOUNT_CONTROL
    1000: lambda route, item: route.pitch(item.param1, item.param2),  # DO_GIMBAL_MANAGER_PITCHYAW
    2500: lambda route, _: route.act("startRecord", _STORED),  # VIDEO_START_CAPTURE
    2501: lambda route, _: route.act("stopRecord", _PAYLOAD),  # VIDEO_STOP_CAPTURE
}


def _route(mission: Mission) -> _Route:
    """Convert a mission to a route; MissionFileError if there is no waypoint, or a height is unknown."""
    route = _Route(mission, float(mission.hover_speed_m_s) or _USUAL_SPEED_M_S)
    for number, item in enumerate(mission.items, 1):
        step = _STEPS.get(item.command)
        try:
            taken = route.finish == "noAction" and step is not None and step(route, item)
        except MissionFileError as error:
            raise MissionFileError(f"item {number}: {error}") from None
        if not taken:
            route.lost.setdefault(command_name(item.command), []).append(number)
    if not route.waypoints:
        raise MissionFileError("the mission has no waypoint; a DJI file needs one")
    route.repeat("", 0.0)
    return route


def losses(mission: Mission) -> Sequence[Loss]:
    """Return the parts of a mission that a wayline file cannot contain."""
    found = [
        Loss(f"{name} is not kept ({numbered('mission item', at)})", True)
        for name, at in _route(mission).lost.items()
    ]
    found += dropped("fence item", len(mission.fence), len(mission.fence))
    found += dropped("rally point", len(mission.rally), len(mission.rally))
    if mission.home is not None:
        found.append(Loss("home is not kept: heights are above the drone's take-off point"))
    others = "for another drone, edit droneInfo and payloadInfo"
    found.append(Loss(f"the file names the drone {_DRONE_NAME}; {others}"))
    return found


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> bytes:  # noqa: ARG001  one signature
    """Write a mission as a DJI KMZ file; `losses` returns the parts that are not kept.

    Raises MissionFileError without a waypoint, or if a height above take-off is unknown.
    """
    route = _route(mission)
    first, groups = route.waypoints[0], route.groups()
    low_m, high_m = _SECURITY_HEIGHTS_M
    wanted_m = first.height_m if route.takeoff_m is None else route.takeoff_m
    config = {
        "flyToWaylineMode": "safely",
        "finishAction": route.finish,
        "exitOnRCLost": "executeLostAction",
        "executeRCLostAction": "goBack",
        "takeOffSecurityHeight": float(min(max(wanted_m, low_m), high_m)),
        "globalTransitionalSpeed": min(first.speed_m_s, _FASTEST_TRANSIT_M_S),
    }
    template = {
        "author": "wbf-mission",
        "missionConfig": config | _DRONE,
        "Folder": {
            "templateType": "waypoint",
            "templateId": 0,
            "waylineCoordinateSysParam": {"coordinateMode": "WGS84", "heightMode": "relativeToStartPoint"},
            "autoFlightSpeed": first.speed_m_s,
            "globalHeight": first.height_m,
            "gimbalPitchMode": "manual",
            "globalWaypointHeadingParam": _heading(None),
            "globalWaypointTurnMode": _TURN,
            "Placemark": [
                {
                    "Point": _point(waypoint),
                    "index": index,
                    "useGlobalHeight": 0,
                    # Both elements contain the height above the take-off point.
                    "ellipsoidHeight": waypoint.height_m,
                    "height": waypoint.height_m,
                    "useGlobalSpeed": 0,
                    "waypointSpeed": waypoint.speed_m_s,
                    "useGlobalHeadingParam": 0,
                    "waypointHeadingParam": _heading(waypoint.heading_deg),
                    "useGlobalTurnParam": 1,
                    "actionGroup": groups[index],
                }
                for index, waypoint in enumerate(route.waypoints)
            ],
            **_IMAGES,
        },
    }
    highest_m = max(low_m, *(waypoint.height_m for waypoint in route.waypoints))
    waylines = {
        "missionConfig": config | {"globalRTHHeight": highest_m} | _DRONE,
        "Folder": {
            "templateId": 0,
            "executeHeightMode": "relativeToStartPoint",
            "waylineId": 0,
            "autoFlightSpeed": first.speed_m_s,
            "Placemark": [
                {
                    "Point": _point(waypoint),
                    "index": index,
                    "executeHeight": waypoint.height_m,
                    "waypointSpeed": waypoint.speed_m_s,
                    "waypointHeadingParam": _heading(waypoint.heading_deg),
                    "waypointTurnParam": {"waypointTurnMode": _TURN, "waypointTurnDampingDist": 0},
                    "actionGroup": groups[index],
                }
                for index, waypoint in enumerate(route.waypoints)
            ],
        },
    }
    return archive_of({"wpmz/template.kml": _document(template), "wpmz/waylines.wpml": _document(waylines)})


def _point(waypoint: _Waypoint) -> Mapping[str, Any]:
    return {"coordinates": f"{decimal(waypoint.longitude_deg)},{decimal(waypoint.latitude_deg)}"}


def _heading(heading_deg: float | None) -> Mapping[str, Any]:
    if heading_deg is None:
        return {"waypointHeadingMode": "followWayline", "waypointHeadingPathMode": "followBadArc"}
    return {
        "waypointHeadingMode": "smoothTransition",
        "waypointHeadingAngle": round((heading_deg + 180.0) % 360.0 - 180.0),
        "waypointHeadingPathMode": "followBadArc",
    }


def _document(values: Mapping[str, Any]) -> str:
    spaces = {"xmlns": "http://www.opengis.net/kml/2.2", "xmlns:wpml": "http://www.dji.com/wpmz/1.0.2"}
    root = ElementTree.Element("kml", spaces)
    _put(add(root, "Document"), values)
    return document(root)


def _put(parent: ElementTree.Element, values: Mapping[str, Any]) -> None:
    """Add elements by name: a mapping becomes one element with children, a list becomes several elements."""
    for name, value in values.items():
        tag = name if name in _OF_KML else f"wpml:{name}"
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, Mapping):
                _put(add(parent, tag), part)
            else:
                add(parent, tag, decimal(part) if isinstance(part, float) else str(part))
