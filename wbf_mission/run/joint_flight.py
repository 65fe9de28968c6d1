"""Joint flight of one or more vehicles, with decisions of a policy in flight."""

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
from mission.ground.orders import NotFlyingError
from mission.ground.status_text import NotStartedError, doing, not_started
from mission.outcome import Outcome, Phase
from mission.policies.observation import Event, Status
from sensors.estimation import Evidence
from sim_vehicle.host.simulation import StopReason
from wbf_mission.events import Decided, EventStream, Seen
from wbf_mission.progress import Stopwatch
from wbf_mission.replanning.loop import Answered, DecisionLoop
from wbf_mission.run.flight_events import FlightEvents
from wbf_mission.run.hosting import FlightHost, Hosting
from wbf_mission.run.orders import IN_FLIGHT, START, Orders, WatchersOrder
from wbf_mission.run.record import Flight
from wbf_mission.run.sortie import Sortie

SLICE_S = 1.0
# Longest wait for the last answer (s); most policies answer within a second.
LAST_ANSWER_S = 5.0
MOST_AGAIN = 2
"""Limit of late answers in a row after which a policy is asked again at once, not at its next trigger."""
_OVER = frozenset({Status.PILOTED, Status.RETURNING, Status.ENDED, Status.LOST})
"""Statuses in which a vehicle gets no new path from a pending answer of the policy."""
_ORDERED = "the vehicle was given an order while the policy decided"
_AHEAD_S = 0.02
"""The flight sleeps if the simulated clock is ahead of the wall clock by more than this (s)."""
FLIGHT_LIMIT_FACTOR = 3.0
FLIGHT_LIMIT_EXTRA_S = 600.0
SILENT_FACTOR = 1.5
SILENT_FOR_GOOD_S = 60.0
"""An overdue real vehicle is given up after this silence (s)."""


class OperatorConsole(Protocol):
    """Console of the operator of real vehicles during flights."""

    def tend(self, flight: JointFlight) -> None:
        """Handle the operator's input, about once a second; KeyboardInterrupt leaves the vehicles flying."""

    def goes_on(self, question: str) -> bool | None:
        """Return True if the battery is changed, False for no further sortie, None before the answer.

        This method is called about once a second until its answer is not None.
        """


class JointFlight:
    """Flies sorties together from the first heartbeat to the last landing.

    Parameters
    ----------
    decisions : DecisionLoop
        Decision loop, which has already decided on the first paths.
    offset_s : float
        Start of the flight, seconds after the start of the run.
    hosting : Hosting
        Pace, orders of a watcher, and whether simulated time stops while the policy decides. If time does not
        stop, the policy decides in another thread.
    console : OperatorConsole or None
        Console of the operator; without a console, a flight beyond its time limit is given up.
    """

    def __init__(
        self,
        sorties: Sequence[Sortie],
        decisions: DecisionLoop,
        evidence: Evidence,
        host: FlightHost,
        *,
        expected_s: float,
        hosting: Hosting,
        offset_s: float = 0.0,
        console: OperatorConsole | None = None,
        events: EventStream,
        watch: Stopwatch,
    ) -> None:
        self.sorties = tuple(sorties)
        self._decisions = decisions
        self._evidence = evidence
        self._offset_s = offset_s
        self._pace, self._orders = hosting.pace, hosting.orders
        self._waits_for_decisions = hosting.waits_for_decisions
        self._console = console
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
        # Pending answer of a policy in another thread, and why it is void for some vehicles, by system id
        self._thinking: Future[Answered] | None = None
        self._not_sent: dict[int, str] = {}
        self._again = 0  # Number of consecutive answers that came too late
        self._begun_wall_s = 0.0

    @property
    def now_s(self) -> float:
        """Simulated seconds since the flight's first heartbeat."""
        return self._host.now_s

    def given(self) -> Flight:
        """Return the flight's result up to now, without its observations: the evidence has them already."""
        # A simulator's clock may be faster than the host's clock.
        ends_s = [(one.ground.started_s or 0.0) + one.ground.flight_time_s for one, _ in self._gates]
        records = [sortie.record() for sortie in self.sorties]
        return Flight(records, max([self.now_s, *ends_s]), self._host.frames)

    def maneuver(self, kind: Maneuver, only: Sortie | None = None) -> None:
        """Command a maneuver to all vehicles that still fly, or only to the vehicle of the sortie `only`."""
        for sortie in self.sorties if only is None else (only,):
            if not sortie.done:
                sortie.send(sortie.ground.maneuver(kind, self.now_s))
                self._outdate(sortie.system_id, _ORDERED)

    def _obey(self, orders: Orders) -> None:
        """Carry out the watcher's orders, and publish the orders that are possible now."""
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
        """Carry out an order to a vehicle; NotFlyingError if the order is not possible now."""
        ground = sortie.ground
        if order.order == START:
            if ground.arming_gate is None or ground.arming_gate.stage is not Stage.ASKING:
                raise NotFlyingError("the vehicle does not wait for a start")
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
        """Once all real vehicles are ready, let each of them start after its start delay."""
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
        """Fly until every flight is over. KeyboardInterrupt comes between slices; then call `interrupt`."""
        try:
            if self._console is not None:
                # The console itself handles signals.
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
                for sortie in self.sorties:
                    why = f"not over after {self.now_s:.0f} simulated seconds ({sortie.ground.phase.value})"
                    sortie.ground.interrupt(Outcome.TIME_LIMIT, why, self.now_s)
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
        """End the flight with the vehicles where they are, and keep the observations."""
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
        """Pass the observations that arrived since the last call to the evidence."""
        for sortie in self.sorties:
            seen = sortie.take()
            if len(seen) and self._events.wants(Seen):
                self._events.tell(Seen(self._offset_s, seen))
            self._evidence.add(seen, offset_s=self._offset_s)
        self._watch.lap("estimate and score")

    @property
    def _mission_s(self) -> float:
        """Seconds since the first vehicle began its mission; 0 before that."""
        started = [sortie.ground.started_s for sortie in self.sorties if sortie.ground.started_s is not None]
        return self.now_s - min(started) if started else 0.0

    def _stops(self, _now_s: float) -> bool:
        """Return whether to end the host's slice early, for an order, an answer, or a decision."""
        self._told.tell(self.now_s)
        self._keep_pace()
        if self._orders is not None and self._orders.waits:
            return True
        if self._thinking is not None:
            return self._thinking.done() or self._is_over()
        # No policy is asked before or after the flight, so slices need not end early.
        if not self._decisions.asks_on_the_way or not self._is_flying():
            return self._is_over()
        mission_s = self._mission_s
        if not self._decisions.is_early(mission_s):
            waiting = sum(sortie.assembler.waiting for sortie in self.sorties)
            self._event = self._decisions.due(self.sorties, mission_s, len(self._evidence) + waiting)
        # If a simulator's clock is faster than real time, its vehicle can reach the end of a path within one
        # slice of the host.
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
            # The policy's thread may outlive the flight, so it gets a snapshot and never the estimator. The
            # estimate's thread makes the snapshot, since that takes seconds on large farms, and this thread
            # sends heartbeats.
            model = None if self._waits_for_decisions else self._evidence.snapshot()
            question = self._decisions.question(event, self.sorties, self._mission_s, self.now_s, model)
            if self._waits_for_decisions:
                self._carry_out_answer(self._decisions.answer(question))
            else:
                statuses = {sortie.system_id: sortie.status(self.now_s) for sortie in self.sorties}
                self._not_sent = {number: one.value for number, one in statuses.items() if one in _OVER}
                self._thinking = _beside(partial(self._decisions.answer, question))

    def _look_at_answer(self, thinking: Future[Answered]) -> None:
        """Send the paths of a finished answer to the vehicles that can still fly them.

        If a vehicle is lost, taken over or returning while the policy decides, the operator is warned at
        once, since the policy may never answer.
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
        """Discard the pending answer for a vehicle, and warn the operator."""
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
        """Wait up to `LAST_ANSWER_S` for the policy's answer, discard it, and learn the last observations."""
        if self._thinking is not None:
            thinking, self._thinking = self._thinking, None
            if wait([thinking], LAST_ANSWER_S).not_done:
                # The policy's thread is a daemon, so it ends when the program ends.
                text = f"the policy did not answer within {LAST_ANSWER_S:g} s after the flight"
                self._events.warn(text)
            elif (error := thinking.exception()) is not None:
                raise error
        self.learn()

    def _is_ending(self) -> bool:
        """Return whether a path is about to end; it is True only once for each path."""
        return self._decisions.ending(self.sorties, self.now_s)

    def _is_flying(self) -> bool:
        for sortie in self.sorties:  # noqa: SIM110
            if sortie.ground.phase is Phase.FLIGHT:
                return True
        return False

    def _is_over(self) -> bool:
        # This runs at each step, and a plain loop is faster than the generator of `all`.
        for sortie in self.sorties:  # noqa: SIM110
            if not sortie.done:
                return False
        return True

    def _give_up_silent(self) -> None:
        """End the flight of a real vehicle that is silent and long overdue."""
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
                    f"its flight should have taken {self._expected_s:.0f} s"
                )
                ground.interrupt(Outcome.NO_ANSWER, why, self.now_s)

    def _keep_pace(self) -> None:
        """Sleep while the simulated clock is ahead of the wall clock."""
        if self._pace is None:
            return
        ahead_s = self.now_s / self._pace - (time.perf_counter() - self._begun_wall_s)
        if ahead_s > _AHEAD_S:
            self._watch.lap("flight")
            time.sleep(ahead_s)
            self._watch.lap("waiting")


def _beside(work: Callable[[], Answered]) -> Future[Answered]:
    """Run `work` in a daemon thread, so that the program can end before the work does."""
    future: Future[Answered] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, name="policy", daemon=True).start()
    return future
