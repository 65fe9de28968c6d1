"""Vehicles behind a link on a virtual clock, which may run slower than theirs."""

import contextlib
import threading
from concurrent.futures import wait

import numpy as np
import pytest
from stand_in import LONG_S, scenario
from sweeps import slow

from mission.ground.arming_gate import ArmingGate
from mission.outcome import Outcome
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, Status
from mission.policies.policy import Triggers
from mission.transfer import OWN_TRANSFERS
from mission.transfer.vehicles import Vehicle
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.host.simulation import Simulation
from wbf_mission.addons.base.links import fitted_to
from wbf_mission.addons.base.simulator import make_components
from wbf_mission.addons.operate.link import riding_camera
from wbf_mission.events import EventStream, Noted
from wbf_mission.flight import fly
from wbf_mission.run import joint_flight
from wbf_mission.run.sortie import SILENT_S
from wbf_mission.scenario import scenario_with

SPEED = 5.0
BUDGET_S = 100.0


class Slower:
    """A component of the ground, whose clock runs slower than the vehicle's, and which may not hear some."""

    def __init__(self, inner, link):
        self.inner, self.link = inner, link
        self.system_id, self.component_id, self.wanted = inner.system_id, inner.component_id, inner.wanted

    def receive(self, message, now_s):
        if message.get_srcSystem() in self.link.silent:
            return []
        return self.inner.receive(message, now_s / self.link.speed)

    def poll(self, now_s):
        return self.inner.poll(now_s / self.link.speed)

    def next_deadline(self):
        return self.link.speed * self.inner.next_deadline()


class VirtualLink:
    """A link to vehicles, and its hosting, without sockets."""

    def __init__(self, made, *, speed=SPEED, waits=True):
        self.made, self.speed, self.silent = made, speed, set()
        self.pace, self.tlog, self.transfers, self.force = None, None, OWN_TRANSFERS, False
        self.orders, self.waits_for_decisions = None, waits
        self.console = self
        self.faults, self.full, self.change_s = (), 1.0, 60.0

    # The link.

    def fitted(self, chosen, events):
        return fitted_to(chosen, *(Vehicle(one.system_id, 1, 3, 2) for one in self.made.vehicles))

    def numbered(self, vehicles):
        return tuple(vehicles)

    def check(self, campaign, events):
        return

    def sorties(self, *of):
        return None

    def hosting(self, faults):
        return self

    def tend(self, flight):
        assert flight.now_s < 600.0, "it does not end"

    # The hosting.

    def arming_gate(self, system_id):
        return ArmingGate((system_id, 1), agreed=True)

    def open(self, sorties, writer, **more):
        self.grounds = {sortie.ground: Slower(sortie.ground, self) for sortie in sorties}
        cameras = [Slower(riding_camera(sortie), self) for sortie in sorties]
        self.simulation = Simulation([*self.made.components, *cameras, *self.grounds.values()])
        return contextlib.nullcontext(self)

    # The host.

    frames = 0

    @property
    def now_s(self):
        return self.simulation.now_s / self.speed

    def run(self, until, limit_s):
        return self.simulation.run(
            until=lambda now_s: until(now_s / self.speed), limit_s=self.speed * limit_s
        )

    def send(self, component, messages):
        self.simulation.send(self.grounds[component], messages)


def test_a_policy_keeps_the_budget_of_a_vehicle_whose_clock_runs_faster():
    given = {"autopilot": "ardupilot", "policy": "confidence-guided", "budget": f"{BUDGET_S:g}s"}
    given["farm"] = "miniberry-30"
    link = VirtualLink(make_components(scenario(**given), with_camera=False))
    result = fly(scenario(**given), by=link)
    assert result.outcome is Outcome.COMPLETED, result.reason
    (flight,) = result.flights
    changes = [one for record in result.decisions for one in record.changes if one.outcome == "flown"]
    assert changes, "it decides in flight"
    assert 0.6 * BUDGET_S < flight.flight_time_s < 1.15 * BUDGET_S
    assert flight.camera.images > 20


class Pondering:
    """A policy that knows its answer in flight at once, and gives it when it may go on."""

    def __init__(self, answer=lambda _told: NO_CHANGE, *, period_s=2.0):
        self.triggers, self.answer = Triggers(period_s=period_s), answer
        self.told, self.ponders, self.go_on = [], threading.Event(), threading.Event()

    def start(self):
        """Nothing is remembered."""

    def decide(self, observation):
        if observation.event is Event.START:
            left, low, right, high = observation.vehicles[0].request.area.bounds
            x, y = np.linspace(left, right, 8)[1:-1], (low + 3.0, high - 3.0)
            rows = [(x[k], y[end]) for k in range(6) for end in (k % 2, 1 - k % 2)]
            return Decision({one.system_id: rows + rows[::-1] for one in observation.vehicles})
        answer = self.answer(observation)
        self.told.append(observation)
        self.ponders.set()
        assert self.go_on.wait(LONG_S)
        self.ponders.clear()
        return answer


class Watched(VirtualLink):
    """A flight beside which a policy ponders; `watch` looks at it each second."""

    def __init__(self, policy, watch=lambda link: None, *, vehicles=1, budget="200s"):
        self.given = scenario(farm="miniberry-100", autopilot="ardupilot", budget=budget, vehicles=vehicles)
        super().__init__(
            make_components(self.given, count=vehicles, with_camera=False), speed=1.0, waits=False
        )
        self.policy, self.watch, self.flight, self.lines = policy, watch, None, []
        self.stream = EventStream()
        self.stream.listen(lambda line: self.lines.append((self.now_s, line.text)), Noted)

    def tend(self, flight):
        super().tend(flight)
        self.flight = flight
        self.watch(self)

    def run(self, until, limit_s):
        # No time goes by before the policy has been asked, or has answered where it may.
        while (thinking := self.flight and self.flight._thinking) and not thinking.done():
            if not self.policy.go_on.is_set() and self.policy.ponders.wait(0.01):
                break
        return super().run(until, limit_s)

    def status(self, number=1):
        return self.flight.sorties[number - 1].status(self.now_s)

    def let_answer(self):
        """Let the policy give its answer to the open question, if there is one."""
        if self.flight._thinking is not None:
            self.policy.go_on.set()
            assert not wait([self.flight._thinking], LONG_S).not_done
            self.policy.go_on.clear()

    def fly(self, **more):
        try:
            chosen = scenario_with(self.given, {"policy": self.policy, **more})
            return fly(chosen, by=self, events=self.stream)
        finally:
            self.policy.go_on.set()

    def said(self, text):
        """Return when a line was said; it was said once."""
        (said_s,) = [now_s for now_s, line in self.lines if text in line]
        return said_s


NOT_SENT = "the policy's answer is not sent: "


@pytest.fixture(autouse=True)
def soon_left_behind(monkeypatch):
    monkeypatch.setattr(joint_flight, "LAST_ANSWER_S", 0.05)


def test_a_vehicle_lands_and_the_run_ends_while_a_policy_never_answers():
    ended = []
    for policy in (Pondering(), Pondering()):
        link = Watched(policy)
        if not ended:
            policy.go_on.set()
        result = link.fly()
        assert result.outcome is Outcome.COMPLETED, result.reason
        ended.append(link.now_s)
        assert len(policy.told) > 3 or ended[1:]
    assert len(policy.told) == 1, "it is not asked while it decides"
    assert ended[1] == pytest.approx(ended[0], abs=3.0)
    assert link.said(NOT_SENT + "the vehicle was returning while") < ended[1] - 5.0
    assert link.said("did not answer within") == pytest.approx(ended[1], abs=1.0)


def test_a_pilot_who_takes_over_is_told_of_at_once_while_a_policy_never_answers():
    taken = []

    def watch(link):
        if link.policy.told and link.status() is Status.FLYING and link.now_s > 60.0 and not taken:
            taken.append(link.now_s)
            link.made.vehicle.pilot.modes.override(Mode.LAND)

    link = Watched(Pondering(), watch)
    result = link.fly()
    assert result.outcome is Outcome.PILOT_TOOK_OVER
    assert link.said(NOT_SENT + "the vehicle was piloted while") < taken[0] + 2.5


@pytest.mark.parametrize("answers", [True, False])
def test_a_vehicle_that_is_heard_no_more_is_lost_in_the_usual_time_while_a_policy_decides(answers):
    since = []

    def watch(link):
        if link.policy.told and not since and link.status(2) is Status.FLYING:
            since.append(link.now_s)
            link.silent.add(2)
        if answers and since and link.now_s > since[0] + SILENT_S + 5.0 and len(link.policy.told) == 1:
            link.let_answer()

    link = Watched(Pondering(), watch, vehicles=2)
    result = link.fly()
    lost_s = link.said("vehicle 2: " + NOT_SENT + "the vehicle was lost while the policy decided")
    assert since[0] + SILENT_S < lost_s < since[0] + SILENT_S + 3.0
    assert [one.outcome for one in result.flights] == [Outcome.COMPLETED, Outcome.NO_ANSWER]
    events = [one.event for one in link.policy.told]
    assert events[1:] == [Event.LOST] * answers, "that is the next question, as soon as it has answered"


def most_affordable(told):
    """Back to where the vehicle came from, and as far on over the farm as the budget allows."""
    (vehicle,) = told.vehicles
    left, low, right, high = vehicle.request.area.bounds
    points = [(left + 3.0, low + 3.0), *[(right - 3.0, high - 3.0), (right - 3.0, low + 3.0)] * 40]
    paths = [np.array(points[:count]) for count in range(1, len(points))]
    costs = np.array(vehicle.travel_cost.rest(paths))
    return Decision({1: paths[np.flatnonzero(costs <= vehicle.left)[-1]]})


@pytest.mark.parametrize("budget", ["300s", *(slow(one) for one in ("1000m", "15Wh"))])
def test_a_late_answer_is_priced_again_and_the_policy_asked_again(budget):
    def watch(link):
        if len(link.policy.told) > 1 or (link.policy.told and link.now_s > asked_s(link) + 25.0):
            link.let_answer()

    def asked_s(link):
        return link.policy.told[0].time_s + link.flight.sorties[0].ground.started_s

    link = Watched(Pondering(most_affordable, period_s=30.0), watch, budget=budget)
    result = link.fly()
    assert result.outcome is Outcome.COMPLETED, result.reason
    _, first, second, *_ = result.decisions
    (dropped,), (sent,) = first.changes, second.changes
    unit = link.policy.told[0].vehicles[0].request.budget.unit
    assert dropped.outcome.startswith("not sent: policy Pondering returned a path that takes "), dropped
    assert f"{unit}, over the " in dropped.outcome
    link.said(dropped.outcome.removeprefix("not sent: "))
    assert (first.event, second.event, sent.outcome) == ("period", "period", "flown")
    assert second.time_s == pytest.approx(first.time_s + 26.0, abs=2.0), "it is asked again at once"
    before, asked = (told.vehicles[0] for told in link.policy.told[:2])
    assert dropped.cost == before.travel_cost.rest([dropped.path_m])[0], "as it was decided"
    assert sent.cost != asked.travel_cost.rest([sent.path_m])[0], "as it was sent"
    if unit == "s":  # An answer may take a second; the next one may take as long as this one
        assert before.spent == pytest.approx(first.time_s + 1.0, abs=0.6)
        assert asked.spent == pytest.approx(second.time_s + 2.0 * 26.0, abs=3.0)


def test_an_answer_whose_start_was_passed_is_dropped_and_asked_for_again_twice_in_a_row():
    def through_the_target(told):
        rest_m = told.vehicles[0].rest_m
        return Decision({1: [*rest_m[:1], *rest_m[:0:-1]]} if len(rest_m) > 2 else {})

    def watch(link):
        told, (sortie,) = link.policy.told, link.flight.sorties
        if not told:
            return
        (then,) = told[-1].vehicles
        now = sortie.report(link.now_s)
        if len(now.rest_m) < len(then.rest_m) and np.hypot(*(now.position_m - then.rest_m[0])) > 3.0:
            link.let_answer()

    link = Watched(Pondering(through_the_target, period_s=40.0), watch)
    result = link.fly()
    late = [one for one in result.decisions[1:] if one.changes]
    text = "the vehicle has passed the path's start"
    assert [one.changes[0].outcome for one in late] == [f"not sent: {text}"] * len(late)
    assert sum(line == NOT_SENT + text for _, line in link.lines) == len(late) > 3
    times = [one.time_s for one in late]
    assert times[2] < times[0] + 35.0 and times[3] > times[2] + 39.0, times
