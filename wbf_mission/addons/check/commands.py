"""Checks of the command protocol, and checks that arm and fly the vehicle (only with ``fly=True``)."""

from __future__ import annotations

import math
from collections.abc import Callable

from mission.ground.modes import VehicleModes
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import Command, MissionItem
from mission.transfer.wire import command_long
from wbf_mission.addons.check.peer import Ack, FailedError, Peer, needed, result_name
from wbf_mission.addons.check.registry import Checks

check = Checks()

_UNKNOWN = 31999  # No MAV_CMD has this number.
_REFUSED = frozenset({m.MAV_RESULT_UNSUPPORTED, m.MAV_RESULT_DENIED, m.MAV_RESULT_FAILED})


@check("command.unknown-long")
def unknown_long(peer: Peer) -> None:
    """An unknown COMMAND_LONG is answered UNSUPPORTED."""
    _require_unsupported(peer.command(_UNKNOWN))


@check("command.unknown-int")
def unknown_int(peer: Peer) -> None:
    """An unknown COMMAND_INT is answered UNSUPPORTED."""
    question = m.MAVLink_command_int_message(*peer.address, 0, _UNKNOWN, 0, 0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    _require_unsupported(peer.acknowledged(question))


def _require_unsupported(ack: Ack | None) -> None:
    answer = needed(ack, "no COMMAND_ACK")
    if answer.result != m.MAV_RESULT_UNSUPPORTED:
        raise FailedError(f"it is answered {result_name(answer.result)}")


@check("command.ack-address")
def ack_address(peer: Peer) -> str | None:
    """COMMAND_ACK is addressed to the sender or, as in MAVLink 1, is a broadcast."""
    answer = needed(peer.command(_UNKNOWN), "no COMMAND_ACK")
    target = (answer.target_system, answer.target_component)
    if target == (0, 0):
        return "a broadcast: each of several ground stations takes it for an answer to itself"
    if target != (peer.endpoint.system_id, peer.endpoint.component_id):
        raise FailedError(f"it is addressed to {target}")
    return None


@check("command.request-message")
def request_message(peer: Peer) -> None:
    """REQUEST_MESSAGE is acknowledged."""
    peer.must(m.MAV_CMD_REQUEST_MESSAGE, float(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION))


@check("command.request-unknown")
def request_unknown(peer: Peer) -> None:
    """REQUEST_MESSAGE for a message id that does not exist is refused."""
    answer = needed(peer.command(m.MAV_CMD_REQUEST_MESSAGE, 65500.0), "no COMMAND_ACK")
    if answer.result not in _REFUSED:
        raise FailedError(f"it is answered {result_name(answer.result)}")


@check("command.repeated")
def repeated(peer: Peer) -> None:
    """A repeated command (confirmation 1) is acknowledged again."""
    values = (float(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION), *[0.0] * 6)
    command = m.MAV_CMD_REQUEST_MESSAGE
    for confirmation in (0, 1):
        question = m.MAVLink_command_long_message(*peer.address, command, confirmation, *values)
        needed(peer.acknowledged(question), f"no COMMAND_ACK with confirmation {confirmation}")


@check("command.foreign-system")
def foreign_system(peer: Peer) -> None:
    """A command for another system is not answered."""
    other = 237 if peer.vehicle.system_id != 237 else 236
    peer.forget()
    peer.send(command_long((other, peer.address[1]), _UNKNOWN))
    if peer.expect(Ack, 1.0, lambda a: a.command == _UNKNOWN) is not None:
        raise FailedError(f"it answers a command for system {other}")


@check(
    "command.broadcast", required=False, suffers="scripts that send commands before they know the system id"
)
def broadcast(peer: Peer) -> None:
    """A command for system 0, component 0 is answered."""
    needed(peer.acknowledged(m.MAVLink_command_long_message(0, 0, _UNKNOWN, 0, *[0.0] * 7)), "no COMMAND_ACK")


@check("command.bad-arming")
def bad_arming(peer: Peer) -> str:
    """COMPONENT_ARM_DISARM with a parameter other than 0 and 1 does not arm the vehicle."""
    answer = peer.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 0.3)
    peer.sleep(1.2)
    if peer.armed:
        peer.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
        raise FailedError("it armed")
    if answer is None:
        raise FailedError("no COMMAND_ACK")
    return f"answered {result_name(answer.result)}"


_READY_S = 90.0
_FLIGHT_S = 240.0
_ALTITUDE_M = 8.0


def _ready_mode(peer: Peer) -> None:
    """Set a mode that allows arming and commands: GUIDED on ArduCopter, hold on PX4."""
    modes = VehicleModes(peer.vehicle.autopilot, peer.vehicle.vehicle_type)
    if modes.arming is not None:
        peer.must(m.MAV_CMD_DO_SET_MODE, *modes.numbers(modes.arming))


def _arm(peer: Peer) -> None:
    """Send the arm command until the vehicle is armed; FailedError after `_READY_S`."""
    end_s = peer.now() + _READY_S
    while not peer.armed:
        answer = peer.command(m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        peer.sleep(1.5)
        if not peer.armed and peer.now() > end_s:
            result = "no answer" if answer is None else f"result {answer.result}"
            raise FailedError(f"it does not arm in {_READY_S:g} s: {result}{peer.said()}")


def _wait(peer: Peer, what: str, seconds: float, done: Callable[[Message], bool]) -> None:
    """Wait until ``done(message)`` holds; after `seconds` raise FailedError with the text `what`."""
    for _, message in peer.heard(seconds):
        if done(message):
            return
    raise FailedError(f"{what} in {seconds:g} s{peer.said()}")


def _is_up(message: Message) -> bool:
    return is_a(message, m.MAVLink_global_position_int_message) and message.relative_alt > 700 * _ALTITUDE_M


def _is_disarmed(message: Message) -> bool:
    return is_a(message, m.MAVLink_heartbeat_message) and not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED


@check("fly.takeoff-land", flies=True)
def takeoff_land(peer: Peer) -> str:
    """The vehicle arms, takes off, lands and disarms by command."""
    began_s = peer.now()
    peer.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, float(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT), 500_000.0)
    _ready_mode(peer)
    default = math.nan if peer.profile.nan_parameters is None else 0.0
    base_m = peer.home.altitude_m if peer.profile.takeoff_above_sea else 0.0
    takeoff = (*[default] * 6, base_m + _ALTITUDE_M)
    if not peer.profile.takeoff_needs_arming:
        peer.command(m.MAV_CMD_NAV_TAKEOFF, *takeoff)
    _arm(peer)
    peer.must(m.MAV_CMD_NAV_TAKEOFF, *takeoff)
    _wait(peer, "it does not climb", _FLIGHT_S, _is_up)
    peer.must(m.MAV_CMD_NAV_LAND)
    _wait(peer, "it does not land and disarm", _FLIGHT_S, _is_disarmed)
    return f"{peer.now() - began_s:.0f} s"


@check("fly.mission", flies=True)
def mission(peer: Peer) -> str:
    """The vehicle flies a mission, reports each waypoint that it reaches, returns and disarms."""
    home = peer.home
    items = (
        MissionItem(Command.NAV_TAKEOFF, 3, x=home.latitude_deg, y=home.longitude_deg, z=_ALTITUDE_M),
        *(
            MissionItem.waypoint(home.latitude_deg + north, home.longitude_deg + east, _ALTITUDE_M)
            for north, east in ((1e-4, 0.0), (1e-4, 1e-4), (0.0, 1e-4))
        ),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH),
    )
    peer.upload(items)
    first = int(peer.profile.home_at_zero)
    _ready_mode(peer)
    _arm(peer)
    peer.must(m.MAV_CMD_MISSION_START)
    reached: set[int] = set()
    began_s = peer.now()

    def done(message: Message) -> bool:
        if is_a(message, m.MAVLink_mission_item_reached_message):
            reached.add(message.seq - first)
        return peer.now() > began_s + 5.0 and _is_disarmed(message)

    _wait(peer, "it does not return and disarm", _FLIGHT_S, done)
    missing = [seq for seq in (1, 2) if seq not in reached]
    if missing:
        raise FailedError(f"no MISSION_ITEM_REACHED for item {missing[0]}, only for {sorted(reached)}")
    return f"{peer.now() - began_s:.0f} s, reached {sorted(reached)}"
