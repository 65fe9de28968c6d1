"""Checks with whole plans, which this program's transfer client uploads, downloads and compares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.transfer import result_text, wire
from wbf_mission.addons.check.peer import (
    ACK,
    ANSWERS,
    MISSION,
    RE_REQUEST_S,
    FailedError,
    Peer,
    Sender,
    SkippedError,
    needed,
    require_accepted,
    told,
)
from wbf_mission.addons.check.registry import Checks

check = Checks()

_FENCE_BIT = m.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
_RALLY_BIT = m.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
_HOME_DEG = 1e-5


def _round_trip(number: int) -> Callable[[Peer], str]:
    def check_it(peer: Peer) -> str:
        """Upload a mission of `number` items, download it and compare."""
        began_s = peer.now()
        peer.upload(peer.items(number))
        return f"up and down in {peer.now() - began_s:.2f} s"

    return check_it


check("mission.one-item", "a mission of 1 item is uploaded and downloaded unchanged")(_round_trip(1))
check("mission.ten-items", "10 items (take-off, waypoints, return) are uploaded and downloaded unchanged")(
    _round_trip(10)
)
check("mission.hundred-items", "100 items are uploaded and downloaded unchanged")(_round_trip(100))
check(
    "mission.five-hundred-items",
    "a mission of 500 items fits",
    required=False,
    suffers="surveys; MAVSDK makes 500 items from 100 waypoints with camera and gimbal",
)(_round_trip(500))


@check("mission.camera-items")
def camera_items(peer: Peer) -> None:
    """Speed change, hold time and camera trigger distance are downloaded as uploaded."""
    first, *rest, last = peer.items(6)
    survey = (
        MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 3.0, -1.0),
        MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 2.0, 0.0, 1.0),
        MissionItem.waypoint(peer.home.latitude_deg, peer.home.longitude_deg, 12.0, hold_s=3.0),
        MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 0.0),
    )
    peer.upload((first, *survey, *rest, last))


@check("mission.loiter")
def loiter(peer: Peer) -> None:
    """The hold time of LOITER_TIME is kept; its other parameters may change between 0 and 1."""
    first, *rest, last = peer.items(4)
    home = peer.home
    wait = MissionItem(Command.NAV_LOITER_TIME, 3, 5.0, x=home.latitude_deg, y=home.longitude_deg, z=11.0)
    peer.upload((first, *rest, wait, last))


@check("mission.replaced")
def replaced(peer: Peer) -> None:
    """A shorter mission replaces a longer one."""
    peer.upload(peer.items(12))
    peer.upload(peer.items(4))
    left = len(peer.download())
    if left != 4:
        raise FailedError(f"{left} items are there instead of 4")


@check("mission.clear")
def clear(peer: Peer) -> None:
    """MISSION_CLEAR_ALL empties the mission."""
    peer.upload(peer.items(5))
    peer.driver.clear([MissionType.MISSION])
    left = len(peer.download())
    if left:
        raise FailedError(f"{left} items are left")


@check("mission.clear-empty")
def clear_empty(peer: Peer) -> None:
    """An empty mission can be cleared again, and its download has no items."""
    peer.driver.clear([MissionType.MISSION])
    peer.driver.clear([MissionType.MISSION])
    if peer.download():
        raise FailedError("it is not empty")


@check(
    "mission.home",
    required=lambda profile: profile.home_at_zero,
    suffers="MAVProxy, Mission Planner and QGroundControl, which show item 0 as home",
)
def home(peer: Peer) -> str:
    """Item 0 is the vehicle's home, not the uploaded item, if the autopilot keeps home in the mission."""
    if not peer.profile.home_at_zero:
        raise SkippedError("its autopilot does not keep home in the mission")
    place = peer.request(m.MAVLink_home_position_message)
    if place is None:
        raise SkippedError("its home is not known")
    elsewhere = GeoPoint(peer.home.latitude_deg + 0.01, peer.home.longitude_deg, peer.home.altitude_m)
    peer.upload(peer.items(3), home=elsewhere)
    found = needed(peer.driver.download(types=[MissionType.MISSION])[0].home, "item 0 has no position")
    here = place.latitude / 1e7, place.longitude / 1e7
    away = abs(found.latitude_deg - here[0]), abs(found.longitude_deg - here[1])
    if max(away) > _HOME_DEG:
        seen = f"{found.latitude_deg:.7f}, {found.longitude_deg:.7f}"
        raise FailedError(f"item 0 is at {seen}, home at {here[0]:.7f}, {here[1]:.7f}")
    return f"{found.latitude_deg:.6f}, {found.longitude_deg:.6f}, {found.altitude_m:.1f} m"


@check("mission.clear-all")
def clear_all(peer: Peer) -> str:
    """MISSION_CLEAR_ALL for all plan types is answered, and clears them if accepted."""
    peer.upload(peer.items(4))
    answer = needed(peer.opened(wire.clear_all(peer.address, wire.ALL_TYPES), ACK), "no MISSION_ACK")
    accepted = answer.type == wire.ACCEPTED
    expected = 0 if accepted else 4
    left = peer.left(expected)
    if left != expected:
        raise FailedError(f"{told(answer)}, and {left} items are left")
    if accepted:
        return "cleared"
    if peer.profile.clear_all_types:
        raise FailedError(told(answer))
    return f"refused, so each type of plan must be cleared separately: {result_text(answer.type)}"


@check("mission.part")
def part(peer: Peer) -> str:
    """MISSION_WRITE_PARTIAL_LIST changes only the items that it names, or is refused."""
    items = peer.items(5)
    peer.upload(items)
    changed = (items[0], replace(items[1], z=items[1].z + 7.0), *items[2:])
    sender = Sender(peer, changed)
    number = len(sender.items) - len(items) + 1
    peer.forget()
    peer.send(m.MAVLink_mission_write_partial_list_message(*peer.address, number, number, MISSION))
    answer = peer.expect(ANSWERS)
    if answer is not None and wire.is_request(answer):
        if answer.seq != number:
            sender.cancel()
            raise FailedError(f"{told(answer)} instead of {number}")
        peer.forget()
        sender.send(number)
        end = needed(peer.expect(ACK, RE_REQUEST_S), "the item is not acknowledged")
        require_accepted(end)
        peer.require_equal(changed)
        return "changed"
    note = "no answer" if answer is None else told(answer)
    if peer.profile.partial_write:
        raise FailedError(note)
    peer.require_equal(items)
    return f"refused ({note}): MAVProxy cannot move a single waypoint"


@check("mission.total", required=False, suffers="displays of mission progress")
def total(peer: Peer) -> str:
    """MISSION_CURRENT reports the total number of items, without home."""
    peer.upload(peer.items(7))
    end_s = peer.now() + 4.0
    while True:
        message = needed(peer.request(m.MAVLink_mission_current_message), "no MISSION_CURRENT")
        if message.total == 7 or peer.now() >= end_s:
            break
        peer.sleep(0.5)
    if message.total != 7:
        raise FailedError(f"total is {message.total} with 7 items")
    return f"total {message.total}, state {message.mission_state}"


@check("mission.set-current")
def set_current(peer: Peer) -> str:
    """MISSION_SET_CURRENT or DO_SET_MISSION_CURRENT changes the current item."""
    peer.upload(peer.items(7))
    for _ in range(2):
        peer.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 3.0, tries=1)
        if _becomes(peer, 3):
            return "by DO_SET_MISSION_CURRENT"
        peer.send(m.MAVLink_mission_set_current_message(*peer.address, 3))
        if _becomes(peer, 3):
            return "by MISSION_SET_CURRENT"
    raise FailedError("MISSION_CURRENT does not become 3")


@check("mission.set-current-beyond")
def set_current_beyond(peer: Peer) -> None:
    """An item number beyond the mission does not become the current item."""
    peer.upload(peer.items(5))
    answer = peer.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 999.0, tries=1)
    peer.send(m.MAVLink_mission_set_current_message(*peer.address, 999))
    if _becomes(peer, 999):
        raise FailedError("MISSION_CURRENT becomes 999")
    if answer is not None and answer.result == m.MAV_RESULT_ACCEPTED:
        raise FailedError("DO_SET_MISSION_CURRENT is accepted")


def _becomes(peer: Peer, number: int) -> bool:
    """Return whether MISSION_CURRENT reports the item; request the message if it is not streamed."""
    current = m.MAVLink_mission_current_message
    if peer.expect(current, 2.5, lambda a: a.seq == number) is not None:
        return True
    message = peer.request(current)
    return message is not None and message.seq == number


def _needs(peer: Peer, bit: int, what: str) -> None:
    message = peer.request(m.MAVLink_autopilot_version_message)
    if message is not None and not message.capabilities & bit:
        raise SkippedError(f"its capabilities do not include {what}")


def _corner(peer: Peer, north: float, east: float) -> tuple[float, float]:
    return peer.home.latitude_deg + north * 1e-3, peer.home.longitude_deg + east * 1e-3


@check("mission.fence")
def fence(peer: Peer) -> None:
    """A fence (polygon and circle) is uploaded and downloaded unchanged."""
    _needs(peer, _FENCE_BIT, "fence")
    corners = [_corner(peer, north, east) for north, east in ((-2, -2), (-2, 2), (2, 2), (2, -2))]
    items = [MissionItem(Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, 0, 4.0, x=x, y=y) for x, y in corners]
    x, y = _corner(peer, 1.0, 1.0)
    items.append(MissionItem(Command.NAV_FENCE_CIRCLE_EXCLUSION, 0, 15.0, x=x, y=y))
    peer.upload(items, MissionType.FENCE)
    peer.driver.clear([MissionType.FENCE])


@check("mission.rally")
def rally(peer: Peer) -> None:
    """Rally points are uploaded and downloaded unchanged."""
    _needs(peer, _RALLY_BIT, "rally points")
    corners = [_corner(peer, 0.3, 0.3), _corner(peer, -0.3, 0.2)]
    items = [
        MissionItem(Command.NAV_RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=20.0) for x, y in corners
    ]
    peer.upload(items, MissionType.RALLY)
    peer.driver.clear([MissionType.RALLY])


@check("mission.types-apart")
def types_apart(peer: Peer) -> None:
    """Clearing the fence leaves the mission unchanged."""
    peer.upload(peer.items(5))
    _needs(peer, _FENCE_BIT, "fence")
    peer.driver.clear([MissionType.FENCE])
    left = len(peer.download())
    if left != 5:
        raise FailedError(f"the mission has {left} items instead of 5")
