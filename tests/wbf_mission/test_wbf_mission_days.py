"""Runs over days: what is carried over, scored and drawn anew; flights that go wrong."""

import itertools

import numpy as np
import pytest

import wbf_mission.run.campaign
import wbf_mission.run.flight
import wbf_mission.run.record
from geo.farms import get_farm
from mission.outcome import Outcome
from sensors.errors import EstimatorError
from sensors.estimators import advance_estimator, estimator_names, make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission.flight import fly
from wbf_mission.results.result import load_result
from wbf_mission.run.joint_flight import JointFlight
from wbf_mission.run.resolve import make_environment
from wbf_mission.scenario import Scenario

DAYS = Scenario(
    farm="miniberry-10",
    vehicle="ideal",
    budget="30steps",
    estimator="adaptive-disk",
    planner="random-waypoint",
    seed=4,
    day=5,
    days=3,
    flights_per_day=2,
)


@pytest.fixture(scope="module")
def result():
    return fly(DAYS)


def changed(**options):
    return Scenario(**{**DAYS.to_dict(), **options})


def environment_of(scenario):
    return make_environment(scenario, get_farm(scenario.farm.name))


def test_what_is_believed_is_scored_at_the_beginning_of_each_later_day(result):
    history = result.history
    assert sorted(set(history.days)) == [5, 6, 7] and history.days == sorted(history.days)
    environment, grid = environment_of(DAYS), result.farm.grid()
    for day in (6, 7):
        first = history.days.index(day)
        before = result.observations[: history.observations[first]]
        assert set(before.day.tolist()) == set(range(5, day))
        estimator = make_estimator("adaptive-disk").fit(grid, before)
        advance_estimator(estimator, day)
        model = estimator.predict()
        score = RunningScore(environment.values(day), PAPER_FIELDS.masks(grid))
        assert history.entries[first] == score.evaluate(model)
    assert result.score == np.mean(history.scores)
    assert result.final_score == history.scores[-1]


@pytest.mark.parametrize("name", sorted({"adaptive-disk", "gp", "point", "epidemic"} & {*estimator_names()}))
def test_estimators_advance_and_do_not_go_back(name):
    estimator = make_estimator(name).fit(get_farm("miniberry-10").grid())
    estimator.partial_fit(Observations([5], [5], [0.0], [3], [[1.0, 1.0, 0.5]]))
    advance_estimator(estimator, 5)
    assert estimator.latest_day_ == 5
    with pytest.raises(EstimatorError, match=r"advance: day 4 is over; give day 5 or later"):
        advance_estimator(estimator, 4)
    assert estimator.fit(get_farm("miniberry-10").grid()).latest_day_ is None


def spoil(monkeypatch, outcome, of):
    """Make some flights of the run end in another way."""
    count = itertools.count(1)

    class Spoilt(JointFlight):
        def fly(self):
            super().fly()
            if next(count) in of:
                self.sorties[0].ground.outcome = outcome
                self.sorties[0].ground.reason = "spoilt"

    monkeypatch.setattr(wbf_mission.run.flight, "JointFlight", Spoilt)


def test_a_flight_that_went_wrong_does_not_end_the_run(monkeypatch):
    spoil(monkeypatch, Outcome.BATTERY_LOW, {2})
    result = fly(DAYS)
    assert len(result.flights) == 6
    assert result.outcome is Outcome.BATTERY_LOW
    assert result.reason == "day 5, flight 2, vehicle 1: spoilt"


def test_a_vehicle_that_is_lost_for_good_flies_no_more_and_the_days_are_scored(monkeypatch):
    spoil(monkeypatch, Outcome.CRASHED, {2})
    result = fly(DAYS)
    assert len(result.flights) == 2 and result.outcome is Outcome.CRASHED
    assert result.history.days[-2:] == [6, 7]
    seen = len(result.observations)
    assert result.history.observations[-2:] == [seen, seen]


def test_of_a_fleet_the_others_go_on(monkeypatch):
    spoil(monkeypatch, Outcome.CRASHED, {1})
    result = fly(changed(vehicles=2, days=1))
    assert [(one.flight, one.system_id) for one in result.flights] == [(1, 1), (1, 2), (2, 2)]


def test_a_run_that_is_stopped_between_flights_is_interrupted(monkeypatch):
    plan, count = wbf_mission.run.campaign.Campaign.plan, itertools.count(1)

    def interrupted(self, *numbers):
        if next(count) == 4:
            raise KeyboardInterrupt
        return plan(self, *numbers)

    monkeypatch.setattr(wbf_mission.run.campaign.Campaign, "plan", interrupted)
    result = fly(DAYS)
    assert len(result.flights) == 3 and result.outcome is Outcome.INTERRUPTED
    assert result.reason == "stopped after flight 1 of day 6"


def test_each_day_has_its_report_truth_and_estimate(result, tmp_path):
    environment = environment_of(DAYS)
    assert [one.day for one in result.days] == [5, 6, 7]
    for one in result.days:
        assert one.truth is not None and one.model is not None and one.report is not None
        np.testing.assert_array_equal(one.truth, environment.values(one.day))
        seen = result.observations[result.observations.day <= one.day]
        model = make_estimator("adaptive-disk").fit(result.farm.grid(), seen).predict()
        np.testing.assert_array_equal(one.model.value, model.value)
        looked_at = seen[seen.day == one.day]
        cells = {(x, y) for x, y in zip(looked_at.x.tolist(), looked_at.y.tolist(), strict=True)}
        assert 0 < one.report.fields[-1].seen <= len(cells)
    assert result.days[-1].report == result.report
    days = result.summary()["by_day"]
    assert [one["flights"] for one in days] == [2, 2, 2]
    assert sum(one["observations"] for one in days) == len(result.observations)
    assert sum(one["scored_times"] for one in days) == len(result.history.scores)
    assert days[-1]["final_score"] == result.final_score
    again = load_result(result.save(tmp_path / "run", plots=False))
    assert again.summary()["by_day"] == days
    for mine, theirs in zip(result.days, again.days, strict=True):
        assert theirs.model is not None and mine.model is not None
        np.testing.assert_array_equal(mine.truth, theirs.truth)
        np.testing.assert_array_equal(mine.model.value, theirs.model.value)


def test_large_farms_keep_the_last_day_only(monkeypatch, tmp_path):
    monkeypatch.setattr(wbf_mission.run.record, "KEPT_DAYS_BYTES", 1000)
    result = fly(changed(flights_per_day=1))
    assert all(one.truth is None and one.model is None and one.report for one in result.days)
    folder = result.save(tmp_path / "run", plots=False)
    assert not list(folder.glob("*_days*"))
    assert [one.report for one in load_result(folder).days] == [one.report for one in result.days]
