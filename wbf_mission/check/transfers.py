"""Checks of whole plans: up, down and compared, by our own transfer client."""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, MissionItem, MissionType
from wbf_mission.check.errors import FailedError, SkippedError
from wbf_mission.check.peer import Peer
from wbf_mission.check.registry import Checks

check = Checks()

_FENCE_BIT = m.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
_RALLY_BIT = m.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY


def _round_trip(peer: Peer, number: int) -> str:
    began_s = peer.now()
    peer.upload(peer.items(number))
    return f"up and down in {peer.now() - began_s:.2f} s"


@check("mission.one-item", "a mission of 1 item goes up, comes down and is equal")
def one_item(peer: Peer) -> str:
    """The smallest."""
    return _round_trip(peer, 1)


@check(
    "mission.ten-items",
    "a mission of 10 items (take-off, waypoints, return) goes up and comes down equal",
)
def ten_items(peer: Peer) -> str:
    """A usual one."""
    return _round_trip(peer, 10)


@check("mission.hundred-items", "a mission of 100 items goes up, comes down and is equal")
def hundred_items(peer: Peer) -> str:
    """A long one."""
    return _round_trip(peer, 100)


@check("mission.five-hundred-items", "a mission of 500 items fits", required=False)
def five_hundred_items(peer: Peer) -> str:
    """What most boards hold."""
    return _round_trip(peer, 500)


@check("mission.camera-items", "speed change, hold time and camera trigger distance are kept")
def camera_items(peer: Peer) -> None:
    """The commands of a survey."""
    first, *rest, last = peer.items(6)
    survey = (
        MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 3.0, -1.0),
        MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 2.0, 0.0, 1.0),
        MissionItem.waypoint(peer.home.latitude_deg, peer.home.longitude_deg, 12.0, hold_s=3.0),
        MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 0.0),
    )
    peer.upload((first, *survey, *rest, last))


@check("mission.replaced", "a shorter mission replaces a longer one")
def replaced(peer: Peer) -> None:
    """Nothing of the old one is left."""
    peer.upload(peer.items(12))
    peer.upload(peer.items(4))
    left = len(peer.download())
    if left != 4:
        raise FailedError(f"{left} items are there instead of 4")


@check("mission.clear", "MISSION_CLEAR_ALL empties the mission")
def clear(peer: Peer) -> None:
    """Read it afterwards."""
    peer.upload(peer.items(5))
    peer.driver.clear([MissionType.MISSION])
    left = len(peer.download())
    if left:
        raise FailedError(f"{left} items are left")


@check("mission.clear-empty", "an empty mission is cleared and read without error")
def clear_empty(peer: Peer) -> None:
    """Twice nothing is nothing."""
    peer.driver.clear([MissionType.MISSION])
    peer.driver.clear([MissionType.MISSION])
    if peer.download():
        raise FailedError("it is not empty")


@check("mission.total", "MISSION_CURRENT tells how many items there are", required=False)
def total(peer: Peer) -> str:
    """Compare with what was sent."""
    peer.upload(peer.items(7))
    peer.sleep(1.0)
    message = peer.request(m.MAVLink_mission_current_message)
    if message is None:
        raise FailedError("no MISSION_CURRENT")
    if message.total not in (6, 7, 8):
        raise FailedError(f"total is {message.total} with 7 items")
    return f"total {message.total}, state {message.mission_state}"


@check("mission.set-current", "MISSION_SET_CURRENT or DO_SET_MISSION_CURRENT changes the current item")
def set_current(peer: Peer) -> None:
    """Choose item 3, in both ways."""
    peer.upload(peer.items(7))
    current = m.MAVLink_mission_current_message
    for _ in range(2):
        peer.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 3.0, tries=1)
        if peer.expect(current, 2.5, lambda a: a.seq == 3) is not None:
            return
        peer.send(m.MAVLink_mission_set_current_message(*peer.address, 3))
        if peer.expect(current, 2.5, lambda a: a.seq == 3) is not None:
            return
    raise FailedError("MISSION_CURRENT does not become 3")


@check("mission.set-current-beyond", "an item beyond the mission does not become the current one")
def set_current_beyond(peer: Peer) -> None:
    """Ask for item 999."""
    peer.upload(peer.items(5))
    peer.command(m.MAV_CMD_DO_SET_MISSION_CURRENT, 999.0, tries=1)
    peer.send(m.MAVLink_mission_set_current_message(*peer.address, 999))
    if peer.expect(m.MAVLink_mission_current_message, 2.5, lambda a: a.seq == 999) is not None:
        raise FailedError("MISSION_CURRENT becomes 999")


def _needs(peer: Peer, bit: int, what: str) -> None:
    message = peer.request(m.MAVLink_autopilot_version_message)
    if message is not None and not message.capabilities & bit:
        raise SkippedError(f"its capabilities say that it has no {what}")


def _corner(peer: Peer, north: float, east: float) -> tuple[float, float]:
    return peer.home.latitude_deg + north * 1e-3, peer.home.longitude_deg + east * 1e-3


@check("mission.fence", "a fence (polygon and circle) goes up, comes down and is equal")
def fence(peer: Peer) -> None:
    """A square around home and a hole."""
    _needs(peer, _FENCE_BIT, "fence")
    corners = [_corner(peer, north, east) for north, east in ((-2, -2), (-2, 2), (2, 2), (2, -2))]
    items = [MissionItem(Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, 0, 4.0, x=x, y=y) for x, y in corners]
    x, y = _corner(peer, 1.0, 1.0)
    items.append(MissionItem(Command.NAV_FENCE_CIRCLE_EXCLUSION, 0, 15.0, x=x, y=y))
    peer.upload(items, MissionType.FENCE)
    peer.driver.clear([MissionType.FENCE])


@check("mission.rally", "rally points go up, come down and are equal")
def rally(peer: Peer) -> None:
    """Two of them."""
    _needs(peer, _RALLY_BIT, "rally points")
    corners = [_corner(peer, 0.3, 0.3), _corner(peer, -0.3, 0.2)]
    items = [
        MissionItem(Command.NAV_RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=20.0) for x, y in corners
    ]
    peer.upload(items, MissionType.RALLY)
    peer.driver.clear([MissionType.RALLY])


@check("mission.types-apart", "clearing the fence leaves the mission alone")
def types_apart(peer: Peer) -> None:
    """Send a mission, clear the fence, read the mission."""
    peer.upload(peer.items(5))
    _needs(peer, _FENCE_BIT, "fence")
    peer.driver.clear([MissionType.FENCE])
    left = len(peer.download())
    if left != 5:
        raise FailedError(f"the mission has {left} items instead of 5")
