"""One order to one vehicle, confirmed by the vehicle's telemetry, not only by its acknowledgement."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from geo.errors import WbfMissionError
from geo.system import steady_s
from mission.ground.arming_gate import Standstill
from mission.ground.command import (
    MotorsStandError,
    OperatorCommand,
    OrderError,
    VehicleRefusedError,
    VehicleSilentError,
)
from mission.ground.contact import Answer, Contact, Heartbeat, Order, StateBefore, result_name
from mission.ground.modes import Maneuver
from mission.ground.vehicle_state import SHARED_ID, VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer.vehicles import VehicleSearch
from mission.transfer.wire import GROUND_STATION, command_long

OFF_GROUND_M = 0.5
"""Height above home above which a vehicle is in the air (m)."""
_DO_ITEMS = 10
"""Largest number of DO items in a row: a vehicle runs them at once, and reports the item after them."""


@dataclass(frozen=True, slots=True)
class Step:
    """Messages of an order, and the telemetry that confirms it."""

    # Returns whether the vehicle's telemetry confirms the order
    shown: Callable[[VehicleMonitor], bool]
    command: int | None = None  # MAV_CMD; None if only `message` is sent
    params: tuple[float, ...] = ()
    # Sent to vehicles that do not know the command; vehicles never acknowledge it
    message: Message | None = None
    repeats: bool = True  # Whether `message` may be sent again while the current item stays the same


def is_ready(wanted: OperatorCommand, heard: VehicleMonitor) -> bool:
    """Return whether the telemetry that `step_of` needs was received."""
    if wanted.order == "takeoff":
        # A disarmed vehicle gets an error in place of this order, which needs no position.
        return not heard.state.armed or (heard.position_heard_s > -math.inf and heard.flies is not None)
    return wanted.order != "set-item" or heard.item_heard_s > -math.inf


def step_of(wanted: OperatorCommand, vehicle: tuple[int, int], heard: VehicleMonitor) -> Step:
    """Return the messages that give a vehicle an order.

    Raises VehicleRefusedError if the vehicle's state rules out the order, MotorsStandError if an order
    without permission would start its motors, and ModeError for an unknown mode.
    """
    if wanted.order in ("arm", "disarm"):
        arms = wanted.order == "arm"
        return Step(
            lambda seen: seen.state.armed == arms, int(m.MAV_CMD_COMPONENT_ARM_DISARM), (float(arms),)
        )
    if wanted.order == "takeoff":
        return _takeoff(wanted, vehicle[0], heard)
    if wanted.order == "mission":
        profile = heard.profile
        if profile.start_arms and not heard.state.armed and not wanted.arms:
            raise MotorsStandError(
                f"system {vehicle[0]}: {wanted}: the motors stand still; {profile.name} starts them and "
                f"takes off at this order: add --arm to allow this"
            )
        return Step(lambda seen: seen.in_mission, int(m.MAV_CMD_MISSION_START))
    if wanted.order == "set-item":
        return _set_item(wanted, vehicle, heard)
    if wanted.order == "mode":
        numbers, name = heard.modes.numbers(wanted.value), heard.modes.told_name(wanted.value)
        return Step(lambda seen: seen.mode == name, int(m.MAV_CMD_DO_SET_MODE), numbers)
    maneuver = Maneuver(wanted.order)
    shows = heard.modes.shows(maneuver)
    shown = (lambda seen: seen.mode in shows) if shows else (lambda seen: not seen.in_mission)
    return Step(shown, *heard.modes.maneuver(maneuver))


def _takeoff(wanted: OperatorCommand, system_id: int, heard: VehicleMonitor) -> Step:
    state = heard.state
    if not state.armed:
        msg = f"system {system_id}: {wanted}: the motors stand still; arm first (order arm)"
        raise VehicleRefusedError(msg)
    if heard.flies if heard.flies is not None else state.height_m > OFF_GROUND_M:
        raise VehicleRefusedError(
            f"system {system_id}: {wanted}: it flies already, {state.height_m:.1f} m above home in mode"
            f" {heard.mode}; give hold, return, land, mission or mode instead"
        )
    profile = heard.profile
    altitude_m = wanted.height_m + (heard.home_altitude_m if profile.takeoff_above_sea else 0.0)
    default = math.nan if profile.nan_parameters is None else 0.0
    params = (0.0, 0.0, 0.0, default, default, default, altitude_m)
    start_m = state.height_m
    return Step(lambda seen: seen.state.height_m > start_m + OFF_GROUND_M, int(m.MAV_CMD_NAV_TAKEOFF), params)


def _set_item(wanted: OperatorCommand, vehicle: tuple[int, int], heard: VehicleMonitor) -> Step:
    count, item = heard.state.total, wanted.item
    if count is not None and item >= count:
        there = f"its mission has {count} items; give 1 to {count}"
        msg = f"system {vehicle[0]}: {wanted}: {there if count else 'it holds no mission; upload a mission'}"
        raise VehicleRefusedError(msg)
    profile = heard.profile
    seq = item + (1 if profile.home_at_zero else 0)
    by_message = m.MAVLink_mission_set_current_message(*vehicle, seq)
    command = int(m.MAV_CMD_DO_SET_MISSION_CURRENT) if profile.item_command else None
    before, after = heard.state.item, item + _DO_ITEMS + 1
    # If the vehicle was there already, the item before the order may be the item after DO items, too.
    is_near = before is not None and item <= before < after
    shows = range(item, max(before, item + 1) if before is not None and is_near else after)
    return Step(
        lambda seen: seen.state.item in shows, command, (float(seq),), by_message, repeats=not is_near
    )


_PATIENCE_S = 15.0
_ROUND_TRIPS = 12.0
_ASK_AGAIN_S = 3.0
_KNOWN_S = 3.0
_LAST_WORDS_S = 0.5
_REST_S = 0.1
_SAY_AGAIN_S = 1.0
_FAST_US = 200_000.0
_COMES_S = 1.2
_STREAMED = (
    m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    m.MAVLINK_MSG_ID_MISSION_CURRENT,
    m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
)


class CommandSession:
    """Component that gives one order to one vehicle: the vehicle of `system_id`, or the first vehicle heard.

    If a `contact` is given, its owner updates it, sends the ground station's heartbeat, and discards the
    session if the program was suspended. Without a `contact`, the session fails if `clock` shows that the
    program was suspended, since the order is old then. Raises OrderError for system id 0: all vehicles.
    """

    system_id, component_id = GROUND_STATION
    wanted: frozenset[int] | None = None

    def __init__(
        self,
        wanted: OperatorCommand,
        *,
        system_id: int | None = None,
        contact: Contact | None = None,
        clock: Callable[[], float] = steady_s,
    ) -> None:
        if (system_id if contact is None else contact.vehicle[0]) == 0:
            raise OrderError(
                f"{wanted}: an order to system 0 reaches all vehicles; name one vehicle, 1 to 255"
            )
        self.done = False
        self.error: Exception | None = None
        self.search = VehicleSearch(system_id)
        self._wanted = wanted
        self._contact = contact or Contact()
        self._heartbeat = Heartbeat() if contact is None else None
        self._standstill = Standstill(clock) if contact is None else None
        self._texts_before = 0
        self._step: Step | None = None
        self._order: Order | None = None
        self._accepted = False
        self._before = StateBefore.of(self._contact.monitor, -math.inf)  # State when the order was given
        self._shown_before = self._obeyed = False
        self._refusal: tuple[str, float] | None = None
        self._begun_s = self._message_s = math.inf
        self._streams_s = self._said_s = self._ordered_s = -math.inf

    @property
    def vehicle(self) -> tuple[int, int] | None:
        """System and component id of the vehicle; None before the vehicle is heard."""
        if self._heartbeat is None:
            return self._contact.vehicle
        found = self.search.found
        return None if found is None else (found.system_id, found.component_id)

    @property
    def mode(self) -> str:
        """Name of the vehicle's flight mode."""
        return self._contact.monitor.mode

    @property
    def texts(self) -> list[str]:
        """Texts that the vehicle sent since the order, each once, and without the text that is in `error`."""
        said = dict.fromkeys(text for _, _, text in self._contact.texts.texts)
        return [text for text in said if self.error is None or text not in str(self.error)]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Receive a message."""
        self._look_at_clock()
        if self.done:
            return []
        found = self.search.take(message) if self._heartbeat is not None else None
        if found is not None:
            self._begun_s, self._contact.vehicle = now_s, (found.system_id, found.component_id)
        if (message.get_srcSystem(), message.get_srcComponent()) != self.vehicle:
            return []
        if self._heartbeat is not None:
            self._contact.receive(message, now_s)
        return self._note(message, now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Send the due messages."""
        self._look_at_clock()
        if self.done:
            return []
        out = self._contact.link.poll(now_s)
        if self._heartbeat is not None:
            out += self._heartbeat.poll(now_s)
        else:
            self._begun_s = min(self._begun_s, now_s)
        if self.vehicle is not None and now_s >= self._streams_s:
            self._streams_s = now_s + _ASK_AGAIN_S
            out += self._ask_for_streams(self.vehicle, now_s)
        if self._refusal is not None:
            if now_s >= self._refusal[1]:
                reason = (self._said or f"{self._refusal[0]}; it gives no reason") + self._advice
                self._fail(VehicleRefusedError(f"{self._name} refused {self._wanted}: {reason}"))
        elif self._step is None:
            out += self._begin(now_s)
        elif self._order is not None and now_s >= self._order.due_s:
            if self._obeyed:
                self.done = True  # only the COMMAND_ACK was lost
            elif self._is_overruled:
                self._order.due_s = math.inf
            elif self._step.message is not None and not self._is_lost:
                self._order.due_s = now_s + _SAY_AGAIN_S
            elif self._order.is_given_up:
                self._fail(VehicleSilentError(f"{self._name}: no answer to {self._wanted}"))
            else:
                out += self._order.send(now_s)
                self._ordered_s = now_s
        elif now_s >= self._message_s:
            out += self._say(self._step, now_s)
        if not self.done and now_s >= self._end_s:
            self._fail(self._not_shown())
        return out

    def next_deadline(self) -> float:
        """Time (s) at which the next `poll` is due."""
        if self.done:
            return math.inf
        due_s = [self._end_s, self._message_s, self._contact.link.next_deadline()]
        if self._heartbeat is not None:
            due_s.append(self._heartbeat.due_s)
        if self.vehicle is not None:
            due_s.append(self._streams_s)
            if self._step is None:
                due_s.append(self._ready_s)
        if self._order is not None:
            due_s.append(self._order.due_s)
        if self._refusal is not None:
            due_s.append(self._refusal[1])
        return min(due_s)

    @property
    def _end_s(self) -> float:
        """Deadline (s) for the confirmation by telemetry; retries on a slow link make it later."""
        return self._begun_s + _PATIENCE_S + _ROUND_TRIPS * self._trip_s

    @property
    def _ready_s(self) -> float:
        """Time (s) at which the order is sent even if required telemetry is missing."""
        return self._begun_s + _KNOWN_S + _ROUND_TRIPS * self._trip_s

    @property
    def _said(self) -> str:
        """Last warning of the vehicle since the order; empty if there was none."""
        return self._contact.texts.last_warning("", self._texts_before)

    @property
    def _advice(self) -> str:
        """Advice if arming or take-off was refused because of the flight mode; otherwise empty."""
        monitor, order = self._contact.monitor, self._wanted.order
        name = monitor.modes.arming
        lifts = order == "takeoff" and self._contact.profile.takeoff_needs_arming and monitor.mode != name
        if name is None or not (lifts or (order == "arm" and monitor.in_mission)):
            return ""
        return f"; it {'takes off' if lifts else 'arms'} in {name}: give the order mode {name} first"

    @property
    def _trip_s(self) -> float:
        return self._contact.link.round_trip.known_s or 0.0

    @property
    def _name(self) -> str:
        return "vehicle" if self.vehicle is None else f"system {self.vehicle[0]}"

    def _look_at_clock(self) -> None:
        """Fail if the program was suspended."""
        stood_s = 0.0 if self._standstill is None else self._standstill.look()
        if stood_s and not self.done:
            text = f"{self._wanted} is dropped: the program stood still for {stood_s:.0f} s"
            advice = "check the vehicle's state, and give the order again"
            self._fail(VehicleSilentError(f"{self._name}: {text}; {advice}"))

    def _ask_for_streams(self, vehicle: tuple[int, int], now_s: float) -> list[Message]:
        """Request the telemetry that confirms the order; requests are repeated, since they may be lost.

        A message that the contact's owner receives already is not requested: a request would change its rate.
        """
        comes: tuple[bool, ...] = (False,) * len(_STREAMED)
        if self._heartbeat is None:
            monitor, since_s = self._contact.monitor, now_s - _COMES_S
            heard = (monitor.position_heard_s, monitor.item_heard_s)
            comes = (*(one > since_s for one in heard), monitor.flies is not None)
        kinds = (kind for kind, there in zip(_STREAMED, comes, strict=True) if not there)
        return [command_long(vehicle, m.MAV_CMD_SET_MESSAGE_INTERVAL, kind, _FAST_US) for kind in kinds]

    def _note(self, message: Message, now_s: float) -> list[Message]:
        if isinstance(message, m.MAVLink_statustext_message):
            if self._refusal is not None:
                result, until_s = self._refusal
                self._refusal = result, min(until_s, now_s + _REST_S)
        elif isinstance(message, m.MAVLink_command_ack_message):
            return self._on_ack(message, now_s)
        if self._step is None:
            return self._begin(now_s)
        shown = self._step.shown(self._contact.monitor)
        self._obeyed |= shown and not self._shown_before
        is_not_repeated = self._order is not None and self._order.due_s == math.inf
        if shown and (self._accepted or (self._obeyed and is_not_repeated)):
            self.done = True
        return []

    @property
    def _is_overruled(self) -> bool:
        """Whether a pilot or a failsafe has acted since the order; a disarm order may change the mode."""
        monitor = self._contact.monitor
        expected = {monitor.mode} if self._wanted.order == "disarm" else ()
        lost = self._shown_before and self._step is not None and not self._step.shown(monitor)
        return lost or self._before.is_overruled(monitor, expected)

    def _begin(self, now_s: float) -> list[Message]:
        """Send the order once the required telemetry has arrived or is overdue."""
        vehicle = self.vehicle
        if vehicle is None or not (is_ready(self._wanted, self._contact.monitor) or now_s >= self._ready_s):
            return []
        if self._contact.monitor.clock.is_shared:
            text = f"{SHARED_ID}; the order was not sent"
            self._fail(VehicleRefusedError(f"{self._name}: {text}; give each vehicle its own system id"))
            return []
        try:
            step = self._step = step_of(self._wanted, vehicle, self._contact.monitor)
        except WbfMissionError as error:
            self._fail(error)
            return []
        monitor = self._contact.monitor
        self._before = StateBefore.of(monitor, now_s)
        self._shown_before = step.shown(monitor)
        self._texts_before = self._contact.texts.count
        if step.command is None:
            return self._say(step, now_s)
        self._order, self._ordered_s = self._contact.order(step.command, *step.params), now_s
        return self._order.send(now_s)

    def _say(self, step: Step, now_s: float) -> list[Message]:
        """Send the message, which has no acknowledgement; again only while the telemetry shows it as lost."""
        assert step.message is not None
        self._accepted = True
        self._message_s = now_s + _SAY_AGAIN_S + self._trip_s
        if self._is_overruled or (self._said_s > -math.inf and not self._is_lost):
            return []
        self._said_s = now_s
        return [step.message]

    @property
    def _is_lost(self) -> bool:
        """Whether a set-item was lost: the item that was reported since is the item before the order."""
        monitor, repeats = self._contact.monitor, self._step is not None and self._step.repeats
        heard = monitor.item_heard_s > max(self._said_s, self._ordered_s) + self._trip_s
        return repeats and heard and monitor.item == self._before.item

    def _on_ack(self, message: m.MAVLink_command_ack_message, now_s: float) -> list[Message]:
        if self._order is None or self._step is None:
            return []
        answer = self._order.answer(message, now_s)
        if answer is Answer.NONE:
            return []
        self._order = None
        if answer is Answer.ACCEPTED:
            self._accepted = True
            return []
        if self._step.message is not None and message.result == m.MAV_RESULT_UNSUPPORTED:
            return self._say(self._step, now_s)
        # ArduPilot sends the reason after the acknowledgement; a long text comes in chunks.
        waits_s = _REST_S if self._said else _LAST_WORDS_S + self._trip_s
        self._refusal = result_name(message.result), now_s + waits_s
        return []

    def _not_shown(self) -> Exception:
        if not self._accepted:
            since = f"; its mode changed to {self.mode}" if self.mode != self._before.mode else ""
            return VehicleSilentError(f"{self._name}: no answer to {self._wanted}{since}")
        answered = "accepted" if self._step is not None and self._message_s == math.inf else "was given"
        text = self._said or f"it is in mode {self.mode}"
        seconds = self._end_s - self._begun_s
        return VehicleRefusedError(
            f"{self._name} {answered} {self._wanted}, but its telemetry does not confirm this in "
            f"{seconds:.0f} s: {text}"
        )

    def _fail(self, error: Exception) -> None:
        self.error, self.done, self._order = error, True, None
