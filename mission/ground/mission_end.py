"""Detection of the end of a mission, and of the reason if the flight ends early."""

from __future__ import annotations

import re

from mission.ground.change import ChangeOutcome
from mission.ground.changes import MissionChanges
from mission.ground.contact import Contact
from mission.ground.failure_watch import FailureWatch
from mission.ground.items import leads_home, leads_on
from mission.ground.pilot_watch import PilotWatch
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from mission.outcome import Outcome

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

        `started_s`: start of a real vehicle's mission; None if the vehicle cannot hold another station's:
        simulated vehicles have one station, and a reboot may have changed the mission.
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
