"""Vehicles that fly together, from the first heartbeat to the last landing, with decisions on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from functools import partial
from threading import Thread
from typing import Protocol

from geo.processes import interrupts_noted
from mission.ground.arming_gate import Stage
from mission.ground.modes import Maneuver
from mission.ground.station import NotFlyingError
from mission.ground.status_text import NotStartedError, doing, not_started
from mission.outcome import Outcome, Phase
from mission.policies.observation import Event, Status
from sensors.estimation import Evidence
from sim_vehicle.host.simulation import StopReason
from wbf_mission.events import Decided, EventStream, Seen
from wbf_mission.progress import Stopwatch
from wbf_mission.replanning.loop import Answered, DecisionLoop
from wbf_mission.run.flight_events import FlightEvents
from wbf_mission.run.hosting import FlightHost
from wbf_mission.run.orders import IN_FLIGHT, START, Orders, WatchersOrder
from wbf_mission.run.record import Flight
from wbf_mission.run.sortie import Sortie

SLICE_S = 1.0
# Most policies answer within a second; the record is not to wait for one that never does.
LAST_ANSWER_S = 5.0
MOST_AGAIN = 2
"""So often in a row a policy is asked again at once, if its answer came too late; later as it wants to be."""
_OVER = frozenset({Status.PILOTED, Status.RETURNING, Status.ENDED, Status.LOST})
"""After one of these statuses a vehicle flies no answer to an earlier question."""
_ORDERED = "the vehicle was given an order while the policy decided"
_AHEAD_S = 0.02
"""The simulated clock waits for the wall clock when it is so far ahead."""
FLIGHT_LIMIT_FACTOR = 3.0
FLIGHT_LIMIT_EXTRA_S = 600.0
SILENT_FACTOR = 1.5
SILENT_FOR_GOOD_S = 60.0
"""A real vehicle that is silent for so long, and should have landed long ago, is not waited for."""


class OperatorConsole(Protocol):
    """Where somebody stands by while real vehicles fly."""

    def tend(self, flight: JointFlight) -> None:
        """Look after the flight; called every second or so. KeyboardInterrupt leaves the vehicles flying."""

    def goes_on(self, question: str) -> bool | None:
        """Tell whether the battery is changed for another sortie (`question` asks for it).

        Called every second or so until it is: None while that is open, False if nothing more is to be flown.
        """


class JointFlight:
    """Flies sorties together, from the first heartbeat to the last landing.

    Parameters
    ----------
    decisions : DecisionLoop
        Already asked for the first paths.
    offset_s : float
        When the flight begins, in seconds since the beginning of the run.
    pace : float or None
        Simulated seconds per wall second.
    waits_for_decisions : bool
        The vehicles stand still while the policy decides; otherwise it decides in a thread of its own.
    console : OperatorConsole or None
        Who stands by; without, a flight that takes far too long is given up.
    orders : Orders or None
        What who watches orders.
    """

    def __init__(
        self,
        sorties: Sequence[Sortie],
        decisions: DecisionLoop,
        evidence: Evidence,
        host: FlightHost,
        *,
        expected_s: float,
        offset_s: float = 0.0,
        pace: float | None = None,
        waits_for_decisions: bool = True,
        console: OperatorConsole | None = None,
        orders: Orders | None = None,
        events: EventStream,
        watch: Stopwatch,
    ) -> None:
        self.sorties = tuple(sorties)
        self._decisions = decisions
        self._evidence = evidence
        self._offset_s = offset_s
        self._pace = pace
        self._waits_for_decisions = waits_for_decisions
        self._console = console
        self._orders = orders
        self._events, self._watch = events, watch
        self._told = FlightEvents(events, self.sorties, offset_s)
        self._host = host
        for sortie in self.sorties:
            sortie.send = partial(host.send, sortie.ground)
        self._gates = [
            (one, one.ground.arming_gate) for one in self.sorties if one.ground.arming_gate is not None
        ]
        if len(self.sorties) > 1:
            for _, gate in self._gates:
                gate.hold()
        self._begun_s: float | None = None
        self._expected_s = expected_s
        self._event: Event | None = None
        # The answer that a policy works on beside a real flight, and why some vehicles will not fly it
        self._thinking: Future[Answered] | None = None
        self._not_sent: dict[int, str] = {}
        self._again = 0  # How many answers in a row came too late
        self._begun_wall_s = 0.0

    @property
    def now_s(self) -> float:
        """Simulated seconds since the flight's first heartbeat."""
        return self._host.now_s

    @property
    def frames(self) -> int:
        """How many MAVLink frames were sent."""
        return self._host.frames

    def given(self) -> Flight:
        """Return what the flight gave, as it stands; its observations went on as they arrived."""
        return Flight([sortie.record() for sortie in self.sorties], self.now_s, self.frames)

    def maneuver(self, kind: Maneuver, only: Sortie | None = None) -> None:
        """Take every vehicle that is not down out of its mission, or one of them."""
        for sortie in self.sorties if only is None else (only,):
            if not sortie.done:
                sortie.send(sortie.ground.maneuver(kind, self.now_s))
                self._outdate(sortie.system_id, _ORDERED)

    def _obey(self, orders: Orders) -> None:
        """Do what who watches has ordered, and say what may be ordered now."""
        for order in orders.taken():
            for sortie in self.sorties:
                if sortie.done or not order.is_for(sortie.system_id):
                    continue
                at = f"vehicle {sortie.system_id}: " if len(self.sorties) > 1 else ""
                orders.note(f"{at}{order}")
                try:
                    self._carry_out(order, sortie)
                except NotFlyingError as error:
                    orders.warn(f"{at}{error}")
        left = [one for one in self.sorties if not one.done]
        asking = any(gate.stage is Stage.ASKING for one, gate in self._gates if not one.done)
        possible = (START,) * asking + IN_FLIGHT * self._is_flying()
        orders.allow(possible, [one.system_id for one in left])

    def _carry_out(self, order: WatchersOrder, sortie: Sortie) -> None:
        """Do what was ordered of a vehicle; NotFlyingError if that cannot be now."""
        ground = sortie.ground
        if order.order == START:
            if ground.arming_gate is None or ground.arming_gate.stage is not Stage.ASKING:
                msg = "it does not wait for a start"
                raise NotFlyingError(msg)
            ground.arming_gate.agree()
            return
        command = order.command
        if command.order == "set-item":
            sortie.send(ground.choose_item(command.item, self.now_s))
            self._outdate(sortie.system_id, _ORDERED)
        else:
            self.maneuver(Maneuver(command.order), sortie)
        sortie.ordered.append(f"{order.order} {order.value}".rstrip() + f" at {ground.flight_time_s:.0f} s")

    def _let_start(self) -> None:
        """Let real vehicles start together once all that are left can, each by its delay after the first."""
        left = [(sortie, gate) for sortie, gate in self._gates if not sortie.done]
        if self._begun_s is None:
            if not left or not all(
                sortie.ground.phase is Phase.READY and gate.stage is Stage.WAITING for sortie, gate in left
            ):
                return
            self._begun_s = self.now_s
        for sortie, gate in left:
            if self.now_s >= self._begun_s + sortie.start_delay_s:
                gate.release()

    def fly(self) -> None:
        """Fly until every vehicle is down; a KeyboardInterrupt comes between slices: `interrupt` follows."""
        try:
            if self._console is not None:
                # Who stands by asks for signals, and what they are to mean.
                self._fly(lambda: None)
                return
            with interrupts_noted() as answer_interrupt:
                self._fly(answer_interrupt)
        finally:
            if self._orders is not None:
                self._orders.allow((), ())

    def _fly(self, answer_interrupt: Callable[[], None]) -> None:
        limit_s = FLIGHT_LIMIT_FACTOR * self._expected_s + FLIGHT_LIMIT_EXTRA_S
        self._begun_wall_s = time.perf_counter()
        while not self._is_over():
            answer_interrupt()
            stop = self._host.run(until=self._stops, limit_s=SLICE_S)
            self._watch.lap("flight")
            self._keep_pace()
            if self._orders is not None:
                self._obey(self._orders)
            if self._console is not None:
                self._console.tend(self)
                self._let_start()
                self._give_up_silent()
            elif self.now_s > limit_s or stop in (StopReason.IDLE, StopReason.STALLED):
                self._give_up()
            self.learn()
            for sortie in self.sorties:
                sortie.note_changes()
                sortie.give_up_lost(self.now_s)
            if self._thinking is not None:
                self._look_at_answer(self._thinking)
            if self._thinking is None:
                self._decide()
            if self._is_flying():
                longest_s = max(sortie.ground.flight_time_s for sortie in self.sorties)
                self._events.progress("flying", longest_s, self._expected_s)
        self._await_answer()
        self._told.finish(self.now_s)

    def interrupt(self) -> None:
        """Stop where we are; what was seen so far is kept."""
        left = {one.system_id: not_started(one.ground) for one in self.sorties}
        if self._console is not None and all(one.ground.started_s is None for one in self.sorties):
            told = {number: text for number, text in left.items() if text is not None}
            several = len(self.sorties) > 1 and len(set(told.values())) > 1
            if told:
                texts = [f"vehicle {number}: {text}" for number, text in told.items()]
                msg = "interrupted: " + ("; ".join(texts) if several else next(iter(told.values())))
                raise NotStartedError(msg)
        for sortie in self.sorties:
            why = f"stopped after {self.now_s:.0f} simulated seconds"
            if self._console is not None:
                seconds = sortie.ground.flight_time_s
                flew = f"left as it flew after {seconds:.0f} s: {doing(sortie.ground, self.now_s)}"
                why = left[sortie.system_id] or flew
            sortie.ground.interrupt(Outcome.INTERRUPTED, why, self.now_s)
        self._await_answer()
        self._told.finish(self.now_s)

    def learn(self) -> None:
        """Hand on what was seen since the last call."""
        for sortie in self.sorties:
            seen = sortie.take()
            if len(seen) and self._events.wants(Seen):
                self._events.tell(Seen(self._offset_s, seen))
            self._evidence.add(seen, offset_s=self._offset_s)
        self._watch.lap("estimate and score")

    @property
    def _mission_s(self) -> float:
        """Seconds since the first vehicle's mission began; 0 before."""
        started = [one.ground.started_s for one in self.sorties if one.ground.started_s is not None]
        return self.now_s - min(started) if started else 0.0

    def _stops(self, _now_s: float) -> bool:
        """Return whether there is something to do before the slice is over."""
        self._told.tell(self.now_s)
        self._keep_pace()
        if self._orders is not None and self._orders.waits:
            return True
        if self._thinking is not None:
            return self._thinking.done() or self._is_over()
        # Before and after the flight nobody is asked: to stop for that again and again would stop the time.
        if not self._decisions.asks_on_the_way or not self._is_flying():
            return self._is_over()
        mission_s = self._mission_s
        if not self._decisions.is_early(mission_s):
            waiting = sum(sortie.assembler.waiting for sortie in self.sorties)
            self._event = self._decisions.due(self.sorties, mission_s, len(self._evidence) + waiting)
        # A vehicle whose clock runs faster than ours reaches the end of its path within a slice.
        if self._event is None and self._console is not None and self._is_ending():
            self._event = Event.ENDING
        return self._event is not None or self._is_over()

    def _decide(self) -> None:
        event, self._event = self._event, None
        if event is None and self._is_ending():
            event = Event.ENDING
        if self._decisions.lost(self.sorties, self.now_s):
            event = Event.LOST
        if event is not None and self._is_flying():
            # What a policy sees beside the flight is fixed here and its own: its thread may outlive the
            # flight, and must then meet neither the estimator nor what is learned meanwhile. Only ordered
            # here, it is made in the estimate's thread: that takes seconds on large farms, in which
            # heartbeats would be missing.
            model = None if self._waits_for_decisions else self._evidence.snapshot()
            question = self._decisions.question(event, self.sorties, self._mission_s, self.now_s, model)
            if self._waits_for_decisions:
                self._carry_out_answer(self._decisions.answer(question))
            else:
                statuses = {sortie.system_id: sortie.status(self.now_s) for sortie in self.sorties}
                self._not_sent = {number: one.value for number, one in statuses.items() if one in _OVER}
                self._thinking = _beside(partial(self._decisions.answer, question))

    def _look_at_answer(self, thinking: Future[Answered]) -> None:
        """Send the answer once it is there, to vehicles that can still fly it.

        A policy that decides cannot be asked for another reason. The operator hears at once of vehicles that
        are lost, taken over or on their way home meanwhile, whether it ever answers or not.
        """
        for sortie in self.sorties:
            if (status := sortie.status(self.now_s)) in _OVER:
                self._outdate(sortie.system_id, f"the vehicle was {status.value} while the policy decided")
        if thinking.done():
            answered = thinking.result()
            outdated = self._decisions.outdated(answered, self.sorties, self.now_s)
            for system_id, why in outdated.items():
                self._outdate(system_id, why)
            self._thinking = None
            self._carry_out_answer(answered)

    def _outdate(self, system_id: int, why: str) -> None:
        """Discard the pending answer for a vehicle, and say so."""
        if self._thinking is not None and system_id not in self._not_sent:
            self._not_sent[system_id] = why
            at = f"vehicle {system_id}: " if len(self.sorties) > 1 else ""
            self._events.warn(f"{at}the policy's answer is not sent: {why}")

    def _carry_out_answer(self, answered: Answered) -> None:
        record = self._decisions.carry_out(answered, self.sorties, self.now_s, self._not_sent)
        if record is not None:
            self._events.tell(Decided(self._offset_s + self.now_s, record, self._decisions.acquisition))
            is_late = any(change.system_id in self._not_sent for change in record.changes)
            self._again = self._again + 1 if is_late else 0
            if 0 < self._again <= MOST_AGAIN:
                self._event = Event(record.event)
        self._watch.lap("decide")

    def _await_answer(self) -> None:
        """Wait some seconds for the policy to end, drop its answer, and learn the rest."""
        if self._thinking is not None:
            thinking, self._thinking = self._thinking, None
            if wait([thinking], LAST_ANSWER_S).not_done:
                # Its thread ends with the program. Nobody takes its answer.
                text = f"the policy has not answered within {LAST_ANSWER_S:g} s of the end: it is left behind"
                self._events.warn(text)
            elif (error := thinking.exception()) is not None:
                raise error
        self.learn()

    def _is_ending(self) -> bool:
        """Return whether a path is about to end; True once for each."""
        return self._decisions.ending(self.sorties, self.now_s)

    def _is_flying(self) -> bool:
        for sortie in self.sorties:  # noqa: SIM110
            if sortie.ground.phase is Phase.FLIGHT:
                return True
        return False

    def _is_over(self) -> bool:
        # Loops here and above: they are asked at each step of the vehicles, and `all` would make a generator.
        for sortie in self.sorties:  # noqa: SIM110
            if not sortie.done:
                return False
        return True

    def _give_up(self) -> None:
        for sortie in self.sorties:
            phase = sortie.ground.phase
            why = f"not over after {self.now_s:.0f} simulated seconds ({phase.value})"
            sortie.ground.interrupt(Outcome.TIME_LIMIT, why, self.now_s)

    def _give_up_silent(self) -> None:
        """End the flight of a real vehicle that nobody has heard of for longer than it can fly."""
        for sortie in self.sorties:
            ground = sortie.ground
            if ground.phase is not Phase.FLIGHT or ground.started_s is None:
                continue
            silent_s = self.now_s - ground.link.heard_s
            flown_s = self.now_s - ground.started_s
            if (
                silent_s > SILENT_FOR_GOOD_S
                and flown_s > SILENT_FACTOR * self._expected_s + SILENT_FOR_GOOD_S
            ):
                why = (
                    f"nothing was heard of the vehicle for {silent_s:.0f} s; "
                    f"its flight was to take {self._expected_s:.0f} s"
                )
                ground.interrupt(Outcome.NO_ANSWER, why, self.now_s)

    def _keep_pace(self) -> None:
        """Wait for the wall clock where the simulated one is ahead of it."""
        if self._pace is None:
            return
        ahead_s = self.now_s / self._pace - (time.perf_counter() - self._begun_wall_s)
        if ahead_s > _AHEAD_S:
            self._watch.lap("flight")
            time.sleep(ahead_s)
            self._watch.lap("waiting")


def _beside(work: Callable[[], Answered]) -> Future[Answered]:
    """Begin work in a thread that does not keep the program from ending."""
    future: Future[Answered] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, name="policy", daemon=True).start()
    return future
