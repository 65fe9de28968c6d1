"""Operator console: the terminal during the flight of real vehicles."""

from __future__ import annotations

import math
import os
import re
import select
import sys
from collections import Counter
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from contextlib import suppress
from typing import TYPE_CHECKING

from geo.system import steady_s
from geo.texts import distance
from mission.ground.arming_gate import Stage, Standstill
from mission.ground.modes import Maneuver
from mission.ground.orders import NotFlyingError
from mission.ground.status_text import doing, lost_position
from mission.outcome import Phase, in_words
from sim_vehicle.mavlink.fleet import SPACING_M
from wbf_mission.cli import signals
from wbf_mission.cli.output import Output
from wbf_mission.events import Asked

if TYPE_CHECKING:
    from wbf_mission.run.joint_flight import JointFlight
    from wbf_mission.run.orders import Orders
    from wbf_mission.run.sortie import Sortie

_STATUS_S = 5.0
_SILENCE_S = 5.0
_OBEYS_S = 5.0
_APART_M = 0.5 * SPACING_M
"""Distance between vehicles on the ground below which the console warns (m)."""
_STARTING = (Phase.ARM, Phase.START)
_ABLE = (Stage.ASKING, Stage.WAITING)
_QUESTION = "[h]old, [r]eturn, [l]eave it flying, [c]ontinue? Press Ctrl-C again to leave it flying"
_QUESTION_OF_ALL = (
    "all: [h]old, [r]eturn, [l]eave them flying, [c]ontinue; add a number for one vehicle, such as r{number}?"
    " Press Ctrl-C again to leave them flying"
)
_ANSWER = re.compile(r"([hrlc])[a-z]*\s*(\d*)")
_CHOICES = {"h": Maneuver.HOLD, "r": Maneuver.RETURN}
# Answers on a page, each with the answer at the terminal that means the same. A page cannot give the answer
# that starts motors: for that it needs a confirmed order.
_START = {"do not start": "n"}
_STOP = {"hold": "h", "return": "r", "continue": "c"}
_BATTERY = {"battery changed": "\n", "no more": "q"}


class _Vehicle:
    """State of one vehicle on the console: texts and events already printed, and the last order.

    If the vehicle is `alone` (no other vehicle flies), lines do not begin with the vehicle's number.
    """

    def __init__(self, sortie: Sortie, output: Output, *, alone: bool) -> None:
        self.sortie = sortie
        self.who = "the vehicle" if alone else f"vehicle {sortie.system_id}"
        self.at = "" if alone else f"{self.who}: "
        self._output = output
        self._texts = self._events = self._set = 0
        self._phase: Phase | None = None
        self._status_s = 0.0
        self._can_start = alone
        self._silent = self._distance_checked = False
        self._ordered: Maneuver | None = None
        self._ordered_s: float | None = None

    @property
    def waits_for_consent(self) -> bool:
        """Whether the vehicle is ready, and waits only for the operator's consent to start."""
        ground = self.sortie.ground
        return (
            ground.phase is Phase.READY
            and ground.arming_gate is not None
            and ground.arming_gate.stage is Stage.ASKING
        )

    def report(self, now_s: float) -> None:
        """Print changes since the last report."""
        ground = self.sortie.ground
        if ground.phase is not self._phase:
            self._phase = ground.phase
            self._output.note(self.at + ground.phase.value)
            if ground.phase is Phase.DONE and self.at:
                self._output.note(self.at + in_words(ground.outcome, ground.reason))
        self._report_silence(now_s)
        # ArduPilot repeats two texts for each item of a changed mission.
        said, self._texts = ground.text_log.begun_until(self._texts)
        for text, times in Counter(text for _, _, text in said).items():
            often = f" ({times} times)" * (times > 1)
            self._output.note(f"{self.who.removeprefix('the ')}: {text}{often}", publish=False)
        for _, event in ground.pilot.events[self._events :]:
            waits = "; this program gives no orders until the vehicle is back in its mission"
            self._output.warn(f"{self.who}: {event}{waits * ground.pilot.somebody_else_flies}")
        self._events = len(ground.pilot.events)
        for text in ground.parameters_set[self._set :]:
            self._output.warn(f"{self.at}parameter {text}")
        self._set = len(ground.parameters_set)
        gate = ground.arming_gate
        able = ground.phase is Phase.READY and gate is not None and gate.stage in _ABLE
        if able and not self._can_start:
            self._can_start = True
            self._output.note(f"{self.at}it can arm; all vehicles start together")
        if ground.phase is Phase.FLIGHT and now_s >= self._status_s + _STATUS_S:
            self._status_s = now_s
            self._output.note(self.at + status_line(self.sortie, now_s), publish=False)
        self._report_obedience(now_s)

    def warn_if_near(self, others: Sequence[_Vehicle]) -> None:
        """Warn once if another vehicle stands too near for this vehicle to climb and land vertically."""
        state, frame = self.sortie.ground.vehicle_state, self.sortie.plan.farm.frame
        if self._distance_checked or self.sortie.ground.phase is not Phase.READY or math.isinf(state.heard_s):
            return
        self._distance_checked = True
        here = state.position_m(frame)
        for other in others:
            theirs = other.sortie.ground.vehicle_state
            if math.isinf(theirs.heard_s):
                continue
            apart_m = math.dist(here, theirs.position_m(frame))
            if apart_m < _APART_M:
                latitude, longitude = frame.to_wgs84(*self.sortie.task.request.start_xy_m)
                place = f"{latitude:.6f}, {longitude:.6f}"
                self._output.warn(
                    f"{self.at}it stands {distance(apart_m)} from {other.who}; its plan starts at {place}"
                )

    def order(self, flight: JointFlight, kind: Maneuver) -> None:
        """Order the vehicle to leave its mission; if the vehicle has not started yet, refuse the start."""
        ground = self.sortie.ground
        if ground.phase in (Phase.MODE, Phase.READY) and ground.arming_gate is not None:
            ground.arming_gate.refuse()
            return
        try:
            flight.maneuver(kind, self.sortie)
            self._ordered, self._ordered_s = kind, flight.now_s
            self._output.note(f"{self.at}ordered: {kind.value}")
        except NotFlyingError as error:
            self._output.warn(f"{self.at}{error}")

    def _report_obedience(self, now_s: float) -> None:
        """Print whether the vehicle's telemetry shows that it obeys the last order."""
        ground, pilot = self.sortie.ground, self.sortie.ground.pilot
        if pilot.ordered not in (None, self._ordered):
            self._ordered, self._ordered_s = pilot.ordered, now_s
        ordered_s = self._ordered_s
        if ordered_s is None:
            return
        if pilot.ordered is None and self._ordered is Maneuver.RESUME:
            self._output.note(f"{self.who} continues its mission: {doing(ground, now_s)}")
            self._ordered = None
        elif pilot.obeyed:
            self._output.note(f"{self.who} {pilot.obeyed}")
        elif ground.phase is not Phase.FLIGHT:
            self._output.warn(f"{self.at}the flight was over before the vehicle had obeyed")
        elif pilot.ordered is None:
            flies = "may fly on" if self._silent else "flies on"
            self._output.warn(f"{self.who} {flies}: {doing(ground, now_s)}")
        elif now_s - ordered_s > _OBEYS_S + 4.0 * (ground.link.round_trip.known_s or 0.0):
            seen = doing(ground, now_s)
            self._output.warn(
                f"{self.at}{pilot.ordered.value} was ordered, but the telemetry does not confirm it: {seen}"
            )
        else:
            return
        self._ordered_s = None

    def _report_silence(self, now_s: float) -> None:
        ground = self.sortie.ground
        heard_s = ground.link.heard_s
        silent = heard_s > float("-inf") and now_s - heard_s > _SILENCE_S and not self.sortie.done
        if silent != self._silent:
            self._silent = silent
            if silent:
                flies = ground.phase is Phase.FLIGHT and not ground.pilot.taken_out
                goes_on = "; by its plan, it continues the flight" * flies
                self._output.warn(f"nothing is heard of {self.who}{goes_on}")
            elif not self.sortie.done:
                self._output.warn(f"{self.who} is heard again")


class TerminalConsole:
    """Console that shows the flight, and asks the operator before the start and after Ctrl-C.

    With `orders`, a page may answer as well, but its answers cannot start the vehicles or leave them flying.
    """

    def __init__(self, output: Output, orders: Orders | None = None) -> None:
        self._output, self._orders = output, orders
        self._words: dict[str, str] = {}
        self._vehicles: list[_Vehicle] = []
        self._asked = False
        self._stopping = False
        self._question_between = ""
        self._standstill = Standstill(steady_s)

    def tend(self, flight: JointFlight) -> None:
        """Print changes, and handle signals and answers."""
        if (stood_s := self._standstill.look()) and self._words and sys.stdin.isatty():
            discard_typed()
            self._output.warn(f"the program stood still for {stood_s:.0f} s: text typed before is discarded")
            self._asked = False
            if self._stopping:
                self._output.note(self._question)
        if [vehicle.sortie for vehicle in self._vehicles] != list(flight.sorties):
            self._asked = self._stopping = False
            alone = len(flight.sorties) == 1
            self._vehicles = [_Vehicle(sortie, self._output, alone=alone) for sortie in flight.sorties]
        phases = {sortie.ground.phase for sortie in flight.sorties}
        signals.defer(phases != {Phase.DONE})
        if signals.came() and not self._stopping:
            self._on_signal(phases, flight.now_s)
        for k, vehicle in enumerate(self._vehicles):
            vehicle.report(flight.now_s)
            vehicle.warn_if_near(self._vehicles[:k])
        remaining = [vehicle for vehicle in self._vehicles if not vehicle.sortie.done]
        if self._asked or (remaining and all(vehicle.waits_for_consent for vehicle in remaining)):
            self._prepare(remaining)
        if self._stopping:
            self._take_choice(flight)
        self._output.show_bars(not self._stopping and phases.isdisjoint((Phase.MODE, Phase.READY)))

    def goes_on(self, question: str) -> bool | None:
        """Ask once for a battery change; return the answer (False at the end of the input), or None."""
        if question != self._question_between:
            self._question_between = question
            self._make_room()
            self._output.note(question)
            self._ask(question, _BATTERY)
        answer = self._answer()
        if answer is None:
            return None
        self._ask("", {})
        return answer.strip().lower() not in ("q", "quit") and answer != ""

    def _make_room(self) -> None:
        """Prepare the terminal for a new question, before its text is printed."""
        self._output.show_bars(False)
        discard_typed()

    def _ask(self, question: str, words: dict[str, str]) -> None:
        """Publish a question to the page; `words` maps the page's answers to the terminal's answers."""
        self._words = words
        if self._orders is not None:
            self._orders.ask(question, tuple(words))
        else:
            self._output.events.tell(Asked(question))

    def _answer(self) -> str | None:
        """Return the answer from the terminal or the page; None while there is no answer.

        At the end of the input, the answer is empty. With a page, piped input is ignored.
        """
        answer = None
        if self._orders is None or sys.stdin.isatty():
            answer = _line()
        if answer is None and self._orders is not None:
            said = self._orders.answered()
            if said is not None:
                self._output.note(f"answered by the page: {said}")
                answer = self._words[said]
        return answer

    @property
    def _question(self) -> str:
        if len(self._vehicles) == 1:
            return _QUESTION
        return _QUESTION_OF_ALL.format(number=self._vehicles[-1].sortie.system_id)

    def _on_signal(self, phases: AbstractSet[Phase], now_s: float) -> None:
        """Ask what to order; raise KeyboardInterrupt before the flight or without a terminal."""
        if not phases.isdisjoint(_STARTING) and sys.stdin.isatty():
            return  # while a vehicle starts, the question waits until it has started, or has not
        if Phase.FLIGHT not in phases or not sys.stdin.isatty():
            signals.defer(False)
            raise KeyboardInterrupt
        self._stopping = True
        self._make_room()
        for vehicle in self._vehicles:
            ground = vehicle.sortie.ground
            home = " (it has flown all waypoints, and is on its way home)" * ground.flies_home
            if ground.phase is Phase.FLIGHT:
                self._output.note(f"{vehicle.at}{doing(ground, now_s)}{home}")
        self._output.note(self._question)
        self._ask(self._question, _STOP)

    def _prepare(self, remaining: Sequence[_Vehicle]) -> None:
        """Ask for consent to start, and pass the answer to the vehicles."""
        if not any(vehicle.waits_for_consent for vehicle in remaining):
            if self._words is _START:
                # A page has started the vehicles, so the question is withdrawn.
                self._ask("", {})
            return
        if not self._asked:
            self._asked = True
            self._make_room()
            plans = [(vehicle.at, _planned(vehicle.sortie)) for vehicle in remaining]
            if len(self._vehicles) == 1:
                self._output.note(f"ready: {plans[0][1]}; start the motors? [y/N]", publish=False)
            else:
                for at, plan in plans:
                    self._output.note(f"{at}ready: {plan}")
                which = ", ".join(str(vehicle.sortie.system_id) for vehicle in remaining)
                self._output.note(f"start the motors of vehicles {which}? [y/N]", publish=False)
            self._ask("; ".join(at + "ready: " + plan for at, plan in plans) + "; start the motors?", _START)
        answer = self._answer()
        if answer is not None:
            self._asked = False  # after a refusal to arm, the vehicle waits for consent again
            self._ask("", {})
            for vehicle in remaining:
                gate = vehicle.sortie.ground.arming_gate
                assert gate is not None
                gate.agree() if answer.strip().lower() in ("y", "yes") else gate.refuse()

    def _take_choice(self, flight: JointFlight) -> None:
        answer = self._answer()
        if answer is None:
            return
        match = _ANSWER.fullmatch(answer.strip().lower())
        choice, number = match.groups() if match is not None else ("", "")
        named = [vehicle for vehicle in self._vehicles if number in ("", str(vehicle.sortie.system_id))]
        if choice == "l" and not number:
            signals.defer(False)
            raise KeyboardInterrupt
        if choice in _CHOICES and named:
            for vehicle in named:
                if number or not vehicle.sortie.done:
                    vehicle.order(flight, _CHOICES[choice])
        elif choice != "c" or number:
            self._output.note(self._question)
            return
        self._stopping = False
        self._ask("", {})
        signals.forget()


def _planned(sortie: Sortie) -> str:
    """Return the prediction of the planned flight, in words."""
    prediction = sortie.plan.prediction
    if not prediction.feasible:
        return f"the predicted flight FAILS after {prediction.duration_s:.0f} s: {prediction.reason}"
    height_m = sortie.task.builder.level.altitude_m
    return f"{distance(prediction.ground_length_m)}, {prediction.duration_s:.0f} s at {height_m:g} m"


def status_line(sortie: Sortie, now_s: float) -> str:
    """Return a flying vehicle's state in one line, with the age of an old state; an old speed is "-"."""
    ground, state = sortie.ground, sortie.ground.vehicle_state
    remaining = state.battery.remaining
    parts = [
        doing(ground, now_s),
        "speed -" if lost_position(ground) else f"{state.ground_speed_m_s:.1f} m/s",
        "battery -" if remaining is None else f"battery {remaining:.0%}",
        f"{sortie.assembler.statistics.images} images",
        ground.link.brief(),
    ]
    return ", ".join(parts)


def discard_typed() -> None:
    """Discard text that was typed at the terminal before a question: it does not answer the question."""
    if not sys.stdin.isatty():
        return
    if sys.platform == "win32":
        import msvcrt

        while msvcrt.kbhit():
            msvcrt.getwch()
        return
    import termios

    terminal = sys.stdin.fileno()
    with suppress(OSError):  # The terminal may be another program's.
        if os.tcgetpgrp(terminal) != os.getpgrp():
            return  # The text is for another program, and a flush would stop this program.
    with suppress(termios.error):
        termios.tcflush(terminal, termios.TCIFLUSH)


def _line() -> str | None:
    """Return a typed line; None before a line is typed, an empty text at the end of the input."""
    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return sys.stdin.readline() if ready else None
