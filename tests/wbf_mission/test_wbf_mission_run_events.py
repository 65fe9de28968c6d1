"""The events that a run tells: what the terminal, a page and files see of it."""

from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest

from wbf_mission import fly
from wbf_mission.events import (
    DayBegun,
    Decided,
    Estimated,
    EventStream,
    FlightEnded,
    Planned,
    RunBegun,
    RunEnded,
    Seen,
    VehicleSaid,
)
from wbf_mission.run import joint_flight
from wbf_mission.run.joint_flight import JointFlight
from wbf_mission.scenario import Scenario


def _flown(**options):
    stream, heard = EventStream(), []

    def keep(event):
        # Arrays may be the estimator's own.
        heard.append((event, event.model.value.copy()) if isinstance(event, Estimated) else (event, None))

    stream.listen(keep)
    return fly(Scenario(farm="miniberry-10", **options), events=stream), heard


@pytest.fixture(scope="module")
def spiral():
    return _flown(planner="spiral", vehicle="quad", budget="3min", estimator="adaptive-disk")


def test_a_run_begins_with_what_is_flown_and_ends_with_its_summary(spiral):
    result, heard = spiral
    events = [event for event, _ in heard]
    begun = next(one for one in events if isinstance(one, RunBegun))
    assert begun.farm.name == "miniberry-10" and begun.planner == "spiral" and begun.simulated
    assert [one.system_id for one in begun.vehicles] == [1]
    assert isinstance(events[-1], RunEnded)
    assert events[-1].outcome == result.outcome.value
    assert events[-1].summary["score"] == result.score


def test_the_events_hold_what_the_result_holds(spiral):
    result, heard = spiral
    events = [event for event, _ in heard]
    assert np.array_equal(next(one.truth for one in events if isinstance(one, DayBegun)), result.truth)
    planned = [one for one in events if isinstance(one, Planned)]
    assert len(planned) == 1
    assert np.array_equal(planned[0].path_m, result.plan.path_m)
    assert planned[0].duration_s == result.plan.prediction.duration_s
    seen = [one.observations for one in events if isinstance(one, Seen)]
    assert sum(map(len, seen)) == len(result.observations)
    assert np.array_equal(np.concatenate([one.x for one in seen]), result.observations.x)
    estimated = [(one, value) for one, value in heard if isinstance(one, Estimated)]
    assert [one.score.score for one, _ in estimated] == result.history.scores
    assert [one.time_s for one, _ in estimated] == result.history.times_s
    assert np.array_equal(estimated[-1][1], result.model.value)
    ended = [one for one in events if isinstance(one, FlightEnded)]
    assert [(one.system_id, one.outcome) for one in ended] == [(1, result.outcome.value)]
    texts = [(one.time_s, one.severity, one.text) for one in events if isinstance(one, VehicleSaid)]
    assert texts == result.texts


def test_who_follows_a_policy_hears_its_decisions_and_the_paths_that_it_changes():
    result, heard = _flown(policy="greedy", vehicle="quad", budget="3min", estimator="adaptive-disk")
    decided = [one.record for one, _ in heard if isinstance(one, Decided)]
    assert decided == result.decisions and len(decided) > 1
    times = [one.time_s for one, _ in heard if isinstance(one, Decided)]
    assert times == sorted(times)
    maps = [one.acquisition.values for one, _ in heard if isinstance(one, Decided)]
    assert maps[0].max() > 0.0 and not np.array_equal(maps[0], maps[-1]), "what is seen changes the worth"
    planned = [one for one, _ in heard if isinstance(one, Planned)]
    flown = sum(change.outcome == "flown" for one in decided for change in one.changes)
    assert len(planned) >= 1 + flown


def test_a_run_is_the_same_whether_somebody_follows_it_or_not(spiral):
    alone = fly(
        Scenario(
            farm="miniberry-10", planner="spiral", vehicle="quad", budget="3min", estimator="adaptive-disk"
        )
    )
    followed = spiral[0]
    assert np.array_equal(alone.track.x_m, followed.track.x_m)
    assert np.array_equal(alone.observations.values, followed.observations.values)
    assert alone.history == followed.history
    assert np.array_equal(alone.model.value, followed.model.value)


def test_a_policy_that_never_answers_is_left_behind(monkeypatch):
    monkeypatch.setattr(joint_flight, "LAST_ANSWER_S", 0.05)
    seen, learned = [], []
    stream = EventStream()
    stream.listen(seen.append)
    flight = SimpleNamespace(_thinking=Future(), _events=stream, learn=lambda: learned.append(True))
    JointFlight._await_answer(flight)
    assert [event.text for event in seen] == ["the policy did not answer within 0.05 s after the flight"]
    assert (flight._thinking, learned) == (None, [True])


def test_an_error_of_the_last_decision_is_raised():
    thinking = Future()
    thinking.set_exception(ValueError("no model"))
    with pytest.raises(ValueError, match="no model"):
        JointFlight._await_answer(SimpleNamespace(_thinking=thinking))
