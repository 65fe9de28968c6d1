"""The operator at the terminal while a real vehicle flies."""

from __future__ import annotations

import select
import sys
from typing import TYPE_CHECKING

from wbf_mission.cli import signals
from wbf_mission.cli.output import Output, distance
from wbf_mission.ground.clearance import Stage
from wbf_mission.ground.modes import Maneuver
from wbf_mission.ground.station import NotFlyingError
from wbf_mission.ground.telling import doing
from wbf_mission.outcome import Phase

if TYPE_CHECKING:
    from wbf_mission.joint_flight import JointFlight
    from wbf_mission.sortie import Sortie

__all__ = ["Operator"]

_STATUS_S = 5.0
_SILENCE_S = 5.0
_OBEYS_S = 5.0
_STARTING = (Phase.ARM, Phase.START)
_QUESTION = "[h]old, [r]eturn, [l]eave it flying, [c]ontinue? Ctrl-C again leaves it flying"
_CHOICES = {"h": Maneuver.HOLD, "r": Maneuver.RETURN}


class Operator:
    """Shows how the flight goes, asks before the start, and asks what Ctrl-C means.

    Parameters
    ----------
    output : Output
    """

    def __init__(self, output: Output) -> None:
        self._output = output
        self._texts = self._events = self._set = 0
        self._phase: Phase | None = None
        self._status_s = 0.0
        self._asked = False
        self._stopping = False
        self._silent = False
        self._ordered_s: float | None = None

    def tend(self, flight: JointFlight) -> None:
        """Tell what is new, and take an answer if there is one."""
        (sortie,) = flight.sorties
        ground = sortie.ground
        signals.defer(ground.phase is not Phase.DONE)
        if signals.came() and not self._stopping:
            self._on_signal(sortie, flight.now_s)
        if ground.phase is not self._phase:
            self._phase = ground.phase
            self._output.note(ground.phase.value)
        self._tell_silence(sortie, flight.now_s)
        for _, _, text in ground.texts[self._texts :]:
            self._output.note(f"vehicle: {text}")
        self._texts = len(ground.texts)
        for _, event in ground.pilot.events[self._events :]:
            waits = "; nothing is ordered until it is back in its mission"
            self._output.warn(f"the vehicle: {event}{waits * ground.pilot.somebody_else_flies}")
        self._events = len(ground.pilot.events)
        for text in ground.parameters_set[self._set :]:
            self._output.warn(f"parameter {text}")
        self._set = len(ground.parameters_set)
        if ground.phase is Phase.READY:
            self._prepare(sortie)
        if ground.phase is Phase.FLIGHT and flight.now_s >= self._status_s + _STATUS_S:
            self._status_s = flight.now_s
            self._output.note(status_line(sortie, flight.now_s))
        self._tell_obedience(sortie, flight.now_s)
        if self._stopping:
            self._take_choice(flight)
        self._output.show_bars(not self._stopping and ground.phase not in (Phase.MODE, Phase.READY))

    def _on_signal(self, sortie: Sortie, now_s: float) -> None:
        """Ask what is to become of the vehicle; before the flight, and without a terminal, just leave."""
        phase = sortie.ground.phase
        if phase in _STARTING and sys.stdin.isatty():
            return  # in a moment it flies, or it does not
        if phase is not Phase.FLIGHT or not sys.stdin.isatty():
            signals.defer(False)
            raise KeyboardInterrupt
        self._stopping = True
        self._output.show_bars(False)
        home = " (all waypoints are flown: it is on its way home)" * sortie.ground.flies_home
        self._output.note(f"{doing(sortie.ground, now_s)}{home}")
        self._output.note(_QUESTION)

    def _tell_obedience(self, sortie: Sortie, now_s: float) -> None:
        """Tell whether the vehicle does what was ordered, by what it shows."""
        ground, ordered_s = sortie.ground, self._ordered_s
        if ordered_s is None:
            return
        pilot = ground.pilot
        if pilot.obeyed:
            self._output.note(f"the vehicle {pilot.obeyed}")
        elif ground.phase is not Phase.FLIGHT:
            self._output.warn("the flight was over before the vehicle had obeyed")
        elif pilot.ordered is None:
            self._output.warn(f"the vehicle flies on: {doing(ground, now_s)}")
        elif now_s - ordered_s > _OBEYS_S + 4.0 * (ground.link.round_trip.known_s or 0.0):
            told = doing(ground, now_s)
            self._output.warn(f"{pilot.ordered.value} was ordered, but the vehicle does not show it: {told}")
        else:
            return
        self._ordered_s = None

    def _prepare(self, sortie: Sortie) -> None:
        """Ask for the start once the vehicle can arm."""
        clearance = sortie.ground.clearance
        assert clearance is not None
        if clearance.stage is not Stage.ASKING:
            return
        if not self._asked:
            self._asked = True
            prediction = sortie.plan.prediction
            height_m = sortie.task.builder.level.altitude_m
            told = (
                f"{distance(prediction.path_length_m)}, {prediction.duration_s:.0f} s at {height_m:g} m"
                if prediction.feasible
                else f"the predicted flight FAILS after {prediction.duration_s:.0f} s: {prediction.reason}"
            )
            self._output.show_bars(False)
            self._output.note(f"ready: {told}; start the motors? [y/N]")
        answer = _line()
        if answer is not None:
            if answer.strip().lower() in ("y", "yes"):
                clearance.agree()
            else:
                clearance.refuse()

    def _take_choice(self, flight: JointFlight) -> None:
        answer = _line()
        if answer is None:
            return
        choice = answer.strip().lower()[:1]
        if choice == "l":
            signals.defer(False)
            raise KeyboardInterrupt
        if choice in _CHOICES:
            try:
                flight.maneuver(_CHOICES[choice])
                self._ordered_s = flight.now_s
                self._output.note(f"ordered: {_CHOICES[choice].value}")
            except NotFlyingError as error:
                self._output.warn(str(error))
        if choice not in ("c", *_CHOICES):
            self._output.note(_QUESTION)
        else:
            self._stopping = False
            signals.forget()

    def _tell_silence(self, sortie: Sortie, now_s: float) -> None:
        heard_s = sortie.ground.link.heard_s
        silent = heard_s > float("-inf") and now_s - heard_s > _SILENCE_S
        if silent != self._silent:
            self._silent = silent
            text = (
                "nothing is heard of the vehicle; by its plan it flies on"
                if silent
                else "the vehicle is heard again"
            )
            self._output.warn(text)


def status_line(sortie: Sortie, now_s: float) -> str:
    """Return what is known of a vehicle in flight, in a line; how old it is when nothing is heard."""
    ground, state = sortie.ground, sortie.ground.vehicle_state
    parts = [
        doing(ground, now_s),
        f"{state.ground_speed_m_s:.1f} m/s",
        "battery -" if state.battery is None else f"battery {state.battery:.0%}",
        f"{sortie.assembler.statistics.images} images",
        ground.link.brief(),
    ]
    return ", ".join(parts)


def _line() -> str | None:
    """Return a line that was typed, None while there is none; the end of the input is an empty one."""
    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return sys.stdin.readline() if ready else None
