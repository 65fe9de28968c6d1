"""Queries a vehicle's parameters and state over MAVLink."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from mission.autopilots import profile_for
from mission.autopilots.profile import Meaning, Questions
from mission.errors import MissionError
from mission.ground.arming_gate import ArmingGate
from mission.ground.contact import Contact, Heartbeat
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import DEGREES_E7, GeoPoint
from mission.transfer.vehicles import VehicleSearch
from mission.transfer.wire import GROUND_STATION, command_long
from sim_vehicle.autopilot import firmware_of
from sim_vehicle.autopilot.parameters import parameter_value
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import StopReason
from wbf_mission.planning.builder import flown_vehicle
from wbf_mission.scenario import VehicleOptions

_KINDS = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}


@dataclass(frozen=True, slots=True)
class FirmwareVersion:
    """Version of an autopilot's firmware; `kind` is a FIRMWARE_VERSION_TYPE, 255 for an official release.

    >>> str(FirmwareVersion.of(0x010E02FF)), str(FirmwareVersion.of(0x04070000))
    ('1.14.2', '4.7.0 dev')
    """

    major: int
    minor: int
    patch: int
    kind: int

    @classmethod
    def of(cls, number: int) -> FirmwareVersion:
        """Return the firmware version encoded in AUTOPILOT_VERSION.flight_sw_version."""
        return cls(number >> 24 & 255, number >> 16 & 255, number >> 8 & 255, number & 255)

    @property
    def is_official(self) -> bool:
        """Whether the version is an official release."""
        return self.kind == 255

    def __str__(self) -> str:
        kind = _KINDS.get(self.kind, f"type {self.kind}")
        return f"{self.major}.{self.minor}.{self.patch} {kind}".strip()


@dataclass(frozen=True, slots=True)
class Gps:
    """Satellite navigation; `fix` is GPS_FIX_TYPE."""

    fix: int
    satellites: int | None = None
    hdop: float | None = None


@dataclass(frozen=True, slots=True)
class VehicleSnapshot:
    """State and parameters that a vehicle sent; a value that it did not send is None."""

    # The heartbeat has the system id, MAV_AUTOPILOT and MAV_TYPE.
    system_id: int
    autopilot: int
    vehicle_type: int
    armed: bool = False
    # Requested parameters that the vehicle sent, by name.
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    version: FirmwareVersion | None = None
    # Bits of MAV_SYS_STATUS_SENSOR from SYS_STATUS.
    sensors_present: int | None = None
    sensors_enabled: int | None = None
    sensors_health: int | None = None
    gps: Gps | None = None
    # Bits of ESTIMATOR_STATUS_FLAGS, or of EKF_STATUS_FLAGS: the lower bits of both have the same meaning.
    estimator_flags: int | None = None
    position: GeoPoint | None = None  # Position of the vehicle
    battery: float | None = None  # Remaining fraction of the battery
    reasons: tuple[str, ...] = ()  # Reasons not to arm, in the vehicle's words

    @property
    def questions(self) -> Questions:
        """Names of the parameters on which plans depend, with units, keyed by meaning."""
        return profile_for(self.autopilot).settings.asked_of(self.vehicle_type)

    def told(self, meaning: Meaning) -> tuple[str, float] | None:
        """Return name and value (SI units) of the parameter with this meaning; None if it did not arrive."""
        return self._first(self.questions.get(meaning, {}))

    def _first(self, units: Mapping[str, float]) -> tuple[str, float] | None:
        """Return name and value (SI units) of the first parameter in `units` that was received, if any."""
        known = self.parameters
        return next(((name, known[name] * unit) for name, unit in units.items() if name in known), None)

    def as_set(self, options: VehicleOptions) -> VehicleOptions:
        """Return the options with the vehicle's parameters in place of the assumed values.

        Parameters and values outside the motion model's range are ignored.
        """
        spec = flown_vehicle(options)
        firmware = firmware_of(spec)
        table = {} if firmware is None else firmware.procedures.parameters
        found = {}
        for name, names in profile_for(self.autopilot).settings.motion_of(self.vehicle_type).items():
            told, known = self._first(names), table.get(name)
            if told is None or known is None or not known.low <= told[1] <= known.high:
                continue
            value = told[1]
            # MAVLink sends parameters as float32.
            if not math.isclose(value, parameter_value(spec, name, table), rel_tol=1e-6, abs_tol=1e-9):
                found[name] = round(value) if known.integer else float(f"{value:.7g}")
        return replace(options, parameters={**options.parameters, **found}) if found else options


_UNKNOWN = 65535
_UNKNOWN_SATELLITES = 255
_PREARM = int(m.MAV_SYS_STATUS_PREARM_CHECK)
STATE_MESSAGES = (
    int(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    int(m.MAVLINK_MSG_ID_SYS_STATUS),
    int(m.MAVLINK_MSG_ID_GPS_RAW_INT),
    int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT),
    int(m.MAVLINK_MSG_ID_BATTERY_STATUS),
)
"""Requested from every vehicle."""
_PLACE_MESSAGES = (int(m.MAVLINK_MSG_ID_GPS_RAW_INT), int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT))
ESTIMATES = (int(m.MAVLINK_MSG_ID_ESTIMATOR_STATUS), int(m.MAVLINK_MSG_ID_EKF_STATUS_REPORT))
"""Messages with the status of the vehicle's estimator: for most autopilots, and for ArduPilot."""


def _changes(message: Message) -> dict[str, Any]:
    """Return the contents of a message, keyed by the field names of `VehicleSnapshot`."""
    if isinstance(message, m.MAVLink_autopilot_version_message):
        return {"version": FirmwareVersion.of(message.flight_sw_version)}
    if isinstance(message, m.MAVLink_sys_status_message):
        return {
            "sensors_present": message.onboard_control_sensors_present,
            "sensors_enabled": message.onboard_control_sensors_enabled,
            "sensors_health": message.onboard_control_sensors_health,
        }
    if isinstance(message, m.MAVLink_gps_raw_int_message):
        seen, eph = message.satellites_visible, message.eph
        satellites = None if seen == _UNKNOWN_SATELLITES else seen
        return {"gps": Gps(message.fix_type, satellites, None if eph == _UNKNOWN else eph / 100.0)}
    if isinstance(message, m.MAVLink_estimator_status_message | m.MAVLink_ekf_status_report_message):
        return {"estimator_flags": message.flags}
    if isinstance(message, m.MAVLink_global_position_int_message):
        return {"position": _point(message)}
    return {}


def _point(message: m.MAVLink_global_position_int_message) -> GeoPoint | None:
    """Return a message's position; None if the position is unset or invalid."""
    if message.lat == 0 and message.lon == 0:
        return None
    try:
        return GeoPoint(message.lat / DEGREES_E7, message.lon / DEGREES_E7, message.alt / 1e3)
    except MissionError:
        return None


_FIRST_RETRY_S = 0.5
_TRIES = 4
_LONGEST_S = 30.0
_LONGEST_SILENCE_S = 8.0
_REASONS_S = 1.5
_PLACE_S, _PLACE_AGAIN_S = 180.0, 1.0
_INTEGERS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}


class Inquiry:
    """Component that queries one vehicle: the vehicle of `system_id`, or the first vehicle heard.

    Unanswered requests are retried, at an interval that depends on the delay of the first answer. Retries are
    limited, because a vehicle never answers a request for a parameter that it does not have.

    With `placed`, the inquiry waits up to three minutes until the vehicle knows its position. For 40 s after
    boot, ArduCopter sends positions before it knows where it is.
    """

    system_id, component_id = GROUND_STATION
    wanted: frozenset[int] | None = frozenset(
        {
            *STATE_MESSAGES,
            *ESTIMATES,
            m.MAVLINK_MSG_ID_HEARTBEAT,
            m.MAVLINK_MSG_ID_PARAM_VALUE,
            m.MAVLINK_MSG_ID_STATUSTEXT,
        }
    )

    def __init__(self, *, system_id: int | None = None, placed: bool = False) -> None:
        self.done = False
        self.waits_for_place = False  # Whether only the position is still missing
        self._placed = placed
        self.search = VehicleSearch(system_id)
        self._contact = Contact()
        self._ids: set[int] = set()
        self._told: dict[str, Any] = {}
        self._alternatives: list[Mapping[str, float]] = []  # Possible names of each parameter.
        self._parameters: dict[str, float] = {}
        self._tries: dict[str | int, int] = {}
        self._begun_s = math.inf
        self._answer_s: float | None = None
        self._due_s = math.inf
        self._settled_s: float | None = None
        self._heartbeat = Heartbeat()

    @property
    def vehicle(self) -> tuple[int, int] | None:
        """System and component id of the vehicle; None before the vehicle's first heartbeat."""
        found = self.search.found
        return None if found is None else (found.system_id, found.component_id)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take the vehicle's answers from a message."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if self.done:
            return []
        first = self.search.take(message) is not None
        if source != self.vehicle:
            return []
        self._contact.receive(message, now_s)
        if isinstance(message, m.MAVLink_heartbeat_message):
            return self._begin(now_s) if first else []
        if isinstance(message, m.MAVLink_param_value_message):
            self._on_parameter(message, now_s)
        elif not isinstance(message, m.MAVLink_statustext_message):
            self._ids.add(type(message).id)
            self._told |= _changes(message)
            if not self._alternatives:
                # Parameters measure the delay better: this message may be part of a stream, not an answer.
                self._measure_pace(now_s)
        self._settle(now_s)
        return []

    def poll(self, now_s: float) -> list[Message]:
        """Send the heartbeat, and retry unanswered requests."""
        if self.done:
            return []
        out = self._heartbeat.poll(now_s)
        if self._settled_s is None and now_s >= self._due_s:
            out += self._ask(now_s)
        self._settle(now_s)
        return out

    def next_deadline(self) -> float:
        """Time (s) of the next `poll` that sends a message or ends the inquiry; infinite after the end."""
        if self.done:
            return math.inf
        waits_s = self._due_s if self._settled_s is None else self._settled_s
        return min(self._heartbeat.due_s, waits_s)

    def snapshot(self) -> VehicleSnapshot:
        """Return the answers received until now; the vehicle must have been heard."""
        assert self.vehicle is not None
        monitor, gate = self._contact.monitor, ArmingGate(self.vehicle)
        for _, _, text in self._contact.texts.texts:
            gate.on_text(text)
        return VehicleSnapshot(
            system_id=self.vehicle[0],
            autopilot=monitor.autopilot,
            vehicle_type=monitor.vehicle_type,
            armed=monitor.state.armed,
            parameters=MappingProxyType(dict(self._parameters)),
            battery=monitor.battery.remaining,
            reasons=tuple(gate.reasons),
            **self._told,
        )

    def _begin(self, now_s: float) -> list[Message]:
        assert self.vehicle is not None
        self._begun_s = now_s
        settings, vehicle_type = self._contact.profile.settings, self._contact.monitor.vehicle_type
        self._alternatives = [
            *settings.asked_of(vehicle_type).values(),
            *settings.motion_of(vehicle_type).values(),
        ]
        asked = self._ask(now_s)
        if not self._contact.monitor.state.armed:
            asked.append(command_long(self.vehicle, m.MAV_CMD_RUN_PREARM_CHECKS))
        return asked

    @property
    def _open(self) -> list[str | int]:
        """Names of parameters and ids of messages that are still requested: unanswered, with retries left."""
        unread = [names for names in self._alternatives if self._parameters.keys().isdisjoint(names)]
        names = dict.fromkeys(name for names in unread for name in names)
        asked = (*STATE_MESSAGES, self._contact.profile.estimator_message)
        messages = [message_id for message_id in asked if message_id not in self._ids]
        every: list[str | int] = [*names, *messages]
        return [key for key in every if self._answer_s is None or self._tries.get(key, 0) <= _TRIES]

    def _ask(self, now_s: float) -> list[Message]:
        assert self.vehicle is not None
        self._due_s = now_s + self._pace_s
        out: list[Message] = []
        for key in self._open:
            tries = self._tries[key] = self._tries.get(key, 0) + (self._answer_s is not None)
            if tries > _TRIES:
                continue
            if isinstance(key, str):
                out.append(m.MAVLink_param_request_read_message(*self.vehicle, key.encode(), -1))
            else:
                out.append(command_long(self.vehicle, m.MAV_CMD_REQUEST_MESSAGE, float(key)))
        if self.waits_for_place:
            self._due_s = now_s + max(_PLACE_AGAIN_S, self._pace_s)
            # Earlier messages about the position are outdated: request them again.
            old = (*_PLACE_MESSAGES, self._contact.profile.estimator_message)
            out += [command_long(self.vehicle, m.MAV_CMD_REQUEST_MESSAGE, float(kind)) for kind in old]
        return out

    @property
    def _pace_s(self) -> float:
        """Time between two requests (s): a fixed time before the first answer, then based on its delay."""
        return 2.0 * _FIRST_RETRY_S if self._answer_s is None else max(_FIRST_RETRY_S, 1.5 * self._answer_s)

    def _on_parameter(self, message: m.MAVLink_param_value_message, now_s: float) -> None:
        name = str(message.param_id)
        if not any(name in names for names in self._alternatives):
            return
        value = decoded(message.param_value, message.param_type, bytewise=self._contact.profile.bytewise)
        if value is not None:
            self._parameters[name] = value
            self._measure_pace(now_s)

    def _measure_pace(self, now_s: float) -> None:
        """Set the retry interval from the delay of the first answer."""
        if self._answer_s is None:
            self._answer_s = now_s - self._begun_s
            self._due_s = min(self._due_s, now_s + self._pace_s)

    def _settle(self, now_s: float) -> None:
        """End if no request is open, and the vehicle had time to send its reasons for not arming."""
        if self.vehicle is None:
            return
        longest_s = _LONGEST_SILENCE_S if self._answer_s is None else _LONGEST_S
        if self._settled_s is None and (not self._open or now_s >= self._begun_s + longest_s):
            knows = self._contact.monitor.knows_position or now_s >= self._begun_s + _PLACE_S
            self.waits_for_place = self._placed and not knows
            if self.waits_for_place:
                return
            ready = self._told.get("sensors_health", _PREARM) & _PREARM
            self._settled_s = now_s + (0.0 if ready or self._contact.monitor.state.armed else _REASONS_S)
        if self._settled_s is not None and now_s >= self._settled_s:
            self.done = True


def decoded(value: float, kind: int, *, bytewise: bool) -> float | None:
    """Return the number in a PARAM_VALUE of MAV_PARAM_TYPE `kind`; None if the number is not finite.

    If `bytewise`, integers are encoded as the bytes of the float (PX4), otherwise as numbers (ArduPilot).

    >>> decoded(struct.unpack("<f", struct.pack("<i", 3))[0], 6, bytewise=True)
    3.0
    >>> decoded(3.0, 2, bytewise=False)
    3.0
    """
    if bytewise and kind in _INTEGERS:
        return float(struct.unpack_from(_INTEGERS[kind], struct.pack("<f", value))[0])
    return float(value) if math.isfinite(value) else None


def ask_vehicle(
    url: str,
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    note: Callable[[str], None] = lambda _text: None,
    placed: bool = False,
) -> VehicleSnapshot:
    """Wait for the vehicle behind a link, and read its state and the settings that plans assume.

    `placed` is as in `Inquiry`. Raises LinkError if the link fails, NoVehicleError if no vehicle is heard,
    and KeyboardInterrupt at Ctrl-C.
    """
    inquiry = Inquiry(system_id=system_id, placed=placed)
    with Server([inquiry], [url]) as server:
        name = server.urls[0]
        note(f"asking the vehicle on {name}")
        reason = server.run(until=lambda _now_s: inquiry.vehicle is not None, limit_s=wait_s)
        if reason is StopReason.FINISHED:
            reason = server.run(until=lambda _now_s: inquiry.done or inquiry.waits_for_place)
        if reason is StopReason.FINISHED and not inquiry.done:
            note("waiting until the vehicle knows its position")
            reason = server.run(until=lambda _now_s: inquiry.done)
    if reason is StopReason.STOPPED:
        raise KeyboardInterrupt
    if inquiry.vehicle is None:
        raise inquiry.search.failure(name, wait_s)
    return inquiry.snapshot()
