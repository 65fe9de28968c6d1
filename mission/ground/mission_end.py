"""Detection of the end of a mission, and of the cause of a flight that ended early."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from mission.ground.changes import MissionChanges
from mission.ground.contact import Contact
from mission.ground.items import leads_home, leads_on
from mission.ground.pilot_watch import PilotWatch
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from mission.outcome import Outcome

__all__ = ["FailureWatch", "MissionEnd"]

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

    ``acts``: the text itself proves a reaction of the vehicle; otherwise a HEARTBEAT must show the reaction.
    ``first_only``: the cause counts only if there is no other.
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
    # The text of the loss itself does not arrive, because the link is down.
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
    """Signs of failures in one flight, from HEARTBEAT, SYS_STATUS, BATTERY_STATUS and texts."""

    failsafe: bool = False  # whether the last HEARTBEAT showed an active failsafe
    began: list[int] = field(default_factory=list)  # number of texts received at each start of a failsafe
    low_battery: bool = False  # from the last BATTERY_STATUS
    empty_battery: bool = False  # from the last BATTERY_STATUS
    unhealthy: int = 0  # MAV_SYS_STATUS_SENSOR bits enabled and unhealthy in any SYS_STATUS

    def on_heartbeat(self, message: m.MAVLink_heartbeat_message, texts_heard: int) -> None:
        """Handle a HEARTBEAT; ``texts_heard`` is the number of texts received before."""
        before, self.failsafe = self.failsafe, message.system_status in _FAILSAFE_STATES
        if self.failsafe and not before:
            self.began.append(texts_heard)

    def on_sys_status(self, message: m.MAVLink_sys_status_message) -> None:
        """Handle a SYS_STATUS."""
        self.unhealthy |= message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health

    def on_battery_status(self, message: m.MAVLink_battery_status_message) -> None:
        """Handle a BATTERY_STATUS."""
        self.low_battery = message.charge_state in _LOW_CHARGE_STATES
        self.empty_battery = message.battery_remaining == 0

    def cause(self, texts: Sequence[tuple[float, int, str]]) -> tuple[Outcome, str] | None:
        """Return outcome and reason of an aborted flight, None without any sign of a failure.

        The vehicle's texts have priority. Without texts, the state, battery and sensor health decide.
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
_REPEATS_S = 12.0
"""Time after a change in which a reached item may belong to the old mission (s): PX4 repeats
MISSION_ITEM_REACHED ten times, once per second."""
_FINISHED = re.compile(r"Mission (?:finished|complete)", re.IGNORECASE)


class MissionEnd:
    """Detects the end of a mission from the telemetry, and notifies `pilot`."""

    def __init__(self, contact: Contact, changes: MissionChanges) -> None:
        self.pilot, self.failures = PilotWatch(), FailureWatch()
        self.is_complete = False  # whether the last MISSION_CURRENT showed a complete mission
        self.says_finished = False  # whether a STATUSTEXT reported the end of the mission
        self._contact, self._monitor, self._changes = contact, contact.monitor, changes
        self._progress = ""

    @property
    def flies_home(self) -> bool:
        """Whether the vehicle has passed all waypoints of the mission."""
        item = self._monitor.state.item
        return self.pilot.mission_over or item is None or not self._leads_on(item)

    def _leads_on(self, item: int) -> bool:
        return leads_on(self._changes.held.items, item)

    def on_mission_current(
        self, message: m.MAVLink_mission_current_message, now_s: float, *, flies_mission: bool
    ) -> None:
        """Handle MISSION_CURRENT; after a landing, ArduPilot always reports the mission as complete."""
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
        """Whether a complete mission ends the flight, or else an armed vehicle returns home."""
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
            return Outcome.INTERRUPTED, f"the operator ordered it to {pilot.ordered.value}"
        cause = self.failures.cause(texts.texts[texts_before:])
        if cause is None and pilot.somebody_else_flies:
            return Outcome.PILOT_TOOK_OVER, pilot.reason
        if cause is None and self.says_finished and pilot.mission_over and not pilot.ended_mission:
            # The reported state is that of a new mission, which arrived after the flown mission had ended.
            return Outcome.COMPLETED, ""
        return cause or (Outcome.FLIGHT_ABORTED, texts.last_warning(f"disarmed{self._progress}"))

    def completed(self, texts_before: int) -> tuple[Outcome, str]:
        """Return outcome and reason of a complete mission, as ArduPilot reports it after any landing."""
        return self.cause(texts_before) if self.pilot.ended_mission else (Outcome.COMPLETED, "")
