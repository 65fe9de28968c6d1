"""Detection of the end of a mission, and of the reason if the flight ends early."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

from mission.ground.change import ChangeOutcome
from mission.ground.changes import MissionChanges
from mission.ground.contact import LATE_ORDER_S, Contact
from mission.ground.items import leads_home, leads_on
from mission.ground.modes import Maneuver, VehicleModes, is_in_mission, mode_name
from mission.ground.vehicle_state import drives
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from mission.outcome import Outcome

_TAKEN = "taken out of its mission"
_STOPPED = "stopped on its way home"
_HOMEWARD = frozenset({"RTL", "SMART_RTL", "LAND", "QRTL", "QLAND", "PRECLAND", "FOLLOW_ME_LAND", "AUTOLAND"})
"""Modes in which a vehicle returns or lands."""
_RESTARTED = "its autopilot has started again"
_DOUBT_S = 5.0
"""Wait for a message that explains a mode change (s): messages may be lost, reordered, and up to 3 s late."""
_SHOWS = {Maneuver.HOLD: "holds", Maneuver.RETURN: "returns", Maneuver.LAND: "lands"}


class PilotWatch:
    """Tracks the flight mode from the start of a mission."""

    def __init__(self) -> None:
        self.events: list[tuple[float, str]] = []
        self.mode = ""
        self._in_mission: bool | None = None
        self._shows_mission = False
        self.ordered: Maneuver | None = None  # Maneuver ordered by the station, None in the mission.
        self.obeyed = ""  # Description of the vehicle's response to the order, empty before.
        self.ended_by_restart = ""  # State after a reboot that ended the mission, empty without one.
        self._held: list[tuple[float, str]] = []
        self._restarted = False
        self._late: tuple[Maneuver, float] | None = None  # Unanswered order, and its latest arrival (s).
        self.mission_over = False  # whether the vehicle reported the end of its mission
        self.replaced = False  # whether another station has sent the vehicle another mission
        self._over_s = -math.inf
        self._doubt: tuple[float, str] | None = None
        self._is_stopped = False

    @property
    def in_doubt(self) -> bool:
        """Whether it is unclear if the mission has ended or another pilot chose the present mode."""
        return self._doubt is not None

    @property
    def somebody_else_flies(self) -> bool:
        """Whether the vehicle left its mission without an order of the station."""
        return self._in_mission is False and self.ordered is None

    @property
    def taken_out(self) -> bool:
        """Whether an order or another pilot has taken, or may have taken, the vehicle out of its mission."""
        return self._in_mission is False or self.ordered is not None or self.in_doubt

    @property
    def ended_mission(self) -> bool:
        """Whether the vehicle left its mission, by another pilot or by an order that the vehicle obeyed."""
        return self._in_mission is False or bool(self.obeyed) or self.replaced

    @property
    def reason(self) -> str:
        """Text of the last takeover by another pilot, or an empty text."""
        return next((text for _, text in reversed(self.events) if text.startswith(_TAKEN)), "")

    def on_heartbeat(
        self,
        message: m.MAVLink_heartbeat_message,
        now_s: float,
        *,
        expects_change: bool,
        flies_home: bool = False,
        unsure: bool = False,
        ends_in: Collection[str] = (),
    ) -> None:
        """Handle a HEARTBEAT of the vehicle in flight.

        `expects_change`: the mission is being changed, so other modes than the mission mode are not reported.
        `flies_home`: the vehicle returns, so only modes that neither return nor land are reported.
        `unsure`: a reboot may have changed the mode, so reports wait for `settle` or `on_restart`.
        `ends_in`: modes after the mission's end; they mean a takeover if no end is reported within 5 s.
        """
        flies_home |= self.mission_over
        if flies_home and self.ordered is None and not unsure:
            self._follow_home(message, now_s, ends_in)
        self._follow(message, now_s, expects_change=expects_change or flies_home, ends_in=ends_in)
        if self._restarted:
            self._report_restart(message, now_s)
        elif not unsure:
            self.settle()

    def on_mission_end(self, now_s: float) -> None:
        """Record that the vehicle reported the end of the mission."""
        self.mission_over, self._over_s, self._doubt = True, now_s, None

    def on_mission_goes_on(self, now_s: float) -> None:
        """Record that items remain to be flown; later than 5 s after a reported end, this cancels the end.

        Within these 5 s, messages from before the end may still arrive. Outside the mission mode, the end is
        not cancelled: a PX4 that returns reports a mission that arrives now as active.
        """
        if self._shows_mission and now_s > self._over_s + _DOUBT_S:
            self.mission_over = False

    def on_new_mission(self) -> None:
        """Discard a reported end, which belongs to the previous mission."""
        self.mission_over = False

    def on_other_mission(self, items: int | None, now_s: float) -> None:
        """Report once that the vehicle holds a mission of another station."""
        if not self.replaced:
            self.replaced = True
            count = "" if items is None else f" ({items} items)"
            self.events.append((now_s, f"{_TAKEN}: another station has sent another mission{count}"))

    def poll(self, now_s: float, *, unsure: bool = False) -> None:
        """Report a takeover if no message explains the mode within 5 s; ``unsure`` delays all reports."""
        if now_s >= self.next_deadline():
            assert self._doubt is not None
            self._held.append(self._doubt)
            self._doubt, self._in_mission = None, False
        if not unsure and not self._restarted:
            self.settle()

    def next_deadline(self) -> float:
        """Return the time at which an unexplained mode counts as a takeover; infinity if there is none."""
        return math.inf if self._doubt is None else self._doubt[0] + _DOUBT_S

    def order(self, ordered: Maneuver | None, obeyed: str = "") -> None:
        """Record the ordered maneuver, or None for none; ``obeyed`` is not empty if it is obeyed already."""
        self.ordered, self.obeyed = ordered, obeyed

    def on_no_answer(self, ordered: Maneuver | None, now_s: float) -> None:
        """Record an unanswered order, which the vehicle may still obey within `LATE_ORDER_S`."""
        self._late = None if ordered is None else (ordered, now_s + LATE_ORDER_S)

    def settle(self) -> None:
        """Report the delayed mode changes, since no reboot explains them."""
        self.events += self._held
        self._held.clear()

    def on_restart(self, message: m.MAVLink_heartbeat_message | None, now_s: float) -> None:
        """Record a reboot, and report it with the first HEARTBEAT after it (None: no HEARTBEAT yet)."""
        self._restarted = True
        if message is not None:
            self._report_restart(message, now_s)

    def _report_restart(self, message: m.MAVLink_heartbeat_message, now_s: float) -> None:
        """Report a reboot in place of the mode changes that it caused."""
        out = bool(self._held) and self._in_mission is False
        self._restarted = False
        self._doubt = None
        self._held.clear()
        disarmed = not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED
        text = _RESTARTED + f": mode {self.mode}" * (out or disarmed) + ", motors off" * disarmed
        if out or disarmed:
            self.ended_by_restart = text
        self.events.append((now_s, text))

    def _follow_home(
        self, message: m.MAVLink_heartbeat_message, now_s: float, ends_in: Collection[str]
    ) -> None:
        """Report when the return home is interrupted, and when it continues."""
        mode = mode_name(message)
        goes = is_in_mission(message) or mode in _HOMEWARD or mode in ends_in
        if not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED or self._in_mission is not True:
            return
        if self._is_stopped is goes:
            self._is_stopped = not goes
            self.events.append((now_s, f"{'goes on home' if goes else _STOPPED}: mode {mode}"))

    def _follow(
        self,
        message: m.MAVLink_heartbeat_message,
        now_s: float,
        *,
        expects_change: bool,
        ends_in: Collection[str],
    ) -> None:
        """Update the mode, and detect takeovers, returns to the mission and obeyed orders."""
        before, self.mode = self.mode, mode_name(message)
        self._shows_mission = is_in_mission(message)
        if self._shows_mission:
            if not message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED:
                # PX4 switches back to the mission mode when disarmed, even if a pilot took over before.
                return
            if self.somebody_else_flies:
                self._held.append((now_s, f"back in its mission (mode {self.mode})"))
                self.ended_by_restart = ""
            if self._in_mission is False or self.ordered is Maneuver.RESUME:
                self.order(None)
            self._in_mission, self._doubt = True, None
            return
        known = VehicleModes(message.autopilot, message.type)
        if self._late is not None and self.ordered is None:
            # Only the first mode change may be the order's: after a pilot's mode, the pilot chooses.
            (late, latest_s), self._late = self._late, None
            if now_s < latest_s and self.mode in known.shows(late):
                self.order(late)
        if self.ordered is not None:
            modes = known.shows(self.ordered)
            armed = message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED
            if self.obeyed and armed and modes and self.mode not in modes | _HOMEWARD | frozenset(ends_in):
                self._held.append((now_s, f"{_TAKEN}: mode {self.mode}"))
                self.order(None)
                self._in_mission = False
                return
            # An order to resume is obeyed when the mission mode shows, which is handled above.
            if self.ordered is not Maneuver.RESUME and (not modes or self.mode in modes):
                self.obeyed = f"{_SHOWS[self.ordered]} (mode {self.mode})"
            # During a change or a return home, another mode does not mean that the mission was left.
            self._in_mission = bool(self._in_mission) and expects_change and not self.obeyed
            return
        # The vehicle cannot leave the mission before it has shown the mission mode once.
        if expects_change or self._in_mission is None:
            self._doubt = None
            return
        if self._in_mission:
            taken = (now_s, f"{_TAKEN}: mode {self.mode}")
            if self.mode in ends_in:
                self._doubt = self._doubt or taken
                self.poll(now_s, unsure=True)
                return
            # No mission ends in this mode, so another pilot chose it.
            self._held.append(self._doubt or taken)
            if self._doubt is not None:
                self._held.append((now_s, f"mode {self.mode}"))
            self._in_mission, self._doubt = False, None
        elif before != self.mode:
            self._held.append((now_s, f"mode {self.mode}"))


_FAILSAFE_STATES = frozenset({m.MAV_STATE_CRITICAL, m.MAV_STATE_EMERGENCY, m.MAV_STATE_FLIGHT_TERMINATION})
_LOW_CHARGE_STATES = frozenset(
    {
        m.MAV_BATTERY_CHARGE_STATE_LOW,
        m.MAV_BATTERY_CHARGE_STATE_CRITICAL,
        m.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
        m.MAV_BATTERY_CHARGE_STATE_FAILED,
    }
)
_ACTION = r": (?:holding|returning|landing|terminating the flight)$"


@dataclass(frozen=True, slots=True)
class _TextCause:
    """STATUSTEXT that names the cause of an early end.

    With ``acts``, the text itself shows that the vehicle reacted; otherwise a HEARTBEAT must show a failsafe.
    With ``first_only``, the cause counts only if no earlier text names a cause.
    """

    pattern: re.Pattern[str]
    outcome: Outcome
    reason: Callable[[re.Match[str], float], str]
    acts: bool = True
    first_only: bool = False


def _group(template: str = "{}") -> Callable[[re.Match[str], float], str]:
    return lambda match, _time_s: template.format(match.group(1))


_CAUSES = (
    _TextCause(
        re.compile(r"Battery empty"),
        Outcome.BATTERY_DEPLETED,
        lambda _match, time_s: f"battery empty at {time_s:.0f} s",
    ),
    _TextCause(re.compile(r"Battery (.+)" + _ACTION), Outcome.BATTERY_LOW, _group("battery {}")),
    _TextCause(re.compile(r"Flight terminated: (.+)"), Outcome.CRASHED, _group()),
    _TextCause(re.compile(r"Position lost"), Outcome.POSITION_LOST, lambda *_: "position lost"),
    _TextCause(
        re.compile(r"(?:Data link lost|GCS Failsafe)" + _ACTION),
        Outcome.LINK_LOST,
        lambda *_: "ground station lost",
    ),
    # The text "Data link lost" itself does not arrive, because the link is down.
    _TextCause(
        re.compile(r"Data link regained|GCS Failsafe Cleared"),
        Outcome.LINK_LOST,
        lambda *_: "ground station lost",
        acts=False,
    ),
    _TextCause(
        re.compile(r"(?:Geofence violated|Fence breached): (.+)"),
        Outcome.FENCE_BREACHED,
        _group("fence: {}"),
        acts=False,
    ),
    _TextCause(re.compile(r"Mission rejected: (.+)"), Outcome.MISSION_REJECTED, _group()),
    _TextCause(
        re.compile(r"(Item \d+: .+|cannot make progress.+)"),
        Outcome.CANNOT_FLY_ITEM,
        _group(),
        first_only=True,
    ),
)


@dataclass(slots=True)
class FailureWatch:
    """Signs of failures in a flight, collected from HEARTBEAT, SYS_STATUS, BATTERY_STATUS and texts."""

    failsafe: bool = False  # Whether the last HEARTBEAT showed an active failsafe.
    began: list[int] = field(default_factory=list)  # Number of texts received at each start of a failsafe.
    low_battery: bool = False  # Whether the last BATTERY_STATUS reported a low charge.
    empty_battery: bool = False  # Whether the last BATTERY_STATUS reported an empty battery.
    unhealthy: int = 0  # MAV_SYS_STATUS_SENSOR bits enabled and unhealthy in any SYS_STATUS.

    def on_heartbeat(self, message: m.MAVLink_heartbeat_message, texts_heard: int) -> None:
        """Handle a HEARTBEAT; ``texts_heard`` is the number of texts that arrived before the HEARTBEAT."""
        before, self.failsafe = self.failsafe, message.system_status in _FAILSAFE_STATES
        if self.failsafe and not before:
            self.began.append(texts_heard)

    def on_sys_status(self, message: m.MAVLink_sys_status_message) -> None:
        """Handle a SYS_STATUS."""
        self.unhealthy |= message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health

    def on_battery_status(self, message: m.MAVLink_battery_status_message) -> None:
        """Handle a BATTERY_STATUS of a battery of the motors."""
        if drives(message):
            self.low_battery = message.charge_state in _LOW_CHARGE_STATES
            self.empty_battery = message.battery_remaining == 0

    def cause(self, texts: Sequence[tuple[float, int, str]]) -> tuple[Outcome, str] | None:
        """Return outcome and reason of an aborted flight, or None without any sign of a failure.

        The vehicle's texts have priority. If they name no cause, battery and sensors decide.
        """
        found: tuple[Outcome, str] | None = None
        candidate: tuple[Outcome, str] | None = None
        for index, (time_s, _severity, text) in enumerate(texts):
            if candidate is not None and index in self.began:
                found, candidate = candidate, None
            for cause in _CAUSES:
                match = cause.pattern.match(text)
                if match is None:
                    continue
                named = (cause.outcome, cause.reason(match, time_s))
                if not cause.acts:
                    candidate = named
                elif found is None or not cause.first_only:
                    found, candidate = named, None
                break
        if candidate is not None and len(texts) in self.began:
            found = candidate
        return found or self._cause_without_texts()

    def _cause_without_texts(self) -> tuple[Outcome, str] | None:
        if not self.began:
            return None
        if self.empty_battery:
            return Outcome.BATTERY_DEPLETED, "battery empty"
        if self.low_battery:
            return Outcome.BATTERY_LOW, "battery low"
        if self.unhealthy & m.MAV_SYS_STATUS_SENSOR_GPS:
            return Outcome.POSITION_LOST, "position lost"
        if self.unhealthy & m.MAV_SYS_STATUS_GEOFENCE:
            return Outcome.FENCE_BREACHED, "fence breached"
        return None


_COMPLETE = 5  # MISSION_STATE_COMPLETE
_SETTLES_S = 5.0
"""Time after the start and after each change in which the vehicle may still report the mission before (s)."""
_REPEATS_S = 12.0
"""Time after a change in which a reached item may belong to the old mission (s): PX4 repeats
MISSION_ITEM_REACHED ten times, once per second."""
_FINISHED = re.compile(r"Mission (?:finished|complete)", re.IGNORECASE)


class MissionEnd:
    """Detects the end of a mission from the telemetry, and notifies `pilot`."""

    def __init__(self, contact: Contact, changes: MissionChanges) -> None:
        self.pilot, self.failures = PilotWatch(), FailureWatch()
        self.is_complete = False  # Whether the last MISSION_CURRENT showed a complete mission.
        self.says_finished = False  # Whether a STATUSTEXT reported the end of the mission.
        self._contact, self._monitor, self._changes = contact, contact.monitor, changes
        self._progress = ""
        self._mission_id = 0, 0  # Number of changes, and the mission's id that the vehicle reported since.

    @property
    def flies_home(self) -> bool:
        """Whether the vehicle has passed all waypoints of the mission."""
        item = self._monitor.state.item
        return self.pilot.mission_over or item is None or not self._leads_on(item)

    def _leads_on(self, item: int) -> bool:
        return leads_on(self._changes.held.items, item)

    def on_mission_current(
        self,
        message: m.MAVLink_mission_current_message,
        now_s: float,
        *,
        flies_mission: bool,
        started_s: float | None,
    ) -> None:
        """Handle MISSION_CURRENT; after a landing, ArduPilot always reports the mission as complete.

        `started_s`: start of a real vehicle's mission; None for simulated vehicles, which have one station.
        """
        self.is_complete = message.mission_state == _COMPLETE
        state = self._monitor.state
        if state.item is not None:
            self._progress = f" at item {state.item + 1} of {state.total or len(self._changes.held.items)}"
        leads_on = state.item is not None and self._leads_on(state.item)
        if flies_mission and leads_on:
            self.pilot.on_mission_goes_on(now_s)
            self.says_finished &= self.pilot.mission_over
        if flies_mission and (self.is_complete or (state.item is not None and not leads_on)):
            self.pilot.on_mission_end(now_s)
        # After a change that failed, the vehicle may hold either mission of this program.
        records = self._changes.records
        is_known = not self._changes.broken_off and all(r.outcome is ChangeOutcome.DONE for r in records)
        if flies_mission and is_known and started_s is not None:
            changes, known_id = self._mission_id
            if now_s < max(started_s, self._changes.changed_s) + _SETTLES_S or changes != len(records):
                self._mission_id = len(records), state.mission_id
            elif state.total not in (None, len(self._changes.held.items)) or (
                known_id and state.mission_id not in (0, known_id)
            ):
                self.pilot.on_other_mission(state.total, now_s)

    def on_reached(self, message: m.MAVLink_mission_item_reached_message, now_s: float) -> None:
        """Handle MISSION_ITEM_REACHED, which PX4 sends before MISSION_CURRENT of the next item."""
        if now_s > self._changes.changed_s + _REPEATS_S:
            item = message.seq - self._contact.profile.home_at_zero
            if 0 <= item < len(self._changes.held.items) and not self._leads_on(item + 1):
                self.pilot.on_mission_end(now_s)

    def on_text(self, message: m.MAVLink_statustext_message, now_s: float) -> None:
        """Handle a STATUSTEXT, which may report the end of the mission."""
        if _FINISHED.match(message.text):
            self.pilot.on_mission_end(now_s)
            self.says_finished = True

    @property
    def ends_flight(self) -> bool:
        """Whether the flight ends with the mission; if not, the armed vehicle still has to return home."""
        items, kind = self._changes.held.items, self._monitor.vehicle_type
        # Rovers stay armed at home, and fixed wings circle above home after a return without a landing.
        lands = any(item.command == Command.NAV_LAND for item in items)
        circles = kind == m.MAV_TYPE_FIXED_WING and not lands
        return not leads_home(items) or kind in self._contact.profile.stays_armed or circles

    def cause(self, texts_before: int) -> tuple[Outcome, str]:
        """Return outcome and reason of a flight that ended before its mission was complete."""
        pilot, texts = self.pilot, self._contact.texts
        if pilot.ended_by_restart:
            return Outcome.AUTOPILOT_RESTARTED, pilot.ended_by_restart
        if pilot.ordered is not None and pilot.obeyed:
            return Outcome.INTERRUPTED, f"the operator ordered the vehicle to {pilot.ordered.value}"
        cause = self.failures.cause(texts.since(texts_before))
        if cause is None and (pilot.somebody_else_flies or pilot.replaced):
            return Outcome.PILOT_TOOK_OVER, pilot.reason
        if cause is None and self.says_finished and pilot.mission_over and not pilot.ended_mission:
            # The reported state belongs to a new mission, which arrived after the flown mission had ended.
            return Outcome.COMPLETED, ""
        return cause or (Outcome.FLIGHT_ABORTED, texts.last_warning(f"disarmed{self._progress}"))

    def completed(self, texts_before: int) -> tuple[Outcome, str]:
        """Return outcome and reason of a flight whose mission the vehicle reports as complete."""
        return self.cause(texts_before) if self.pilot.ended_mission else (Outcome.COMPLETED, "")
