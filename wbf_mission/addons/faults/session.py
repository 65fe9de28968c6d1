"""Injects faults into links, components and vehicles of a simulation.

A simulation makes one `FaultSession` per run. All random numbers come from named streams of the seed, so
equal faults, seeds and inputs give equal bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import copy
from typing import Any, TypeAlias

from numpy.random import SeedSequence

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.link.faults import Faults
from mission.transfer import wire
from sim_vehicle.component import NEVER, Component, SaysGoodbye, Streams
from sim_vehicle.host.injection import Direction, Injection, Radio
from wbf_mission.addons.faults.fault import Fault, FaultError, parse_fault

_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
_REQUESTED = {
    m.MAVLINK_MSG_ID_MISSION_COUNT: "upload",
    m.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: "download",
}
_MOST_FAILED_IMAGES = 100_000
_FEWEST_PORT = 1000


class FaultSession(Injection):
    """The faults of a run, given as values or text, with their triggers and random streams.

    >>> session = FaultSession(["loss=0.5,at=armed,for=10"])
    >>> session.is_active(session.faults[0], 1, 5.0)
    False
    >>> session.fire(1, "armed", 20.0)
    >>> session.is_active(session.faults[0], 1, 25.0), session.is_active(session.faults[0], 1, 30.0)
    (True, False)
    """

    def __init__(self, faults: Iterable[Fault | str] = (), seed: int | SeedSequence = 0) -> None:
        super().__init__(seed)
        self.faults: tuple[Fault, ...] = tuple(
            parse_fault(fault) if isinstance(fault, str) else fault for fault in faults
        )
        self._fired: dict[tuple[int | None, str], float] = {}

    def fire(self, system: int, trigger: str, now_s: float) -> None:
        """Record the time of a vehicle's trigger; only the first time counts."""
        self._fired.setdefault((system, trigger), now_s)
        self._fired.setdefault((None, trigger), now_s)

    def window(self, fault: Fault, system: int | None) -> tuple[float, float]:
        """Return start and end of a fault for a vehicle; both are `NEVER` before the trigger.

        If `system` is None, the first trigger of any vehicle counts.
        """
        origin_s = 0.0
        if fault.trigger != "start":
            vehicle = system if fault.vehicle is None else fault.vehicle
            origin_s = self._fired.get((vehicle, fault.trigger), NEVER)
        begin_s = origin_s + fault.start_s
        return begin_s, begin_s + fault.duration_s

    def is_active(self, fault: Fault, system: int | None, now_s: float) -> bool:
        """Return whether a fault is active."""
        begin_s, end_s = self.window(fault, system)
        return begin_s <= now_s < end_s

    def require_vehicles(self, systems: Collection[int]) -> None:
        """Raise FaultError if a fault names a vehicle that is not among these MAVLink systems."""
        for fault in self.faults:
            if fault.vehicle is not None and fault.vehicle not in systems:
                there = ", ".join(map(str, sorted(systems))) or "none"
                raise FaultError(
                    f"fault {fault}: there is no vehicle {fault.vehicle}; the systems are {there}"
                )

    def wrap(self, components: Sequence[Component]) -> list[Component]:
        """Check the faults (`require_vehicles`), and wrap each affected component in a `FaultyComponent`."""
        systems = {c.system_id for c in components if c.component_id == _AUTOPILOT}
        self.require_vehicles(systems)
        wrapped: list[Component] = []
        triggered = any(fault.trigger != "start" for fault in self.faults)
        for component in components:
            faults = [fault for fault in self.faults if _affects(fault, component, systems)]
            watched = triggered and component.component_id == _AUTOPILOT
            wrapped.append(FaultyComponent(component, faults, self) if faults or watched else component)
        return wrapped

    def radio(self, name: str, number: int, client: int = 0, always: Faults | None = None) -> Radio | None:
        """Return a faulty radio if a fault affects the link."""
        faults = [f for f in self.faults if f.group == "link" and _matches(f.link, name, number)]
        if not faults:
            return super().radio(name, number, client, always)
        return FaultyRadio(self, f"{number}.{client}", always or Faults(), faults)


def _matches(wanted: str | None, name: str, number: int) -> bool:
    """Return whether a fault's ``link`` means this link: by number (below 1000), or by a part of the name."""
    if wanted is None:
        return True
    if wanted.isascii() and wanted.isdigit() and int(wanted) < _FEWEST_PORT:
        return int(wanted) == number
    return wanted in name


def _affects(fault: Fault, component: Component, systems: set[int]) -> bool:
    if component.system_id not in systems or fault.vehicle not in (None, component.system_id):
        return False
    if fault.kind == "silence":
        return component.component_id == fault.number
    if fault.kind == "stuck-camera":
        return component.component_id != _AUTOPILOT
    if fault.kind == "drop":
        return True
    return fault.group != "link" and component.component_id == _AUTOPILOT


def _break_vehicle(component: Component, kind: str, broken: bool, value: float = 0.0) -> None:
    """Start a vehicle fault on a `SimVehicle`, or end it if not `broken`; ignore other components."""
    vehicle: Any = component
    if getattr(vehicle, "pilot", None) is None:
        return
    if kind == "gps-loss":
        vehicle.pilot.position_ok = not broken
    elif kind == "motor-failure":
        vehicle.pilot.fail_motor(broken)
    elif broken and kind in ("low-battery", "dead-battery"):
        # When the fault ends, the battery stays as it is: nobody can change a battery in flight.
        vehicle.pilot.drain_battery(value)
    elif broken and kind == "battery-change":
        vehicle.pilot.change_battery()
    elif broken and kind == "reboot":
        vehicle.reboot()


class FaultyRadio(Radio):
    """A radio whose disturbances depend on the faults of a session."""

    def __init__(self, session: FaultSession, name: str, always: Faults, faults: Sequence[Fault]) -> None:
        super().__init__(session.seed, name, always)
        self._session = session
        self._always = always
        self._links = {
            direction: [fault for fault in faults if fault.direction in (direction, "both")]
            for direction in ("up", "down")
        }
        self._combined: dict[tuple[Fault, ...], Faults] = {}

    def faults_of(self, direction: Direction, system: int, now_s: float) -> Faults:
        """Return the disturbances that the radio and the active faults cause together."""
        key = tuple(
            fault
            for fault in self._links[direction]
            if fault.vehicle in (None, system) and self._session.is_active(fault, None, now_s)
        )
        found = self._combined.get(key)
        if found is None:
            found = self._combined[key] = _combine(key, self._always)
        return found


def _combine(faults: Sequence[Fault], always: Faults) -> Faults:
    """Combine the disturbances of several faults with the radio's lasting disturbances `always`."""

    def of(kind: str) -> list[float]:
        return [fault.number for fault in faults if fault.kind == kind]

    def chance(kind: str, own: float) -> float:
        return 1.0 - math.prod(1.0 - value for value in (*of(kind), own))

    cut = any(fault.kind == "link-loss" for fault in faults)
    return Faults(
        loss=1.0 if cut else chance("loss", always.loss),
        duplicate=chance("duplicate", always.duplicate),
        corrupt=chance("corrupt", always.corrupt),
        delay_s=sum(of("delay")) + always.delay_s,
        jitter_s=sum(of("jitter")) + always.jitter_s,
        baud=min((*of("bandwidth"), always.baud)),
    )


class FaultyComponent:
    """A component of a vehicle with message and vehicle faults."""

    def __init__(self, component: Component, faults: Sequence[Fault], session: FaultSession) -> None:
        self.inner = component
        # The result is kept: an isinstance check of a Protocol takes longer than forwarding a message.
        self._streams = component if isinstance(component, Streams) else None
        self.system_id = component.system_id
        self.component_id = component.component_id
        self.wanted = component.wanted
        self._session = session
        self._changes = [fault for fault in faults if fault.kind == "battery-change"]
        self._broken: dict[Fault, bool] = {
            f: False for f in faults if f.group == "vehicle" and f not in self._changes
        }
        self._silences = [fault for fault in faults if fault.kind == "silence"]
        self._messages = [f for f in faults if f.group == "message" and f.kind != "silence"]
        self._left: dict[Fault, float] = {f: math.inf if f.times is None else f.times for f in self._messages}
        self._stuck = [fault for fault in self._broken if fault.kind == "stuck-camera"]
        self._failed: set[int] = set()
        self._next_image = 0
        self._last_failed = False
        self._armed = self._flew = False
        self.link = ""
        self._stopped_s = NEVER  # Time of the last disarming; NEVER after the battery was changed.
        self._now_s = -math.inf

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Forward the message to the component unless a fault drops it."""
        self._update(now_s)
        trigger = _REQUESTED.get(type(message).id)
        if trigger is not None:
            self._session.fire(self.system_id, trigger, now_s)
        if self._silent(now_s) or self._occurring(_DROPPED, message, now_s) is not None:
            return []
        if (refusal := self._refusal(message, now_s)) is not None:
            return [refusal]
        if self._streams is not None:
            self._streams.link = self.link
        return self._apply_faults(self.inner.receive(message, now_s), now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Poll the component unless it is silent."""
        self._update(now_s)
        if self._silent(now_s) or self.inner.next_deadline() > now_s:
            return []
        return self._apply_faults(self.inner.poll(now_s), now_s)

    def open_links(self, names: frozenset[str]) -> None:
        """Forward `open_links` to a component with streams."""
        if self._streams is not None:
            self._streams.open_links(names)

    def streamed(self) -> list[tuple[str, list[Message]]]:
        """Return the component's telemetry on each link; there is none while the component is silent."""
        if self._streams is None or self._silent(self._now_s):
            return []
        return [
            (link, self._apply_faults(messages, self._now_s)) for link, messages in self._streams.streamed()
        ]

    def next_deadline(self) -> float:
        """Return the component's deadline, or the start or end of a fault if that is earlier."""
        edges = [
            edge
            for fault in (*self._broken, *self._silences)
            for edge in self._session.window(fault, self.system_id)
            if edge > self._now_s
        ]
        edge_s = min(edges, default=NEVER)
        return edge_s if self._silent(self._now_s) else min(edge_s, self.inner.next_deadline())

    def goodbye(self) -> list[Message]:
        """Return the component's last messages with faults applied."""
        if not isinstance(self.inner, SaysGoodbye) or self._silent(self._now_s):
            return []
        return self._apply_faults(self.inner.goodbye(), self._now_s)

    def _silent(self, now_s: float) -> bool:
        return any(self._session.is_active(fault, self.system_id, now_s) for fault in self._silences)

    def _update(self, now_s: float) -> None:
        """Start vehicle faults that are due, and end vehicle faults that are over."""
        self._now_s = now_s
        for fault, broken in self._broken.items():
            active = self._session.is_active(fault, self.system_id, now_s)
            if active != broken:
                self._broken[fault] = active
                still = any(on for other, on in self._broken.items() if other.kind == fault.kind)
                _break_vehicle(self.inner, fault.kind, still, fault.number)

    def _occurring(self, rules: Mapping[str, _Rule], message: Message, now_s: float) -> Fault | None:
        """Return the first active fault whose rule fits a message, and count its occurrence."""
        for fault in self._messages:
            fits = rules.get(fault.kind)
            if fits is None or not fits(message, fault):
                continue
            if self._left[fault] > 0 and self._session.is_active(fault, self.system_id, now_s):
                self._left[fault] -= 1
                return fault
        return None

    def _refusal(self, message: Message, now_s: float) -> Message | None:
        """Return the COMMAND_ACK by which a fault denies a command; None if no fault denies the command."""
        commands = (m.MAVLink_command_long_message, m.MAVLink_command_int_message)
        if not isinstance(message, commands) or message.target_system not in (0, self.system_id):
            return None
        if self._occurring(_REFUSED, message, now_s) is None:
            return None
        source = message.get_srcSystem(), message.get_srcComponent()
        return m.MAVLink_command_ack_message(message.command, int(m.MAV_RESULT_DENIED), 0, 0, *source)

    def _apply_faults(self, messages: list[Message], now_s: float) -> list[Message]:
        """Return the component's messages with faults applied."""
        if not messages:
            return messages
        sent: list[Message] = []
        for message in messages:
            self._fire_triggers(message, now_s)
            fault = self._occurring(_CHANGED, message, now_s)
            changed = message if fault is None else _CHANGES[fault.kind](message, fault)
            if changed is not None and self._stuck:
                changed = self._fail_image(changed)
            if changed is not None:
                sent.append(changed)
        return sent

    def _fail_image(self, message: Message) -> Message | None:
        """Mark an image as failed if the shutter was stuck; it stays failed if it is requested later."""
        if is_a(message, m.MAVLink_debug_float_array_message):
            return None if self._last_failed else message
        if not is_a(message, m.MAVLink_camera_image_captured_message):
            return message
        index = message.image_index
        if index >= self._next_image:
            self._next_image = index + 1
            if any(self._broken.values()) and len(self._failed) < _MOST_FAILED_IMAGES:
                self._failed.add(index)
        self._last_failed = index in self._failed
        return _with(message, capture_result=0) if self._last_failed else message

    def _fire_triggers(self, message: Message, now_s: float) -> None:
        """Fire the triggers, such as arming, that a message of the component reports."""
        fire, system = self._session.fire, self.system_id
        if is_a(message, m.MAVLink_heartbeat_message) and self.component_id == _AUTOPILOT:
            armed = bool(message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)
            if armed and not self._armed:
                fire(system, "armed", now_s)
            if armed != self._armed:
                self._stopped_s = NEVER if armed else now_s
            self._armed = armed
            self._change_battery(now_s)
        elif is_a(message, m.MAVLink_extended_sys_state_message):
            if message.landed_state == m.MAV_LANDED_STATE_IN_AIR:
                self._flew = True
                fire(system, "airborne", now_s)
            elif message.landed_state == m.MAV_LANDED_STATE_ON_GROUND and self._flew:
                fire(system, "landed", now_s)
        elif is_a(message, m.MAVLink_mission_current_message) and self._armed:
            fire(system, f"item:{message.seq}", now_s)

    def _change_battery(self, now_s: float) -> None:
        """Change the battery if a fault asks for it and the motors have been off long enough."""
        for fault in self._changes:
            due = now_s >= self._stopped_s + fault.number
            if due and self._session.is_active(fault, self.system_id, now_s):
                _break_vehicle(self.inner, fault.kind, broken=True)
                self._stopped_s = NEVER


def _is_item_or_request(message: Message, fault: Fault) -> bool:
    """Return whether a message is the fault's mission item or the request for this item."""
    return (wire.is_request(message) or wire.is_item(message)) and message.seq == fault.number


def _is_request_of_item(message: Message, fault: Fault) -> bool:
    return wire.is_request(message) and message.seq == fault.number


def _accepts(message: Message, _fault: Fault) -> bool:
    return is_a(message, m.MAVLink_mission_ack_message) and message.type == m.MAV_MISSION_ACCEPTED


def _with(message: Message, **fields: int) -> Message:
    """Return a copy of a message in which some fields have new values."""
    changed = copy(message)
    for name, value in fields.items():
        setattr(changed, name, value)
    return changed


def _acknowledge(result: int) -> Callable[[wire.MissionMessage, Fault], Message]:
    return lambda message, _fault: m.MAVLink_mission_ack_message(
        message.target_system, message.target_component, result, message.mission_type
    )


_Rule: TypeAlias = Callable[[Any, Fault], bool]
_DROPPED: dict[str, _Rule] = {
    "drop": lambda message, fault: type(message).id == fault.number and fault.direction != "down",
    "no-list": lambda message, _: type(message).id == m.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
    "no-count": lambda message, _: type(message).id == m.MAVLINK_MSG_ID_MISSION_COUNT,
    "no-request": _is_request_of_item,
}
"""For each kind of fault, the rule that decides whether a message to the component is dropped."""
_REFUSED: dict[str, _Rule] = {"refuse": lambda command, fault: command.command == fault.number}
_CHANGED: dict[str, _Rule] = {
    "drop": lambda message, fault: type(message).id == fault.number and fault.direction != "up",
    "no-request": _is_item_or_request,
    "no-final-ack": _accepts,
    "wrong-sequence": _is_item_or_request,
    "error-ack": _is_item_or_request,
    "early-final-ack": _is_request_of_item,
    "final-ack-error": _accepts,
}
"""For each kind of fault, the rule that decides whether a message from the component is changed."""
_CHANGES: dict[str, Callable[[Any, Fault], Message | None]] = {
    **dict.fromkeys(("drop", "no-request", "no-final-ack"), lambda _message, _fault: None),
    "wrong-sequence": lambda message, _: _with(message, seq=message.seq + 1),
    "error-ack": _acknowledge(int(m.MAV_MISSION_ERROR)),
    "early-final-ack": _acknowledge(int(m.MAV_MISSION_ACCEPTED)),
    "final-ack-error": lambda message, fault: _with(message, type=int(fault.number)),
}
"""For each kind of fault in `_CHANGED`, the message that is sent instead; None drops the message."""
