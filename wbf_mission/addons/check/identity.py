"""Checks of the vehicle's identity and of its telemetry streams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer.wire import command_long
from wbf_mission.addons.check.peer import FailedError, Peer, SkippedError, needed
from wbf_mission.addons.check.registry import Checks

check = Checks()

_WATCH_S = 4.2
_GROUND_TYPES = frozenset({m.MAV_TYPE_GCS, m.MAV_TYPE_CAMERA, m.MAV_TYPE_GIMBAL, m.MAV_TYPE_ADSB})


@check("identity.heartbeat")
def heartbeat(peer: Peer) -> str:
    """HEARTBEAT comes at least every 1.5 s, as ground stations time out after 3 s."""
    times = [now_s for now_s, _ in peer.collect(m.MAVLink_heartbeat_message, _WATCH_S)]
    if len(times) < 2:
        raise FailedError(f"{len(times)} heartbeats in {_WATCH_S} s")
    gap_s = max(after - before for before, after in pairwise(times))
    if gap_s > 1.5:
        raise FailedError(f"{gap_s:.1f} s between two heartbeats")
    return f"longest gap {gap_s:.2f} s"


@check("identity.heartbeat-fields")
def heartbeat_fields(peer: Peer) -> str:
    """HEARTBEAT has a vehicle type, an autopilot, the custom mode bit and a state."""
    message = needed(peer.expect(m.MAVLink_heartbeat_message, 3.0), "no heartbeat")
    if message.type in _GROUND_TYPES or message.type == m.MAV_TYPE_GENERIC:
        raise FailedError(f"type {message.type} is not a vehicle")
    if message.autopilot == m.MAV_AUTOPILOT_INVALID:
        raise FailedError("autopilot is INVALID")
    if not message.base_mode & m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        raise FailedError("base_mode lacks the custom mode bit: clients cannot read the flight mode")
    if message.system_status not in range(1, 9):
        raise FailedError(f"system_status {message.system_status} has no meaning")
    return f"type {message.type}, autopilot {message.autopilot}, custom mode {message.custom_mode:#x}"


@check(
    "identity.component",
    required=False,
    suffers="MAVSDK and QGroundControl, which look for the autopilot there",
)
def component(peer: Peer) -> None:
    """The autopilot is component 1."""
    if peer.vehicle.component_id != m.MAV_COMP_ID_AUTOPILOT1:
        raise FailedError(f"it is component {peer.vehicle.component_id}")


@check("identity.mavlink2")
def mavlink2(peer: Peer) -> None:
    """The vehicle answers in MAVLink 2 when the ground station sends MAVLink 2."""
    message = needed(peer.expect(m.MAVLink_heartbeat_message, 3.0), "no heartbeat")
    if message.get_msgbuf()[0] != 0xFD:
        raise FailedError("its frames are MAVLink 1")


@check("identity.version")
def version(peer: Peer) -> str:
    """AUTOPILOT_VERSION is sent on REQUEST_MESSAGE."""
    message = needed(peer.request(m.MAVLink_autopilot_version_message), "it does not come")
    number = message.flight_sw_version
    return f"firmware {number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"


@check("identity.version-old", required=False, suffers="older clients, and every second attempt of MAVSDK")
def version_old(peer: Peer) -> None:
    """AUTOPILOT_VERSION is sent on REQUEST_AUTOPILOT_CAPABILITIES."""
    peer.forget()
    question = command_long(peer.address, m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1.0)
    if peer.ask(question, m.MAVLink_autopilot_version_message) is None:
        raise FailedError("it does not come")


@check("identity.capabilities")
def capabilities(peer: Peer) -> str:
    """Capabilities include MISSION_INT, MAVLINK2 and exactly one encoding of parameters.

    If PARAM_FLOAT is the only encoding bit that is set, as on ArduPilot, parameters are cast to float.
    """
    message = needed(peer.request(m.MAVLink_autopilot_version_message), "no AUTOPILOT_VERSION")
    bits = message.capabilities
    for name in ("MISSION_INT", "MAVLINK2"):
        if not bits & getattr(m, f"MAV_PROTOCOL_CAPABILITY_{name}"):
            raise FailedError(f"the bit {name} is missing: clients refuse to transfer missions")
    bytewise = bool(bits & m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)
    cast = bool(bits & m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST)
    if bytewise and cast:
        raise FailedError("parameters are encoded both bytewise and cast")
    if not bytewise and not cast and not bits & m.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT:
        raise FailedError("no parameter encoding")
    return f"{bits} ({bits:#x}), parameters {'bytewise' if bytewise else 'cast'}"


@check(
    "identity.protocol-version",
    required=False,
    suffers="clients that start with MAVLink 1 and then switch to MAVLink 2",
)
def protocol_version(peer: Peer) -> str:
    """PROTOCOL_VERSION is sent on REQUEST_MESSAGE."""
    message = needed(peer.request(m.MAVLink_protocol_version_message), "it does not come")
    return f"{message.min_version} to {message.max_version}"


@dataclass(frozen=True, slots=True)
class _Stream:
    """Check of one telemetry stream. ``problem(message)`` returns the fault of a message, or None."""

    kind: type[Message]
    interval_us: float = 500_000.0
    problem: Callable[[Any], str | None] | None = None

    def __call__(self, peer: Peer) -> str:
        """Wait for the message; without it, request its stream, because some autopilots wait for this."""
        found, asked = peer.collect(self.kind, 2.5), ""
        if not found:
            peer.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, float(self.kind.id), self.interval_us)
            found, asked = peer.collect(self.kind, 3.0), ", after SET_MESSAGE_INTERVAL"
        if not found:
            raise FailedError(f"no {self.kind.msgname} in 3 s, not even after SET_MESSAGE_INTERVAL")
        if self.problem is not None:
            message = peer.expect(self.kind, 3.0)
            problem = None if message is None else self.problem(message)
            if problem is not None:
                raise FailedError(problem)
        return f"{len(found)} in 3 s{asked}"


def _position_problem(message: m.MAVLink_global_position_int_message) -> str | None:
    if abs(message.lat) > 900_000_000 or abs(message.lon) > 1_800_000_000:
        return f"latitude {message.lat}, longitude {message.lon} are not a position"
    return None


def _sensors_problem(message: m.MAVLink_sys_status_message) -> str | None:
    return None if message.onboard_control_sensors_present else "no sensor is present"


def _landed_problem(message: m.MAVLink_extended_sys_state_message) -> str | None:
    if message.landed_state != m.MAV_LANDED_STATE_ON_GROUND:
        return f"landed_state is {message.landed_state}, but the vehicle is disarmed"
    return None


for _name, _text, _stream in (
    (
        "position",
        "GLOBAL_POSITION_INT comes, with valid latitude and longitude",
        _Stream(m.MAVLink_global_position_int_message, problem=_position_problem),
    ),
    ("attitude", "ATTITUDE comes", _Stream(m.MAVLink_attitude_message)),
    (
        "sys-status",
        "SYS_STATUS comes, with sensors and battery",
        _Stream(m.MAVLink_sys_status_message, problem=_sensors_problem),
    ),
    ("gps", "GPS_RAW_INT comes", _Stream(m.MAVLink_gps_raw_int_message)),
    (
        "landed-state",
        "EXTENDED_SYS_STATE reports a vehicle on the ground",
        _Stream(m.MAVLink_extended_sys_state_message, problem=_landed_problem),
    ),
    (
        "mission-current",
        "MISSION_CURRENT comes at about 1 Hz",
        _Stream(m.MAVLink_mission_current_message, 1e6),
    ),
):
    check(f"telemetry.{_name}", _text)(_stream)


@check("telemetry.home")
def home(peer: Peer) -> str:
    """HOME_POSITION is sent on REQUEST_MESSAGE or GET_HOME_POSITION."""
    kind = m.MAVLink_home_position_message
    message = peer.request(kind)
    if message is None:
        question = command_long(peer.address, m.MAV_CMD_GET_HOME_POSITION)
        message = peer.ask(question, kind)
    if message is None:
        fix = peer.request(m.MAVLink_gps_raw_int_message)
        if fix is not None and fix.fix_type < 3:
            raise SkippedError(f"it has no home before it has a position: GPS fix {fix.fix_type}")
        raise FailedError("it does not come")
    return f"{message.latitude / 1e7:.6f}, {message.longitude / 1e7:.6f}"


@check("telemetry.interval")
def interval(peer: Peer) -> str:
    """SET_MESSAGE_INTERVAL changes the rate of ATTITUDE to 5 Hz."""
    kind = m.MAVLink_attitude_message
    peer.must(m.MAV_CMD_SET_MESSAGE_INTERVAL, float(kind.id), 200_000.0)
    found = [message.time_boot_ms for _, message in peer.collect(kind, 3.0)]
    peer.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, float(kind.id), 0.0)
    if len(found) < 3 or found[-1] <= found[0]:
        raise FailedError(f"{len(found)} messages in 3 s")
    rate_hz = 1000.0 * (len(found) - 1) / (found[-1] - found[0])
    if not 3.0 <= rate_hz <= 7.5:
        raise FailedError(f"it comes at {rate_hz:.1f} Hz")
    return f"{rate_hz:.1f} Hz"


@check("telemetry.interval-off", required=False, suffers="ground stations on a slow radio")
def interval_off(peer: Peer) -> None:
    """SET_MESSAGE_INTERVAL with -1 stops a message."""
    kind = m.MAVLink_attitude_message
    peer.must(m.MAV_CMD_SET_MESSAGE_INTERVAL, float(kind.id), -1.0)
    peer.sleep(0.5)
    found = peer.collect(kind, 2.0)
    peer.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, float(kind.id), 0.0)
    if found:
        raise FailedError(f"{len(found)} messages in 2 s")


@check("telemetry.interval-get", required=False, suffers="scripts that read a rate before changing it")
def interval_get(peer: Peer) -> str:
    """GET_MESSAGE_INTERVAL is answered by MESSAGE_INTERVAL."""
    kind = m.MAVLink_message_interval_message
    question = command_long(peer.address, m.MAV_CMD_GET_MESSAGE_INTERVAL)
    message = needed(
        peer.ask(question, kind, where=lambda answer: answer.message_id == 0), "it does not come"
    )
    return f"heartbeat {message.interval_us} us"


@check("telemetry.timesync")
def timesync(peer: Peer) -> None:
    """TIMESYNC is answered with the time of the vehicle and the time of the sender."""
    own = 123_456_789_123
    kind = m.MAVLink_timesync_message
    answer = needed(
        peer.ask(m.MAVLink_timesync_message(0, own), kind, where=lambda a: a.ts1 == own),
        "no answer that repeats the time of the request",
    )
    if answer.tc1 == 0:
        raise FailedError("the vehicle's time is 0")


@check(
    "telemetry.ping",
    required=False,
    suffers="round-trip measurements; MAVSDK pings all autopilots except ArduPilot every 5 s",
)
def ping(peer: Peer) -> None:
    """A PING sent as a broadcast is answered to its sender."""
    answer = needed(
        peer.ask(
            m.MAVLink_ping_message(77, 4242, 0, 0), m.MAVLink_ping_message, where=lambda a: a.seq == 4242
        ),
        "no answer",
    )
    if answer.target_system != peer.endpoint.system_id:
        raise FailedError(f"it is addressed to system {answer.target_system}")


check(
    "telemetry.system-time",
    "SYSTEM_TIME comes",
    required=False,
    suffers="telemetry logs, which need the date",
)(_Stream(m.MAVLink_system_time_message, 1e6))
