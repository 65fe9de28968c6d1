"""Events of a flight, made from the telemetry that its ground stations receive."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from mission.ground.texts import WHOLE_S
from mission.model import Mission
from wbf_mission.events import EventStream, Planned, VehicleMoved, VehicleSaid
from wbf_mission.run.sortie import Sortie

_LEAST_S, _MOST_S = 0.1, 1.0
"""Interval between two states of a vehicle: 0.1 s of flight and of wall time, but at most 1 s of flight."""
_LEAST_WALL_S = 0.06
"""Least wall time between two states; below 0.1 s, because steps in real time may come slightly early."""


class FlightEvents:
    """Emits states, texts and plans of a flight's vehicles; the flight begins at `offset_s` of the run."""

    def __init__(self, events: EventStream, sorties: Sequence[Sortie], offset_s: float) -> None:
        self._events = events
        self._sorties = sorties
        self._offset_s = offset_s
        self._wanted = events.wants(VehicleMoved)
        self._next_s, self._wall_s = 0.0, -math.inf
        self._texts = dict.fromkeys(range(len(sorties)), 0)
        self._missions: dict[int, Mission] = {}

    def tell(self, now_s: float) -> None:
        """Emit the events that are due; called at each step of the simulation or host."""
        if not self._wanted or now_s < self._next_s:
            return
        wall_s = time.monotonic()
        if wall_s - self._wall_s < _LEAST_WALL_S and now_s < self._next_s + _MOST_S - _LEAST_S:
            return
        self._next_s, self._wall_s = now_s + _LEAST_S, wall_s
        self._tell(now_s, now_s - WHOLE_S)

    def finish(self, now_s: float) -> None:
        """Emit the remaining events at the flight's end."""
        if self._wanted:
            self._tell(now_s, math.inf)

    def _tell(self, now_s: float, texts_until_s: float) -> None:
        for place, sortie in enumerate(self._sorties):
            self._tell_plan(place, sortie, now_s)
            self._tell_state(sortie, now_s)
            said, self._texts[place] = sortie.ground.text_log.begun_until(self._texts[place], texts_until_s)
            for time_s, severity, text in said:
                self._events.tell(VehicleSaid(self._offset_s + time_s, sortie.system_id, severity, text))

    def _tell_plan(self, place: int, sortie: Sortie, now_s: float) -> None:
        mission, number = sortie.ground.mission, sortie.number
        if self._missions.get(place) is mission:
            return
        first = place not in self._missions
        self._missions[place] = mission
        plan = sortie.plan
        self._events.tell(
            Planned(
                self._offset_s + now_s,
                number.day,
                number.flight,
                number.system_id,
                mission,
                plan.path_m if first else sortie.path_m,
                duration_s=plan.prediction.duration_s if first else None,
                length_m=plan.length_m if first else None,
                coverage=plan.coverage if first else None,
            )
        )

    def _tell_state(self, sortie: Sortie, now_s: float) -> None:
        ground, number = sortie.ground, sortie.number
        state = ground.vehicle_state
        if state.heard_s == -math.inf:
            return
        self._events.tell(
            VehicleMoved.of(
                state,
                sortie.plan.farm.frame,
                (self._offset_s + now_s, number.day, number.flight, number.system_id),
                mode=ground.mode,
                phase=ground.phase.value,
                link_quality=ground.link.quality if ground.arming_gate is not None else None,
                silent_s=max(0.0, now_s - state.heard_s),
            )
        )
