"""Checks of the parameter protocol."""

from __future__ import annotations

import struct
from typing import TypeAlias

from mission.link.codec.dialect import mavlink as m
from wbf_mission.addons.check.peer import FailedError, Peer, SkippedError, needed
from wbf_mission.addons.check.registry import Checks

check = Checks()

_Value: TypeAlias = m.MAVLink_param_value_message
_NOBODYS = "NO_SUCH_THING_X"
_QUIET_S = 1.5
_LONGEST_S = 120.0
_ROUNDS = 5
# Parameters that are safe to change on the ground, for PX4, ArduCopter 4.7 and older ArduCopter versions.
_HARMLESS = (
    "MIS_TAKEOFF_ALT",
    "RTL_RETURN_ALT",
    "MPC_XY_CRUISE",
    "PILOT_TKO_ALT_M",
    "RTL_ALT_M",
    "WP_SPD",
    "PILOT_TKOFF_ALT",
    "RTL_ALT",
    "WPNAV_SPEED",
)


def _name(message: _Value) -> str:
    return str(message.param_id).rstrip("\0")


def _bits(value: float) -> bytes:
    return struct.pack("<f", value)


def _read(peer: Peer, name: str, tries: int = 3) -> _Value | None:
    question = m.MAVLink_param_request_read_message(*peer.address, name.encode(), -1)
    return peer.ask(question, _Value, where=lambda answer: _name(answer) == name, tries=tries)


def _listed(peer: Peer) -> dict[int, _Value]:
    """Return all parameters by index; lost parameters are requested again."""
    found: dict[int, _Value] = {}
    peer.forget()
    peer.send(m.MAVLink_param_request_list_message(*peer.address))
    began_s = peer.now()
    while peer.now() - began_s < _LONGEST_S:
        message = peer.expect(_Value, _QUIET_S)
        if message is None:
            break
        if message.param_index < message.param_count:
            found[message.param_index] = message
            if len(found) == message.param_count:
                break
    count = next(iter(found.values())).param_count if found else 0
    for _ in range(_ROUNDS):
        for index in [index for index in range(count) if index not in found][:200]:
            question = m.MAVLink_param_request_read_message(*peer.address, b"", index)
            answer = peer.ask(question, _Value, where=lambda a, index=index: a.param_index == index, tries=1)  # type: ignore[misc]
            if answer is not None:
                found[index] = answer
    return found


def _some(peer: Peer) -> _Value:
    """Return a parameter that is safe to change on the ground."""
    for name in _HARMLESS:
        message = _read(peer, name)
        if message is not None:
            return message
    raise SkippedError(f"it has none of {', '.join(_HARMLESS)}")


@check("param.list")
def param_list(peer: Peer) -> str:
    """PARAM_REQUEST_LIST is answered with every index once, always with the same count."""
    found = _listed(peer)
    if not found:
        raise FailedError("no PARAM_VALUE")
    counts = {message.param_count for message in found.values()}
    if len(counts) > 1:
        raise FailedError(f"the counts differ: {sorted(counts)}")
    count = counts.pop()
    missing = [index for index in range(count) if index not in found]
    if missing:
        raise FailedError(f"{len(missing)} of {count} never come, the first is {missing[0]}")
    names = {_name(message) for message in found.values()}
    if len(names) < count:
        raise FailedError(f"{count - len(names)} names come twice")
    return f"{count} parameters"


@check("param.read-index")
def read_index(peer: Peer) -> str:
    """PARAM_REQUEST_READ by index is answered."""
    question = m.MAVLink_param_request_read_message(*peer.address, b"", 0)
    answer = needed(peer.ask(question, _Value, where=lambda a: a.param_index == 0), "no PARAM_VALUE")
    return _name(answer)


@check("param.read-name")
def read_name(peer: Peer) -> str:
    """PARAM_REQUEST_READ by name returns the same value as PARAM_REQUEST_READ by index."""
    question = m.MAVLink_param_request_read_message(*peer.address, b"", 0)
    first = needed(
        peer.ask(question, _Value, where=lambda a: a.param_index == 0),
        "the first parameter cannot be read by index",
    )
    name = _name(first)
    answer = needed(_read(peer, name), f"no PARAM_VALUE for {name}")
    if answer.param_type != first.param_type or _bits(answer.param_value) != _bits(first.param_value):
        raise FailedError(f"{name} is {answer.param_value}, by index {first.param_value}")
    return name


@check(
    "param.read-unknown",
    required=False,
    suffers="clients that identify an autopilot or version by a parameter's name",
)
def read_unknown(peer: Peer) -> None:
    """A read request for a parameter that does not exist returns no value."""
    if _read(peer, _NOBODYS, tries=1) is not None:
        raise FailedError("it has a value")


@check("param.set")
def param_set(peer: Peer) -> str:
    """PARAM_SET changes a value, is answered with the new value, and the new value is read back."""
    before = _some(peer)
    name = _name(before)
    if before.param_type != m.MAV_PARAM_TYPE_REAL32:
        changed = before.param_value
    else:
        changed = struct.unpack("<f", _bits(before.param_value * 1.05 + 0.1))[0]
    try:
        answer = needed(_set(peer, name, changed, before.param_type), f"no PARAM_VALUE for {name}")
        if _bits(answer.param_value) != _bits(changed):
            raise FailedError(f"{name} set to {changed} is answered as {answer.param_value}")
        read = _read(peer, name)
        if read is None or _bits(read.param_value) != _bits(changed):
            raise FailedError(f"{name} set to {changed} is not read back")
    finally:
        _set(peer, name, before.param_value, before.param_type)
    return name


def _set(peer: Peer, name: str, value: float, kind: int, tries: int = 3) -> _Value | None:
    question = m.MAVLink_param_set_message(*peer.address, name.encode(), value, kind)
    return peer.ask(question, _Value, where=lambda answer: _name(answer) == name, tries=tries)


@check("param.set-unknown", required=False, suffers="users with parameter files of other firmware")
def set_unknown(peer: Peer) -> None:
    """PARAM_SET of an unknown name adds no parameter."""
    _set(peer, _NOBODYS, 1.0, m.MAV_PARAM_TYPE_REAL32, tries=1)
    if _read(peer, _NOBODYS, tries=1) is not None:
        raise FailedError("now it has a value")
