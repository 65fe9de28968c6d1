"""Change of a mission in flight on autopilots that overwrite a mission item by item (ArduPilot).

During the upload the stored mission is a mixture of old and new items. Meanwhile the vehicle flies to a
position in guided mode. It resumes its mission only after the whole mission was acknowledged and read back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from mission.ground.change import ChangeOutcome, ChangeRequest, ChangeSession
from mission.ground.contact import LATE_ORDER_S, Answer, Order, result_name
from mission.ground.items import (
    apart_m,
    is_return,
    item_to_mark,
    next_flown_to,
    same_position,
    speed_before,
)
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, GeoPoint, Mission, MissionItem
from mission.transfer import (
    CLIENT_MESSAGES,
    FailureReason,
    Output,
    TransferFailed,
    UploadVerified,
    VerifiedUpload,
)

# ArduCopter computes its stopping point from PSC_POSXY_P and WPNAV_ACCEL; these are their defaults.
_STOP_P_PER_S, _STOP_M_S2 = 1.0, 2.5
# Margin for delayed positions: a vehicle that resumes only at its stopping distance creeps to the target.
_LEAVE_SPARE_M, _MOST_LEAVE_M = 0.5, 12.0


@dataclass(slots=True)
class Leg:
    """Leg flown in guided mode to an item of a plan, or to the point above home if the item is the return."""

    plan: Mission
    index: int
    monitor: VehicleMonitor
    home: GeoPoint | None

    @property
    def item(self) -> MissionItem:
        """Item at the end of the leg."""
        return self.plan.items[self.index]

    @property
    def is_waypoint(self) -> bool:
        """Whether the leg ends at a waypoint, not above home."""
        return self.item.has_position and not is_return(self.item)

    @property
    def target(self) -> tuple[float, float, float]:
        """End of the leg: latitude and longitude (degrees), height above home (m)."""
        item, state, home = self.item, self.monitor.state, self.home
        if self.is_waypoint:
            return item.x, item.y, item.z
        if home is not None:
            return home.latitude_deg, home.longitude_deg, state.height_m
        return state.latitude_deg, state.longitude_deg, state.height_m

    @property
    def distance_m(self) -> float:
        """Horizontal distance to the target (m)."""
        state, (latitude, longitude, _) = self.monitor.state, self.target
        if not math.isfinite(state.latitude_deg):
            return math.inf
        return apart_m((state.latitude_deg, state.longitude_deg), (latitude, longitude))

    @property
    def nearing_m_s(self) -> float:
        """Horizontal closing speed to the target (m/s)."""
        state, (latitude, longitude, _) = self.monitor.state, self.target
        north = latitude - state.latitude_deg
        east = math.remainder(longitude - state.longitude_deg, 360.0) * math.cos(math.radians(latitude))
        away = math.hypot(east, north)
        return (state.velocity_m_s[0] * east + state.velocity_m_s[1] * north) / away if away > 0.0 else 0.0

    @property
    def leave_m(self) -> float:
        """Distance to the target at which to resume the mission (m): stopping distance plus a margin.

        The stopping distance is computed as in the square-root controller of ArduCopter's `AC_PosControl`.
        """
        speed_m_s, linear_m_s = self.monitor.state.ground_speed_m_s, _STOP_M_S2 / _STOP_P_PER_S
        stopping_m = speed_m_s / _STOP_P_PER_S
        if speed_m_s >= linear_m_s:
            stopping_m = 0.5 * (linear_m_s / _STOP_P_PER_S + speed_m_s**2 / _STOP_M_S2)
        return min(stopping_m + _LEAVE_SPARE_M, _MOST_LEAVE_M)


_FRESH_S = 1.0
_PATIENCE_S = 20.0
_TRIES = 3
# Time allowed for reading the mission back and for choosing the item.
_SPARE_S = 1.0
_CHAIN_M = 10.0
_CHAIN_S = 1.5
_LATE_M = 3.0
_LONGEST_S = 5.0
_FOREVER = 1_000_000
_TO_MISSION = frozenset({int(m.MAV_CMD_DO_SET_MODE), int(Command.NAV_RETURN_TO_LAUNCH)})
_SILENT_S = 2.0
# At lower speeds the direction of the velocity is mostly noise.
_SLOW_M_S = 0.5
_GUIDED_FLAG = float(m.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE)


class _Step(Enum):
    GUARDING = "setting the failsafe"
    WAITING = "waiting for the moment to begin"
    TURNING = "leaving the mission"
    SENDING = "sending the mission"
    PAUSING = "waiting for the link"
    CHOOSING = "choosing the item"
    NEARING = "nearing the target"
    RESUMING = "going back to the mission"
    LEAVING = "returning home"
    OVER = "over"


class AsideChange(ChangeSession):
    """Change during which the vehicle flies to the target in guided mode.

    The vehicle resumes the mission just before the target. If the upload takes longer, the vehicle flies to
    further waypoints of the new mission one by one. A failed upload is repeated. If all repetitions fail, the
    old mission is sent again. If that fails too, the vehicle returns home (RTL). In mission mode, the vehicle
    flies only a complete mission that was acknowledged and read back.
    """

    def __init__(self, request: ChangeRequest) -> None:
        super().__init__(request)
        modes = self._contact.profile.change_modes or {}
        self._guided, self._auto = modes[self._monitor.vehicle_type]
        self._back = self._auto
        self._step = _Step.WAITING
        self._leg = Leg(request.new, request.resume_at, self._monitor, request.old.home)
        self._orders: dict[int, Order] = {}
        self._flown_next = request.resume_at
        self._is_far = False
        self._near = -1
        self._failures = 0
        self._heard_s = self._waits_s = -math.inf
        self._wake_s = math.inf
        self._verified_s = math.inf
        self._whole_s = math.inf
        self._resumed_s = math.inf
        self._item = request.item
        self._why = ""
        self._refused = False

    _flown_meanwhile = "the vehicle flies to the next point in guided mode"

    def start(self, now_s: float) -> list[Message]:
        """Begin the change at once, or later if a later start shortens the time in guided mode."""
        self.record.asked_s = self._waits_s = self._heard_s = now_s
        guard = self.request.guard
        if guard is not None and not guard.ready:
            self._step = _Step.GUARDING
            return guard.begin(now_s)
        return self._begin(now_s)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message of the vehicle; after the change, watch that the vehicle stays in its mission."""
        self._heard_s = now_s
        if self._step is _Step.GUARDING:
            return self._guard(message, now_s)
        if self._step is _Step.PAUSING and isinstance(message, m.MAVLink_heartbeat_message):
            # A failsafe may have ordered the vehicle home during the silence.
            aside = self._monitor.custom_mode in (self._guided, self._auto)
            return self._fly_to(now_s) + self._send(now_s) if aside else self._on_mode(now_s)
        if isinstance(message, m.MAVLink_command_ack_message):
            return self._on_ack(message, now_s)
        if isinstance(message, m.MAVLink_mission_current_message):
            item = self._monitor.state.item
            if self._step in (_Step.TURNING, _Step.SENDING) and self._leg.plan is self.request.new:
                # Whether the camera triggers depends on the item at which the vehicle left the old mission.
                self._item = max(self._item, min(item or 0, len(self.request.old.items) - 1))
            return []
        if isinstance(message, m.MAVLink_heartbeat_message):
            return self._on_mode(now_s)
        if self._transfer is not None and type(message).id in CLIENT_MESSAGES:
            return self._take(self._transfer.receive(message, now_s), now_s)
        if isinstance(message, m.MAVLink_global_position_int_message):
            return self._on_position(now_s)
        return []

    def poll(self, now_s: float) -> list[Message]:
        """Return the messages of the change that are due: failsafe parameters, orders, upload."""
        out: list[Message] = []
        guard = self.request.guard
        if self._step is _Step.GUARDING and guard is not None and now_s >= guard.due_s:
            out += guard.poll(now_s)
            if guard.refused:
                return self._finish(ChangeOutcome.REFUSED, guard.refused, now_s)
        for command, order in tuple(self._orders.items()):
            if now_s >= order.due_s:
                if command in _TO_MISSION and now_s - self._monitor.mode_heard_s > _SILENT_S:
                    # A pilot may have taken over meanwhile; the next HEARTBEAT shows the mode.
                    order.due_s = now_s + _FRESH_S
                elif order.is_given_up:
                    out += self._answered(command, Answer.NONE, "no answer", now_s)
                else:
                    out += order.send(now_s)
        out += self._poll_transfer(now_s)
        if now_s >= self._wake_s:
            self._wake_s = math.inf
            if self._step is _Step.WAITING:
                out += self._begin(now_s)
            elif self._step is _Step.NEARING:
                # The vehicle approaches the target more slowly than expected.
                self._is_far = True
                out += self._choose(now_s)
        return out

    def next_deadline(self) -> float:
        """Return the time of the next timeout in the change; infinity if there is none."""
        deadlines = [self._wake_s, self._transfer_s, *(order.due_s for order in self._orders.values())]
        if self._step is _Step.GUARDING and self.request.guard is not None:
            deadlines.append(self.request.guard.due_s)
        return min(deadlines)

    # Leaving the mission.

    def _guard(self, message: Message, now_s: float) -> list[Message]:
        """Handle a failsafe parameter; begin the change when all parameters are set."""
        guard = self.request.guard
        if guard is None or not isinstance(message, m.MAVLink_param_value_message):
            return []
        out = guard.receive(message)
        if guard.refused:
            return out + self._finish(ChangeOutcome.REFUSED, guard.refused, now_s)
        if guard.ready:
            self._step, self._waits_s = _Step.WAITING, now_s
            out += self._begin(now_s)
        return out

    def _begin(self, now_s: float) -> list[Message]:
        request = self.request
        state = self._monitor.state
        if now_s - self._waits_s > _PATIENCE_S:
            return self._finish(ChangeOutcome.GIVEN_UP, "no good moment came", now_s)
        self._wake_s = now_s + 0.5 * _FRESH_S
        item = request.item if state.item is None else state.item
        if item >= len(request.old.items) or is_return(request.old.items[item]):
            return self._finish(ChangeOutcome.GIVEN_UP, "the vehicle is on its way home", now_s)
        climbs = request.old.items[item].command == Command.NAV_TAKEOFF
        if now_s - state.heard_s > _FRESH_S or climbs or self._monitor.custom_mode != self._auto:
            return []
        window_s = 1.5 * request.seconds_an_item * len(request.new.items) + _SPARE_S
        if item != self._near and self._near >= 0:
            # The vehicle has passed the target, which was too near for a change.
            self._near, self._leg.index = -1, next_flown_to(request.new.items, self._leg.index)
        if same_position(request.old.items[item], request.new.items[self._leg.index]):
            trip_s = self._round_trip.seconds or 0.5 * request.seconds_an_item
            near_m = state.ground_speed_m_s * (trip_s + _SPARE_S)
            goes_on = not is_return(request.old.items[next_flown_to(request.old.items, item)])
            follows = next_flown_to(request.new.items, self._leg.index) != self._leg.index
            if self._leg.distance_m < near_m and follows and goes_on:
                self._near = item
                return []
            left_s = (self._leg.distance_m - self._leg.leave_m) / max(state.ground_speed_m_s, 0.5)
            if left_s > window_s:
                self._wake_s = min(self._wake_s, now_s + left_s - window_s)
                return []
        self._wake_s = math.inf
        self._step = _Step.TURNING
        self.record.sent_s = now_s
        self._item = item
        return self._fly_to(now_s)

    def _fly_to(self, now_s: float) -> list[Message]:
        """Order the vehicle to the target in guided mode."""
        return self._order(
            int(m.MAV_CMD_DO_REPOSITION), now_s, -1.0, _GUIDED_FLAG, 0.0, math.nan, position=self._leg.target
        )

    def _set_speed(self, now_s: float, index: int) -> list[Message]:
        """Order the speed that the mission sets for an item; each target in guided mode resets the speed."""
        speed = speed_before(self._leg.plan.items, index)
        if speed is None:
            return []
        return self._order(int(Command.DO_CHANGE_SPEED), now_s, 1.0, speed, -1.0)

    # Orders and their answers.

    def _order(
        self,
        command: int,
        now_s: float,
        *params: float,
        position: tuple[float, float, float] | None = None,
        tries: int | None = None,
    ) -> list[Message]:
        order = self._contact.order(command, *params, position=position, tries=tries)
        self._orders[command] = order
        return order.send(now_s)

    def _on_ack(self, message: m.MAVLink_command_ack_message, now_s: float) -> list[Message]:
        order = self._orders.get(message.command)
        if order is None:
            return []
        answer = order.answer(message, now_s)
        if answer is Answer.NONE:
            return []
        return self._answered(message.command, answer, self._said(result_name(message.result)), now_s)

    def _answered(self, command: int, answer: Answer, text: str, now_s: float) -> list[Message]:
        """Continue after the answer to an order; the answer is NONE if the order timed out."""
        order = self._orders.pop(command)
        if not self.done:
            self.record.retries += order.repeats
        match (command, self._step, answer):
            case (m.MAV_CMD_DO_REPOSITION, step, Answer.ACCEPTED):
                out = self._set_speed(now_s, self._leg.index)
                if step is _Step.TURNING:
                    self.record.turned_s = now_s if self.record.turned_s is None else self.record.turned_s
                    out += self._send(now_s)
                return out
            case (m.MAV_CMD_DO_REPOSITION, _Step.TURNING, _):
                self._why, self._refused = text, answer is Answer.REFUSED
                # Resume the old mission, which is unchanged.
                self._leg.plan = self.request.old
                self._leg.index = self._flown_next = self._item
                return self._resume(now_s)
            case (m.MAV_CMD_DO_SET_MISSION_CURRENT, _Step.CHOOSING, Answer.ACCEPTED):
                self._step, self._wake_s = _Step.NEARING, now_s + _LONGEST_S
                return self._on_position(now_s)
            case (m.MAV_CMD_DO_SET_MISSION_CURRENT, _Step.CHOOSING, Answer.REFUSED):
                return self._on_failure(text, now_s, refused=True)
            case (m.MAV_CMD_DO_SET_MISSION_CURRENT, _Step.CHOOSING, Answer.NONE):
                return self._choose(now_s)
            case (m.MAV_CMD_DO_SET_MODE, _Step.RESUMING, Answer.ACCEPTED):
                return self._on_back(now_s)
            case (m.MAV_CMD_DO_SET_MODE | Command.NAV_RETURN_TO_LAUNCH, _, Answer.REFUSED):
                # The vehicle must not stay in guided mode, so repeat the refused order.
                order.due_s = now_s + _FRESH_S
                self._orders[command] = order
        return []

    # Upload.

    def _send(self, now_s: float) -> list[Message]:
        self._step = _Step.SENDING
        self._whole_s = now_s + self.request.seconds_an_item * (len(self._leg.plan.items) + 1)
        self._transfer = self._upload(self._leg.plan.items, None)
        return self._take(self._transfer.start(now_s), now_s)

    def _take(self, output: Output, now_s: float) -> list[Message]:
        out = list(output.messages)
        for event in output.events:
            self._note_begun_anew(event, now_s)
            if not isinstance(event, UploadVerified | TransferFailed):
                continue
            assert isinstance(self._transfer, VerifiedUpload)
            self.record.retries += self._transfer.statistics(now_s).retries
            confirmed_s, self._transfer = self._transfer.confirmed_s, None
            if isinstance(event, UploadVerified):
                if self._leg.plan is self.request.new:
                    self.record.acknowledged_s = confirmed_s
                self._verified_s = now_s
                self.held = self._leg.plan
                out += self._choose(now_s)
            else:
                refused = event.reason is FailureReason.REFUSED
                out += self._on_failure(self._said(event.text), now_s, refused=refused)
        return out

    def _on_failure(self, text: str, now_s: float, *, refused: bool) -> list[Message]:
        """Repeat the upload; if all repetitions fail, send the old mission; if that fails too, fly home."""
        if self._leg.plan is self.request.new:
            self._why, self._refused = text, refused
        if now_s - self._heard_s > _SILENT_S:
            # The link is lost, so the failure says nothing about the mission.
            self._step = _Step.PAUSING
            return []
        self._failures += 1
        if not refused and self._failures < _TRIES:
            return self._send(now_s)
        if self._leg.plan is self.request.new:
            self._leg.plan, self._leg.index, self._failures = self.request.old, self._item, 0
            return self._fly_to(now_s) + self._send(now_s)
        if self._failures < 2 * _TRIES:
            return self._send(now_s)
        self._step = _Step.LEAVING
        self._why += "; the old mission could not be restored: the vehicle returns home"
        return self._order(int(Command.NAV_RETURN_TO_LAUNCH), now_s, tries=_FOREVER)

    def _choose(self, now_s: float) -> list[Message]:
        """Order the vehicle to set its current item to the item at which to resume."""
        self._step = _Step.CHOOSING
        home = 1 if self._contact.profile.home_at_zero else 0
        self._flown_next = self._leg.index
        left_m, speed = self._leg.distance_m - self._leg.leave_m, self._monitor.state.ground_speed_m_s
        # Do not fly a long distance to the target in guided mode.
        self._is_far |= not self._leg.is_waypoint or left_m > _LONGEST_S * max(speed, 0.5)
        # A vehicle that moves away from its target would stop twice: in guided mode and at the mode change.
        self._is_far |= speed > _SLOW_M_S and self._leg.nearing_m_s <= 0.0
        seq = home + self._item_to_choose()
        return self._order(int(m.MAV_CMD_DO_SET_MISSION_CURRENT), now_s, float(seq), 0.0)

    def _item_to_choose(self) -> int:
        """Return the item at which to resume, usually the item after the target.

        The first leg of a resumed mission starts at the stopping point of the vehicle. Near the target this
        is the target itself, so a mission that resumes with the target would make the vehicle stop there. The
        target is chosen nevertheless if the vehicle stops there anyway, or if needed DO items before the
        target cannot be sent as commands.
        """
        request, items, leg = self.request, self._leg.plan.items, self._leg.index
        target = items[leg]
        passed = target.command == Command.NAV_WAYPOINT and not (target.param1 or 0.0) > 0.0
        marked = item_to_mark(request.old, self._item, self._leg.plan, leg)
        needed = any(item.command != Command.DO_CHANGE_SPEED for item in items[marked:leg])
        following = next_flown_to(items, leg)
        if self._is_far or needed or not passed or following == leg:
            return marked if needed else leg
        self._flown_next = following
        return leg + 1

    # Flight in guided mode.

    def _on_position(self, now_s: float) -> list[Message]:
        if self._step is _Step.WAITING:
            return self._begin(now_s)
        if self._step not in (_Step.SENDING, _Step.NEARING):
            return []
        distance, speed = self._leg.distance_m, self._monitor.state.ground_speed_m_s
        if self._step is _Step.NEARING:
            near = distance <= self._leg.leave_m + speed * (self._round_trip.seconds or 0.0)
            return self._resume(now_s) if near or self._is_far else []
        # If the upload ends before the vehicle reaches the target, no further waypoint is needed.
        in_time = self._whole_s - now_s < distance / max(speed, 0.5) and distance > _LATE_M
        # The vehicle gets an order one round trip after it sent the position that triggers the order.
        ahead = max(_CHAIN_M, _CHAIN_S * speed) + speed * (self._round_trip.seconds or 0.0)
        if not self._leg.is_waypoint or in_time or distance >= ahead:
            return []
        items, following = self._leg.plan.items, next_flown_to(self._leg.plan.items, self._leg.index)
        if following == self._leg.index or items[following].command != Command.NAV_WAYPOINT:
            return []
        self._leg.index = following
        return self._fly_to(now_s)

    # Return to the mission.

    def _resume(self, now_s: float) -> list[Message]:
        self._step = _Step.RESUMING
        self._wake_s = math.inf
        self._resumed_s = now_s
        self._orders.pop(int(m.MAV_CMD_DO_REPOSITION), None)
        return self._order(int(m.MAV_CMD_DO_SET_MODE), now_s, *self._mode_parameters(), tries=_FOREVER)

    def _mode_parameters(self) -> tuple[float, float]:
        return float(m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(self._back)

    def _on_back(self, now_s: float) -> list[Message]:
        """Finish the change, since the vehicle is in mission mode again."""
        request = self.request
        # Guided mode has reset the speed of the mission, unless DO items have just set it.
        out = self._set_speed(now_s, self._flown_next)
        if self._leg.plan is request.new and self.record.acknowledged_s is not None:
            self.record.in_effect_s = now_s
            return out + self._finish(ChangeOutcome.DONE, "", now_s)
        if self._leg.plan is request.old and self._verified_s < math.inf:
            return out + self._finish(ChangeOutcome.ROLLED_BACK, self._why, now_s)
        outcome = ChangeOutcome.REFUSED if self._refused else ChangeOutcome.GIVEN_UP
        return out + self._finish(outcome, self._why, now_s)

    def _on_mode(self, now_s: float) -> list[Message]:
        """Handle the mode of a heartbeat."""
        mode = self._monitor.custom_mode
        if self._step is _Step.RESUMING and mode == self._auto and now_s > self._resumed_s:
            order = self._orders.pop(int(m.MAV_CMD_DO_SET_MODE), None)
            self.record.retries += 0 if order is None else order.repeats
            return self._on_back(now_s)
        if self._step is _Step.OVER:
            # A late command may have switched the vehicle to guided mode again; after that, a pilot did.
            late = now_s <= self.record.ended_s + LATE_ORDER_S
            if late and mode == self._guided and self.record.sent_s is not None and not self._orders:
                return self._order(int(m.MAV_CMD_DO_SET_MODE), now_s, *self._mode_parameters())
            return []
        if self._step in (_Step.GUARDING, _Step.WAITING):
            return []
        if mode not in (self._guided, self._auto):
            # Another pilot chose this mode. If a delayed command changes the mode, restore the pilot's mode.
            self._back = mode
            self._transfer = None
            why = self._why if self._step is _Step.LEAVING else self._said("the vehicle left guided mode")
            return self._finish(ChangeOutcome.GIVEN_UP, why, now_s)
        back = mode == self._auto and now_s - (self.record.turned_s or now_s) > _SILENT_S
        if back and self._step in (_Step.SENDING, _Step.CHOOSING, _Step.NEARING):
            # The vehicle must not fly an incomplete mission.
            return self._fly_to(now_s)
        return []

    def _finish(self, outcome: ChangeOutcome, text: str, now_s: float) -> list[Message]:
        self._step = _Step.OVER
        self._wake_s = math.inf
        speed = self._orders.get(int(Command.DO_CHANGE_SPEED))
        self._orders = {} if speed is None else {int(Command.DO_CHANGE_SPEED): speed}
        if not self.done:
            self._end(outcome, text, now_s)
        return []
