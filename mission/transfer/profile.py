"""How autopilots differ in the mission protocol, as data for both roles.

Sources: PX4 ``mavlink_mission.cpp``/``.h``, ArduPilot ``MissionItemProtocol*.cpp`` and ``AP_Mission.cpp``,
and what PX4 1.17 (SIH) and ArduCopter 4.7 (SITL) were seen to do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from mission.link.dialect import mavlink
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.transfer import wire

_GLOBAL_AND_MISSION = frozenset({0, 2, 3, 5, 6})


@dataclass(frozen=True, slots=True)
class Profile:
    """One autopilot's habits.

    Parameters
    ----------
    name : str
        For messages.
    autopilot : int
        MAV_AUTOPILOT of its heartbeat.
    home_at_zero : bool
        Item 0 of the mission on the wire is home; ours follow it and jump targets count from there.
    atomic : bool
        The old plan is kept until the new one is complete.
    request_int : bool
        The vehicle asks with MISSION_REQUEST_INT (otherwise with MISSION_REQUEST).
    float_answers : bool
        The vehicle answers MISSION_REQUEST with the float MISSION_ITEM.
    stateless_download : bool
        The vehicle answers any request at any time, so a client may ask for several items at once.
    restart_on_count : bool
        A second COUNT of the same ground station restarts an upload at any point (otherwise only before
        item 0).
    re_request_s, abort_s : float
        The vehicle's timers: ask again for an item; give up after nothing has come for so long.
    abort_result : int or None
        ACK that it sends when it gives an upload up, None for none.
    busy_result : int
        ACK for a COUNT while another transfer runs.
    order_result : int or None
        ACK for an item out of order, None for none.
    range_result : int or None
        ACK for a request beyond the plan, None for none.
    clear_all_types : bool
        MISSION_CLEAR_ALL with type 255 clears all three plans (otherwise UNSUPPORTED).
    frames : frozenset of int or None
        MAV_FRAMEs that are accepted; None for any.
    usual_limits : tuple of int or None
        Items that common boards hold, per plan; beyond it `count_warning` speaks up.
    lossy : mapping
        Per command, the fields of an item that it does not keep, for the comparison after an upload.
    whole_seconds : bool
        A waypoint's hold time is kept in whole seconds.
    keeps_default : bool
        A NaN parameter reads back as NaN (otherwise as 0).
    """

    name: str
    autopilot: int
    home_at_zero: bool = False
    atomic: bool = True
    request_int: bool = True
    float_answers: bool = False
    stateless_download: bool = False
    restart_on_count: bool = False
    re_request_s: float = 0.25
    abort_s: float = 5.0
    abort_result: int | None = None
    busy_result: int = wire.ERROR
    order_result: int | None = None
    range_result: int | None = wire.ERROR
    clear_all_types: bool = True
    frames: frozenset[int] | None = None
    usual_limits: tuple[int | None, int | None, int | None] = (None, None, None)
    lossy: Mapping[int, frozenset[str]] = field(default_factory=dict)
    whole_seconds: bool = False
    keeps_default: bool = True


GENERIC = Profile("the vehicle", mavlink.MAV_AUTOPILOT_GENERIC)

PX4 = Profile(
    "PX4",
    mavlink.MAV_AUTOPILOT_PX4,
    float_answers=True,
    frames=_GLOBAL_AND_MISSION,
    range_result=None,
    usual_limits=(500, 64, 32),
    lossy={
        Command.NAV_WAYPOINT: frozenset({"param3"}),
        Command.NAV_TAKEOFF: frozenset({"param1", "param2", "param3"}),
        Command.NAV_LAND: frozenset({"param1", "param2", "param3"}),
    },
)

ARDUPILOT = Profile(
    "ArduPilot",
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    home_at_zero=True,
    atomic=False,
    request_int=False,
    float_answers=True,
    stateless_download=True,
    restart_on_count=True,
    re_request_s=1.0,
    abort_s=8.0,
    abort_result=wire.OPERATION_CANCELLED,
    busy_result=wire.DENIED,
    order_result=wire.INVALID_SEQUENCE,
    range_result=wire.INVALID_SEQUENCE,
    clear_all_types=False,
    frames=_GLOBAL_AND_MISSION | {10, 11},
    usual_limits=(718, 200, None),
    lossy={
        Command.NAV_WAYPOINT: frozenset({"param2", "param3", "param4", "autocontinue"}),
        Command.NAV_TAKEOFF: frozenset({"param1", "param2", "param3", "param4", "x", "y", "frame"}),
        Command.NAV_LAND: frozenset({"param2", "param3", "param4"}),
        Command.NAV_RETURN_TO_LAUNCH: frozenset({"frame", "x", "y", "z", "param2", "param3", "param4"}),
        Command.DO_CHANGE_SPEED: frozenset({"frame", "param4"}),
        Command.DO_SET_CAM_TRIGG_DIST: frozenset({"frame", "param2", "param4"}),
        Command.DO_JUMP: frozenset({"frame", "param3", "param4"}),
    },
    whole_seconds=True,
    keeps_default=False,
)


def profile_for(autopilot: int) -> Profile:
    """Return the profile for the MAV_AUTOPILOT of a heartbeat, `GENERIC` for any other.

    Examples
    --------
    >>> profile_for(12).name
    'PX4'
    """
    return {PX4.autopilot: PX4, ARDUPILOT.autopilot: ARDUPILOT}.get(autopilot, GENERIC)


def count_warning(profile: Profile, mission_type: MissionType, number: int) -> str | None:
    """Return a line of warning if common boards of this autopilot do not hold so many items.

    Examples
    --------
    >>> count_warning(PX4, MissionType.MISSION, 501)
    '501 mission items: many PX4 boards hold only 500'
    """
    limit = profile.usual_limits[mission_type]
    if limit is None or number <= limit:
        return None
    return f"{number} {mission_type.name.lower()} items: many {profile.name} boards hold only {limit}"


def _shift_jump(item: MissionItem, by: int) -> MissionItem:
    if item.command != Command.DO_JUMP or item.param1 is None:
        return item
    return replace(item, param1=item.param1 + by)


def to_wire_order(
    items: tuple[MissionItem, ...], mission_type: MissionType, profile: Profile, home: GeoPoint | None = None
) -> tuple[MissionItem, ...]:
    """Return the items as the autopilot counts them: home in front and jump targets moved, if it does so."""
    if not profile.home_at_zero or mission_type != MissionType.MISSION or not items:
        return items
    place = GeoPoint(0.0, 0.0, 0.0) if home is None else home
    first = MissionItem(
        Command.NAV_WAYPOINT, Frame.GLOBAL, x=place.latitude_deg, y=place.longitude_deg, z=place.altitude_m
    )
    return (first, *(_shift_jump(item, 1) for item in items))


def from_wire_order(
    items: tuple[MissionItem, ...], mission_type: MissionType, profile: Profile
) -> tuple[tuple[MissionItem, ...], GeoPoint | None]:
    """Undo `to_wire_order`: return the items and the home position, if there was one in front."""
    if not profile.home_at_zero or mission_type != MissionType.MISSION or not items:
        return items, None
    home = GeoPoint(items[0].x, items[0].y, items[0].z) if items[0].has_place else None
    return tuple(_shift_jump(item, -1) for item in items[1:]), home
