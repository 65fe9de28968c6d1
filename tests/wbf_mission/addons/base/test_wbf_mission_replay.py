"""A finished run as a stream of events: all of it, in the order of time, with the estimates made again."""

from dataclasses import replace
from itertools import pairwise
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

from mission.model import Command
from mission.outcome import Phase
from sensors.observations import Observations
from sensors.scoring.score import RunningScore, ScoreWeights
from wbf_mission.addons.base.replay import events_of
from wbf_mission.events import (
    DayBegun,
    Decided,
    Estimated,
    Event,
    EventStream,
    FlightEnded,
    Planned,
    RunBegun,
    RunEnded,
    Seen,
    VehicleMoved,
    VehicleSaid,
)
from wbf_mission.flight import Simulated, fly
from wbf_mission.results.result import Result, load_result
from wbf_mission.scenario import Scenario


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    options = {"planner": "random-waypoint", "budget": "20steps", "estimator": "adaptive-disk", "seed": 2}
    flown = fly(Scenario(farm="miniberry-10", vehicle="ideal", vehicles=2, day=4, days=2, **options))
    return load_result(flown.save(tmp_path_factory.mktemp("run") / "run", plots=False))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("log") / "flight.tlog"


@pytest.fixture(scope="module")
def told(log: Path) -> tuple[list[Event], Result]:
    """What a run told while it was flown, and what it gave."""
    events = list[Event]()
    stream = EventStream()
    stream.listen(events.append)
    options = {"policy": "greedy", "budget": "90s", "estimator": "point", "seed": 1, "days": 2}
    return events, fly(
        Scenario(farm="miniberry-10", vehicles=2, **options), by=Simulated(tlog=log), events=stream
    )


@pytest.fixture(scope="module")
def steered(told: tuple[list[Event], Result]) -> Result:
    return told[1]


def of(events: list[Event], kind: type) -> list:
    return [one for one in events if isinstance(one, kind)]


def time_of(event: Event) -> float:
    if isinstance(event, Seen):
        return event.offset_s + float(event.observations.time_s.max())
    return event.time_s


@pytest.mark.parametrize("run", ["result", "steered"])
def test_everything_is_told_in_the_order_of_time(run: str, request: pytest.FixtureRequest) -> None:
    result = request.getfixturevalue(run)
    first, *events = events_of(result)
    assert isinstance(first, RunBegun) and isinstance(events[-1], RunEnded)
    assert [one.system_id for one in first.vehicles] == [1, 2] and first.seed == result.scenario.seed
    times = [time_of(one) for one in events if not isinstance(one, Estimated)]
    assert all(a <= b for a, b in pairwise(times)) and times[-1] == result.simulated_s
    for seen, whole in zip(
        Observations.concatenate([one.observations for one in of(events, Seen)]).to_table().columns,
        result.observations.to_table().columns,
        strict=True,
    ):
        assert seen.equals(whole)
    scored = of(events, Estimated)
    assert [one.score for one in scored] == result.history.entries
    assert [one.observations for one in scored] == result.history.observations
    assert [one.time_s for one in scored] == result.history.times_s
    assert len(of(events, VehicleMoved)) == sum(len(one.track.time_s) for one in result.flights)
    assert len(of(events, VehicleSaid)) == sum(len(one.texts) for one in result.flights)
    ended = [(one.day, one.flight, one.system_id, one.outcome) for one in of(events, FlightEnded)]
    assert sorted(ended) == sorted((f.day, f.flight, f.system_id, f.outcome.value) for f in result.flights)
    assert [one.record for one in of(events, Decided)] == result.decisions


def test_it_tells_what_the_run_told(told: tuple[list[Event], Result]) -> None:
    live, result = told
    again = list(events_of(result))
    live_begun, begun = of(live, RunBegun)[-1], again[0]
    assert {name: getattr(begun, name) for name in begun.__slots__ if name not in ("farm", "fields")} == {
        name: getattr(live_begun, name) for name in begun.__slots__ if name not in ("farm", "fields")
    }
    for kind in (DayBegun, Decided, Estimated, VehicleSaid, RunEnded):
        ours, theirs = of(again, kind), of(live, kind)
        key = attrgetter("time_s") if kind is not Estimated else lambda one: one.observations
        ours, theirs = sorted(ours, key=key), sorted(theirs, key=key)
        assert len(ours) == len(theirs) > 0
        np.testing.assert_allclose([one.time_s for one in ours], [one.time_s for one in theirs], atol=0.11)
    for one in of(again, Planned):
        there = [other for other in of(live, Planned) if other.system_id == one.system_id]
        near = [other.path_m for other in there if abs(other.time_s - one.time_s) < 3.0]
        assert any(
            path.shape == one.path_m.shape and np.allclose(path, one.path_m, atol=0.01) for path in near
        )


def test_a_log_tells_more_of_the_vehicles(told: tuple[list[Event], Result], log: Path) -> None:
    live, result = told
    again = {
        (one.system_id, round(one.time_s, 2)): one
        for one in of(list(events_of(result, log=log)), VehicleMoved)
    }
    both = [
        (one, again[key])
        for one in of(live, VehicleMoved)
        if (key := (one.system_id, round(one.time_s, 2))) in again and one.phase == Phase.FLIGHT.value
    ]
    assert len(both) > 100 and {one.day for one, _ in both} == {6, 7}
    for one, ours in both:
        # What arrives at the very time of a state may be told with it, or with the next one.
        assert ours.battery == pytest.approx(one.battery, abs=0.011)
        assert (ours.x_m, ours.y_m) == pytest.approx((one.x_m, one.y_m), abs=0.8)
        assert ours.mode and ours.heading_rad is not None and ours.battery is not None
    same = [(one.mode, one.armed, one.items) == (ours.mode, ours.armed, ours.items) for one, ours in both]
    assert sum(same) > 0.9 * len(both)
    for system_id in (1, 2):
        for day in (6, 7):
            last = [one for one in again.values() if (one.system_id, one.day) == (system_id, day)][-1]
            end = [one for one in of(live, VehicleMoved) if (one.system_id, one.day) == (system_id, day)][-1]
            assert (last.armed, last.mode) == (end.armed, end.mode) == (False, last.mode), "it has landed"
    bare = of(list(events_of(result)), VehicleMoved)
    assert {(one.battery, one.mode, one.heading_rad) for one in bare} == {(None, "", None)}
    speeds = [(one.speed_m_s, again[one.system_id, round(one.time_s, 2)].speed_m_s) for one in bare]
    assert np.abs(np.diff(speeds, axis=1)).mean() < 0.3


def test_flights_begin_when_they_did(result: Result) -> None:
    begins = {(one.day, one.begun_s) for one in result.flights}
    (day, begun_s), (next_day, next_begun_s) = sorted(begins)
    assert (day, begun_s, next_day) == (4, 0.0, 5) and 0.0 < next_begun_s < result.simulated_s
    events = list(events_of(result))
    assert [(one.day, one.time_s) for one in of(events, DayBegun)] == sorted(begins)
    # What is believed at the beginning of a later day is scored then.
    assert result.history.times_s[result.history.days.index(5)] == next_begun_s


def test_a_path_that_changes_in_flight_is_planned_again(steered: Result) -> None:
    planned = [one for one in of(list(events_of(steered)), Planned) if one.day == 6]
    changes = [change for one in steered.decisions if one.day == 6 for change in one.changes]
    changes = [change for change in changes if change.effect_s is not None]
    assert len(changes) > 2 and len(planned) == 2 + len(changes)
    assert [one.time_s for one in planned[:2]] == [0.0, 0.0]
    for one in planned[2:]:
        change = next(change for change in changes if change.path_m is one.path_m)
        assert one.system_id == change.system_id
        assert one.time_s == pytest.approx(change.effect_s, abs=0.2)
        waypoints = [item for item in one.mission.items if item.command == Command.NAV_WAYPOINT]
        frame = steered.farm.frame
        there = [frame.from_wgs84(item.x, item.y) for item in waypoints]
        np.testing.assert_allclose(np.reshape(there, (-1, 2)), one.path_m, atol=0.01)  # whole 1e-7 degrees


def test_estimates_made_again_are_those_that_were_scored(result: Result) -> None:
    masks, weights = result.fields.masks(result.farm.grid()), ScoreWeights.of(result.fields)
    scores = {one.day: RunningScore(one.truth, masks, weights, result.fields) for one in result.days}
    scored = 0
    for event in events_of(result, estimates=len(result.history.entries)):
        if isinstance(event, Estimated):
            assert event.model is not None and event.score is not None
            assert scores[event.day].add(event.model).loss == pytest.approx(event.score.loss, rel=1e-12)
            scored += 1
    assert scored == len(result.history.entries) > 40


def test_nothing_flown_is_a_run_of_no_moves(result: Result) -> None:
    nowhere = [
        replace(one.track, **{name: np.empty(0) for name in one.track.__slots__}) for one in result.flights
    ]
    grounded = [replace(one, track=track) for one, track in zip(result.flights, nowhere, strict=True)]
    events = list(events_of(replace(result, flights=tuple(grounded))))
    assert not of(events, VehicleMoved) and len(of(events, FlightEnded)) == 4
