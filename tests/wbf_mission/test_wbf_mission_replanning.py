"""The loop of decisions by itself: what it looks at between two questions."""

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from policy_observations import observation, report

from geo import get_farm
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, Status
from mission.policies.policy import FixedPlan
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import PAPER_WEIGHTS
from wbf_mission.replanning import loop as loops
from wbf_mission.replanning.loop import Answer, Answered, DecisionLoop, Knowledge, ask


def loop_of(policy):
    def nothing():
        raise AssertionError

    knowledge = Knowledge(
        get_farm("miniberry-10"), 6, PAPER_FIELDS, PAPER_WEIGHTS, nothing, Observations.empty
    )
    return DecisionLoop(policy, "policy", knowledge, records=[])


def test_a_question_beside_a_flight_keeps_what_was_known_and_looks_ahead():
    seen, asked = [Observations.empty()], []
    knowledge = Knowledge(get_farm("miniberry-10"), 6, PAPER_FIELDS, PAPER_WEIGHTS, None, lambda: seen[-1])
    policy = SimpleNamespace(decide=lambda _told: NO_CHANGE)
    loop = DecisionLoop(policy, "policy", knowledge, records=[], compute_s=3.0)
    vehicle = SimpleNamespace(
        waypoints_reached=0, report=lambda *at_s: asked.append(at_s) or report(1, status=Status.FLYING)
    )
    question = loop.question(Event.PERIOD, [vehicle], 5.0, 7.0, lambda: "believed then")
    seen.append(Observations([1], [1], [6.0], [6], [[1, 1, 0.5]]))
    answered = loop.answer(question)
    told = answered.observation
    assert (told.observations, told.model, told.time_s) == (seen[0], "believed then", 5.0)
    loop.outdated(answered, [vehicle], 11.0)
    loop.question(Event.PERIOD, [vehicle], 20.0, 22.0, lambda: None)
    assert asked == [(7.0, 3.0), (11.0,), (22.0, 8.0)]


@pytest.mark.parametrize(
    ("path_m", "later", "why"),
    [
        ([(5.0, 1.0)], {}, None),
        ([(5.0, 1.0)], {"spent": 31.0}, "policy returned a path that takes 14 steps, over the 9 steps left"),
        ([], {"spent": 40.0}, None),
        ([(5.0, 1.0)], {"status": Status.SILENT}, "policy changes the path of a vehicle that is silent"),
        ([(5.0, 1.0)], {"status": Status.CHANGING}, "policy changes the path of a vehicle that is changing"),
        ([(3.0, 1.0)], {"here": (3.9, 1.0)}, None),
        ([(3.0, 1.0)], {"here": (4.1, 1.0)}, "the vehicle has passed the path's start"),
        ([(1.0, 1.5)], {"here": (4.1, 1.0)}, "the vehicle has passed the path's start"),
        ([(3.0, 2.1)], {"here": (4.1, 1.0)}, None),
        ([(4.0, 4.0)], {"here": (4.1, 1.0)}, None),
        ([(4.0, 4.0)], {"here": (6.0, 2.0), "rest": [(6.0, 1.0)]}, "the vehicle has passed the path's start"),
    ],
)
def test_a_late_answer_is_held_to_the_rules_again_by_the_vehicle_as_it_is(path_m, later, why):
    rest = {"rest": [(4.0, 4.0), (6.0, 1.0)]} if "rest" in later else {}
    known = {"status": Status.FLYING, "here": (1.0, 1.0), "spent": 2.0, "steps": 40.0, **rest}
    then, now = report(1, **known), report(1, **known | later)
    answer = Answer(Decision({1: path_m}), {1: math.nan}, 0.0)
    vehicles = [SimpleNamespace(report=lambda _now_s: now)]
    found = loop_of(FixedPlan("spiral")).outdated(Answered(observation(then), answer), vehicles, 9.0)
    assert found.keys() == ({1} if why else set())
    assert found.get(1, "").startswith(why or "")
    assert why or answer.costs == {1: now.travel_cost.rest([np.array(path_m).reshape(-1, 2)])[0]}


class Sleeper:
    """A policy that takes its time."""

    def decide(self, _observation):
        time.sleep(0.1)
        return NO_CHANGE


def test_waiting_for_a_core_does_not_make_an_answer_late(monkeypatch):
    assert ask(Sleeper(), "sleeper", None).compute_s > 0.05, "sleeping is no waiting for a core"
    told = iter((1.0, 1.08))
    monkeypatch.setattr(loops, "_waited_s", lambda: next(told))
    assert 0.01 < ask(Sleeper(), "sleeper", None).compute_s < 0.08


def test_where_the_system_does_not_tell_the_whole_time_counts(monkeypatch, tmp_path):
    for content in ("", "1", "1 x 3"):
        (tmp_path / "schedule").write_text(content)
        monkeypatch.setattr(loops, "_SCHEDULE", tmp_path / "schedule")
        assert ask(Sleeper(), "sleeper", None).compute_s >= 0.1
    monkeypatch.setattr(loops, "_SCHEDULE", tmp_path / "none")
    assert ask(Sleeper(), "sleeper", None).compute_s >= 0.1


def test_a_loss_is_noticed_from_statuses_alone():
    now = {1: Status.FLYING, 2: Status.FLYING}
    fleet = [SimpleNamespace(system_id=key, status=lambda _now_s, key=key: now[key]) for key in now]
    loop = loop_of(FixedPlan("spiral"))
    assert not loop.lost(fleet, 1.0)
    now[2] = Status.LOST
    assert loop.lost(fleet, 2.0)
    assert not loop.lost(fleet[1:], 2.0), "a single one that is lost leaves nobody to be told"
