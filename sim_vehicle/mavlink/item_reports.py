"""MISSION_ITEM_REACHED as each autopilot tells it: which items, and how often."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from sim_vehicle.component import NEVER
from sim_vehicle.execution.state import FlightEvent, ItemReached

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile

__all__ = ["ItemReports"]

_REPEAT_S = 1.0


class ItemReports:
    """Tells that items were reached.

    Parameters
    ----------
    profile : MavlinkProfile
        Whether items that end together are merged, and how often a report is repeated.
    """

    def __init__(self, profile: MavlinkProfile) -> None:
        self._merges = profile.reached_merged
        self._repeats = profile.reached_repeats
        self._returning = -1
        self._latest: tuple[int, int, float] | None = None

    def restart(self) -> None:
        """Begin with another mission."""
        self._returning = -1

    def merged(self, events: list[FlightEvent], items: Sequence[MissionItem]) -> list[FlightEvent]:
        """Keep of items that ended together the last, where the autopilot tells no more.

        A return that follows counts as reached already.
        """
        if not self._merges:
            return events
        last = {event.time_s: event for event in events if isinstance(event, ItemReached)}
        kept: list[FlightEvent] = []
        for event in events:
            if not isinstance(event, ItemReached):
                kept.append(event)
            elif event.seq == self._returning:
                self._returning = -1
            elif last[event.time_s] is event:
                following = event.seq + 1
                if following < len(items) and items[following].command == Command.NAV_RETURN_TO_LAUNCH:
                    self._returning = following
                    kept.append(replace(event, seq=following))
                else:
                    kept.append(event)
        return kept

    def report(self, wire_seq: int, now_s: float) -> Message:
        """Report an item by its number on the wire; `repeat` tells it again."""
        self._latest = (wire_seq, self._repeats, now_s + _REPEAT_S) if self._repeats else None
        return m.MAVLink_mission_item_reached_message(wire_seq)

    def repeat(self, now_s: float) -> list[Message]:
        """The latest report again, where it is due."""
        if self._latest is None or self._latest[2] > now_s:
            return []
        seq, left, due_s = self._latest
        self._latest = (seq, left - 1, due_s + _REPEAT_S) if left > 1 else None
        return [m.MAVLink_mission_item_reached_message(seq)]

    def next_deadline(self) -> float:
        """When `repeat` has something to do."""
        return NEVER if self._latest is None else self._latest[2]
