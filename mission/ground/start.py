"""Start of a mission: arming mode, arming gate, arming, and the order to start the mission."""

from __future__ import annotations

import math

from geo.frame import LocalFrame
from mission.ground.arming_gate import FARTHEST_M, ArmingGate, Stage
from mission.ground.contact import Answer, Contact, Order, StateBefore, result_name
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from mission.outcome import Outcome, Phase

STARTING = frozenset({Phase.WAIT, Phase.MODE, Phase.READY, Phase.ARM, Phase.START})
_READY_S = 180.0
_AGAIN_S = 3.0
_LAST_WORDS_S = 0.5
"""Wait for the reason of a refusal (s): ArduPilot sends the STATUSTEXT after the COMMAND_ACK."""
_MODE_SHOWN_S = 2.5
_MODE_SETTLES_S = 1.0
"""Time (s) after a mode change in which the vehicle may still report the arming checks of the old mode."""


class MissionStart:
    """Start of the mission after the uploads, sans-IO.

    Without an arming gate, the vehicle is armed and started after ``delay_s``. With an arming gate, the
    vehicle is switched to its arming mode first. After a refusal, it is armed again if it gave a new reason,
    which may pass.
    """

    def __init__(self, contact: Contact, gate: ArmingGate | None, delay_s: float) -> None:
        self.phase = Phase.WAIT  # FLIGHT after the vehicle accepted the order to start.
        self.failure: tuple[Outcome, str] | None = None  # Outcome and reason of a failed start.
        self._failed: tuple[Outcome, str] | None = None  # `failure` to be, while the vehicle is disarmed.
        self._contact, self._monitor, self._texts = contact, contact.monitor, contact.texts
        self._gate, self._delay_s = gate, delay_s
        self._home: GeoPoint | None = None
        self._order: Order | None = None
        self._refusal: tuple[str, float] | None = None
        self._arm_s = self._ready_s = math.inf
        self._mode_s = self._again_s = -math.inf
        self._before = StateBefore.of(self._monitor, -math.inf)
        self._texts_before = self._reasons_before = 0
        self._armed_since = False  # whether a HEARTBEAT since the order to arm showed the vehicle armed

    def begin(self, home: GeoPoint | None, texts_before: int, now_s: float) -> list[Message]:
        """Begin the start; ``home`` is the planned home, near which the vehicle must stand.

        Only texts of the vehicle from number ``texts_before`` on explain a failure.
        """
        self._home, self._texts_before = home, texts_before
        if self._gate is not None:
            self._ready_s = now_s + _READY_S
            return self._choose_mode(now_s)
        if self._delay_s > 0.0:
            self._arm_s = now_s + self._delay_s
            return []
        return self._arm(now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Return the messages of the start that are due: orders and requests for arming checks."""
        out: list[Message] = []
        gate, refusal = self._gate, self._refusal
        if self.phase is Phase.WAIT and now_s >= self._arm_s:
            out += self._arm(now_s)
        if gate is not None and refusal is not None and now_s >= refusal[1]:
            self._refusal = None
            if gate.told > self._reasons_before and now_s < self._ready_s:
                # The vehicle gave a new reason, which may pass.
                self.phase, self._again_s = Phase.READY, now_s + _AGAIN_S
                gate.check_again(now_s)
            else:
                self._fail(self._texts.last_warning(refusal[0], self._texts_before))
        if gate is not None and self.phase is Phase.READY:
            out += self._pass_gate(gate, now_s)
        order = self._order
        if order is not None and now_s >= order.due_s:
            monitor = self._monitor
            starts = self.phase is Phase.START and self._before.is_past(monitor)
            if self._failed is not None:
                disarmed = self._before.is_past(monitor) and not monitor.is_armed
                if disarmed or order.is_given_up:
                    self._end(disarmed=disarmed)
                else:
                    out += order.send(now_s)
            elif self._armed_since:
                # Only the answer was lost. A repeated order could arm a vehicle that a pilot has disarmed.
                out += self._give_start(now_s)
            elif starts and monitor.is_armed and monitor.in_mission:
                # A repeated order would restart the mission in flight.
                self.phase, self._order = Phase.FLIGHT, None
            elif order.is_given_up or (starts and self._before.is_overruled(monitor)):
                out += self._give_up(now_s)
            else:
                out += order.send(now_s)
        return out

    def look_at_clock(self, now_s: float) -> list[Message]:
        """End the start if the program was suspended: meanwhile it could not watch the vehicle."""
        stood_s = 0.0 if self._gate is None else self._gate.outlived_s()
        if stood_s == 0.0 or self.failure is not None or self._failed is not None:
            return []
        order, self._order = self._order, None
        if self.phase is Phase.START and order is not None:
            # The order was sent before the suspension: an answer counts, but the order is not repeated.
            self._order = order
            order.end_repeats(now_s)
            return []
        stood = f"the program stood still for {stood_s:.0f} s before the start"
        self.failure = Outcome.NOT_STARTED, f"{stood}: look at the vehicle, and start again"
        if self.phase is not Phase.ARM or order is None:
            return []
        # The vehicle may have armed.
        return self._disarm(now_s)

    def goodbye(self) -> list[Message]:
        """Disarm a real vehicle if the program ends before the answer to the order to arm or to disarm."""
        arms = self.phase is Phase.ARM or self._failed is not None
        pending = self._gate is not None and arms and self._order is not None
        return self._contact.order(m.MAV_CMD_COMPONENT_ARM_DISARM, 0.0).send(0.0) if pending else []

    def next_deadline(self) -> float:
        """Return the time of the next step or timeout of the start; infinity if there is none."""
        due_s = [self._arm_s] if self.phase is Phase.WAIT else []
        if self.phase is Phase.READY and self._gate is not None:
            due_s.append(self._gate.next_deadline())
        if self._refusal is not None:
            due_s.append(self._refusal[1])
        if self._order is not None:
            due_s.append(self._order.due_s)
        return min(due_s, default=math.inf)

    def on_sys_status(self, message: m.MAVLink_sys_status_message, now_s: float) -> None:
        """Forward SYS_STATUS to the gate if the vehicle is in its arming mode."""
        settled = now_s >= max(self._mode_s + _MODE_SETTLES_S, self._again_s)
        if self._gate is not None and self.phase is not Phase.MODE and settled:
            self._gate.on_sys_status(message, has_position=self._monitor.knows_position)

    def on_heartbeat(self) -> None:
        """End the start if HEARTBEATs show that the vehicle was armed, and that a pilot then disarmed it."""
        if self._gate is None or self.phase is not Phase.ARM or self._order is None or self._failed:
            return
        if self._armed_since and not self._monitor.is_armed:
            self._order = None
            self.failure = Outcome.NOT_STARTED, "the vehicle was disarmed after it had armed"
        self._armed_since = self._monitor.is_armed

    def on_ack(self, message: m.MAVLink_command_ack_message, now_s: float) -> list[Message]:
        """Handle a COMMAND_ACK, which may answer the pending order."""
        answer = Answer.NONE if self._order is None else self._order.answer(message, now_s)
        # After an unanswered order to arm, an ACK may answer that order, so only a HEARTBEAT confirms.
        if answer is Answer.NONE or (self._failed is not None and self.phase is Phase.ARM):
            return []
        if self._failed is not None:
            self._end(disarmed=answer is Answer.ACCEPTED)
            return []
        self._order = None
        if answer is Answer.REFUSED:
            self._refused(result_name(message.result), now_s)
            if self.phase is not Phase.START or self._gate is None:
                return []
            # The motors run although the vehicle does not fly.
            return self._disarm(now_s)
        if self.phase is Phase.MODE:
            self.phase, self._mode_s = Phase.READY, now_s
        elif self.phase is Phase.ARM:
            return self._give_start(now_s)
        elif self.phase is Phase.START:
            self.phase = Phase.FLIGHT
        return []

    def _pass_gate(self, gate: ArmingGate, now_s: float) -> list[Message]:
        """Arm if the vehicle is ready and the operator has agreed; end the start on a refusal or timeout."""
        if gate.stage is Stage.REFUSED:
            self.failure = Outcome.NOT_STARTED, "the operator did not agree to the start"
        elif gate.stage is Stage.CHECKING and now_s >= self._ready_s:
            why = "; ".join(gate.reasons) or f"no report within {_READY_S:.0f} s that the vehicle can arm"
            if self._again_s > -math.inf:
                # After a refusal to arm, the last text of the vehicle has the reason.
                why = self._texts.last_warning(why, self._texts_before)
            self.failure = Outcome.ARMING_REFUSED, why
        elif gate.stage is not Stage.CHECKING and self._away_m > FARTHEST_M:
            text = f"the vehicle stands {self._away_m:.0f} m from the start of its plan"
            self.failure = Outcome.NOT_STARTED, text
        elif gate.stage is Stage.GRANTED and self._is_in_other_mode(now_s):
            gate.check_again(now_s)
            return self._choose_mode(now_s)
        elif gate.stage is Stage.GRANTED:
            self._texts_before, self._reasons_before = self._texts.count, gate.told
            return self._arm(now_s)
        elif gate.stage in (Stage.ASKING, Stage.WAITING):
            self._ready_s = now_s + _READY_S
        return gate.poll(now_s)

    def _choose_mode(self, now_s: float) -> list[Message]:
        """Switch the vehicle to its arming mode if it is in another mode."""
        modes = self._monitor.modes
        if modes.arming is None or not self._is_in_other_mode(now_s):
            self.phase = Phase.READY
            return []
        return self._give(Phase.MODE, m.MAV_CMD_DO_SET_MODE, now_s, *modes.numbers(modes.arming))

    def _is_in_other_mode(self, now_s: float) -> bool:
        """Whether the vehicle is not in its arming mode."""
        name = self._monitor.modes.arming
        shown = now_s >= self._mode_s + _MODE_SHOWN_S
        return name is not None and shown and self._monitor.mode != name

    @property
    def _away_m(self) -> float:
        """Distance of the vehicle from the home of its plan (m); 0 if unknown."""
        home = self._home
        if home is None or not self._monitor.knows_position:
            return 0.0
        frame = LocalFrame(home.latitude_deg, home.longitude_deg)
        return math.hypot(*self._monitor.state.position_m(frame))

    def _arm(self, now_s: float) -> list[Message]:
        return self._give(Phase.ARM, m.MAV_CMD_COMPONENT_ARM_DISARM, now_s, 1.0)

    def _disarm(self, now_s: float) -> list[Message]:
        """Disarm the vehicle; the start fails once the vehicle is disarmed, or does not answer."""
        self._failed, self.failure = self.failure, None
        return self._give(self.phase, m.MAV_CMD_COMPONENT_ARM_DISARM, now_s, 0.0)

    def _end(self, *, disarmed: bool) -> None:
        """End the failed start after the order to disarm."""
        assert self._failed is not None
        outcome, why = self._failed
        unsafe = "" if disarmed else "; the vehicle did not take the order to disarm: its motors may run"
        self._order, self._failed, self.failure = None, None, (outcome, why + unsafe)

    def _give_start(self, now_s: float) -> list[Message]:
        return self._give(Phase.START, m.MAV_CMD_MISSION_START, now_s, 0.0, 0.0)

    def _give(self, phase: Phase, command: int, now_s: float, *params: float) -> list[Message]:
        self.phase, self._armed_since = phase, False
        self._order = self._contact.order(command, *params)
        # The vehicle acknowledged arming, even if no HEARTBEAT shows it yet.
        self._before = StateBefore(self._monitor.mode, is_armed=True, item=self._monitor.item, given_s=now_s)
        return self._order.send(now_s)

    def _give_up(self, now_s: float) -> list[Message]:
        self._order = None
        if self._gate is None:
            self._refused("no answer", now_s)
            return []
        self.failure = Outcome.NO_ANSWER, f"no answer while {self.phase.value}"
        if self.phase is not Phase.ARM:
            return []
        # Perhaps only the answer was lost, so the vehicle may have armed.
        return self._disarm(now_s)

    def _refused(self, why: str, now_s: float) -> None:
        if self._gate is not None and self.phase in (Phase.MODE, Phase.ARM):
            self._refusal = why, now_s + _LAST_WORDS_S
        else:
            self._fail(self._texts.last_warning(why))

    def _fail(self, why: str) -> None:
        arming = self.phase is Phase.ARM
        self.failure = Outcome.ARMING_REFUSED if arming else Outcome.MISSION_REJECTED, why
