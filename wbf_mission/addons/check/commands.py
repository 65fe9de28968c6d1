"""Checks of the command protocol. No check arms the vehicle."""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m
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
