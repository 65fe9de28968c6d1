"""Whether the mission that a vehicle flies has ended, and why a flight ended before it."""

from __future__ import annotations

import re

from mission.ground.changes import MissionChanges
from mission.ground.contact import Contact
from mission.ground.failures import FailureWatch
from mission.ground.items import leads_home, leads_on
from mission.ground.pilot_watch import PilotWatch
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from mission.outcome import Outcome

__all__ = ["MissionEnd"]

_COMPLETE = 5  # MISSION_STATE_COMPLETE
_REPEATS_S = 12.0
"""PX4 reports an item ten times more, once a second; after a change that may be one of the old list."""
_FINISHED = re.compile(r"Mission (?:finished|complete)", re.IGNORECASE)


class MissionEnd:
    """Sees the end of a mission in what the vehicle tells; `pilot` is told of it, `failures` of troubles."""

    def __init__(self, contact: Contact, changes: MissionChanges) -> None:
        self.pilot, self.failures = PilotWatch(), FailureWatch()
        self.is_complete = False  # Whether the vehicle told last that its mission is complete
        # A text said so, whatever list was on its way to the vehicle.
        self.says_finished = False
        self._contact, self._monitor, self._changes = contact, contact.monitor, changes
        self._progress = ""

    @property
    def flies_home(self) -> bool:
        """Whether no waypoint is left of the mission."""
        item = self._monitor.state.item
        return self.pilot.mission_over or item is None or not self._leads_on(item)

    def _leads_on(self, item: int) -> bool:
        return leads_on(self._changes.held.items, item)

    def on_mission_current(
        self, message: m.MAVLink_mission_current_message, now_s: float, *, flies_mission: bool
    ) -> None:
        """Take the mission's state; after a landing ArduPilot always says that it is complete."""
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
        """Note that the last item that is flown to was reached; PX4 says so before it names the next one."""
        if now_s > self._changes.changed_s + _REPEATS_S:
            item = message.seq - self._contact.profile.home_at_zero
            if 0 <= item < len(self._changes.held.items) and not self._leads_on(item + 1):
                self.pilot.on_mission_end(now_s)

    def on_text(self, message: m.MAVLink_statustext_message, now_s: float) -> None:
        """Take a text of the flight: it says when it leaves its mission because that is flown."""
        if _FINISHED.match(message.text):
            self.pilot.on_mission_end(now_s)
            self.says_finished = True

    @property
    def ends_flight(self) -> bool:
        """Whether a complete mission ends the flight; otherwise an armed vehicle is on its way home."""
        items, kind = self._changes.held.items, self._monitor.vehicle_type
        # It stands at home and stays armed; or a wing whose mission ends with a return circles over it.
        lands = any(item.command == Command.NAV_LAND for item in items)
        circles = kind == m.MAV_TYPE_FIXED_WING and not lands
        return not leads_home(items) or kind in self._contact.profile.stays_armed or circles

    def cause(self, texts_before: int) -> tuple[Outcome, str]:
        """Outcome and reason of a flight that ended before its mission was complete."""
        pilot, texts = self.pilot, self._contact.texts
        if pilot.ended_by_restart:
            return Outcome.AUTOPILOT_RESTARTED, pilot.ended_by_restart
        if pilot.ordered is not None and pilot.obeyed:
            return Outcome.INTERRUPTED, f"the operator ordered it to {pilot.ordered.value}"
        cause = self.failures.cause(texts.texts[texts_before:])
        if cause is None and pilot.somebody_else_flies:
            return Outcome.PILOT_TOOK_OVER, pilot.reason
        if cause is None and self.says_finished and pilot.mission_over and not pilot.ended_mission:
            # The state that it tells is that of a mission which came when this one had ended.
            return Outcome.COMPLETED, ""
        return cause or (Outcome.FLIGHT_ABORTED, texts.last_warning(f"disarmed{self._progress}"))

    def completed(self, texts_before: int) -> tuple[Outcome, str]:
        """Outcome and reason of one whose mission is told to be over, as ArduPilot does after any landing."""
        return self.cause(texts_before) if self.pilot.ended_mission else (Outcome.COMPLETED, "")
