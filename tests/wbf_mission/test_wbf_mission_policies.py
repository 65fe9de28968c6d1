"""Policies in flight: whole runs of one vehicle, of several, over days; what they see and what is noted."""

import numpy as np
import pytest
from sweeps import slow

from mission.errors import PlanningError
from mission.outcome import Outcome
from mission.policies.decision import NO_CHANGE, Alternative, Decision
from mission.policies.observation import Event, Status
from mission.policies.policy import Triggers
from wbf_mission.flight import fly
from wbf_mission.replanning.record import SKIPPED
from wbf_mission.results.result import load_result
from wbf_mission.scenario import Scenario, scenario_with

IDEAL = Scenario(farm="miniberry-30", vehicle="ideal", budget="80steps", estimator="adaptive-disk", seed=4)
QUAD = Scenario(farm="miniberry-30", vehicle="quad", budget="60s", estimator="adaptive-disk", seed=4)
EXACT = scenario_with(QUAD, {"estimator": "point", "estimate_errors": False, "seed": 0})


class Wanderer:
    """Goes to random points that its budget allows; with a hook that may answer something else."""

    def __init__(self, triggers, answer=None):
        self._asking = triggers
        self._answer = answer
        self.observations = []
        self.start()

    @property
    def triggers(self):
        return self._asking

    def start(self):
        self._random = np.random.default_rng(1)

    def decide(self, observation):
        self.observations.append(observation)
        answer = self._answer(observation) if self._answer is not None else None
        if answer is not None:
            return answer
        paths, alternatives = {}, []
        for vehicle in observation.steerable:
            x0, y0, x1, y1 = vehicle.request.area.bounds
            for _ in range(20):
                path = self._random.uniform((x0 + 0.2, y0 + 0.2), (x1 - 0.2, y1 - 0.2), (2, 2))
                cost = vehicle.travel_cost.rest([path])[0]
                if cost <= vehicle.left:
                    paths[vehicle.system_id] = path
                    alternatives.append(Alternative(vehicle.system_id, path, 1.0, cost))
                    break
        return Decision(paths, reason="wander", alternatives=tuple(alternatives))


def changes_of(result):
    return [(one.outcome, one.effect_s) for record in result.decisions for one in record.changes]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_quad_follows_within_its_budget(autopilot):
    scenario = Scenario(**{**QUAD.to_dict(), "autopilot": autopilot})
    policy = Wanderer(Triggers(period_s=8.0))
    result = fly(scenario_with(scenario, {"policy": policy}))
    assert result.outcome is Outcome.COMPLETED, result.reason
    assert result.flight_time_s < 60.0 * 1.05
    outcomes = changes_of(result)
    # Under ArduCopter a change takes seconds of the minute.
    least = 1 if autopilot == "ardupilot" else 2
    assert outcomes[0][0] == "planned" and sum(outcome == "flown" for outcome, _ in outcomes) >= least
    assert all(effect_s is not None for outcome, effect_s in outcomes if outcome == "flown")
    # A policy knows from telemetry where the vehicle is, how fast, and what is left.
    for observation in policy.observations[1:]:
        vehicle = observation.vehicles[0]
        assert vehicle.age_s < 0.5 and 0.0 < vehicle.spent < 62.0
        assert vehicle.battery is not None and 0.5 < vehicle.battery <= 1.0
    flying = [one.vehicles[0] for one in policy.observations[1:] if one.vehicles[0].status is Status.FLYING]
    assert max(np.hypot(*one.velocity_m_s) for one in flying) > 0.2


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_path_is_not_changed_before_the_vehicle_is_at_its_height(autopilot):
    policy = Wanderer(Triggers(period_s=2.0))
    result = fly(scenario_with(EXACT, {"policy": policy, "autopilot": autopilot}))
    assert result.outcome is Outcome.COMPLETED, result.reason
    climbing = [one.vehicles[0].status is Status.CLIMBING for one in policy.observations[1:]]
    assert any(outcome == "flown" for outcome, _ in changes_of(result)) and not any(climbing)
    aside_m = np.hypot(result.track.x_m - result.track.x_m[0], result.track.y_m - result.track.y_m[0])
    assert result.track.altitude_m[np.argmax(aside_m > 1.0)] > 9.5


def test_a_path_of_short_legs_costs_what_its_flight_takes():
    result = fly(scenario_with(EXACT, {"policy": "confidence-guided", "budget": "90s", "seed": 2}))
    assert result.outcome is Outcome.COMPLETED
    last = [one for one in result.decisions if one.changes][-1]
    assert last.time_s > 50.0 and last.changes[0].outcome == "flown"
    flight_s = result.flights[0].flight_time_s
    # Corners within the acceptance radius are flown a little faster than they are priced.
    assert -0.5 < last.time_s + last.changes[0].cost - flight_s < 2.5
    assert flight_s < 90.5


@pytest.mark.parametrize("budget", ["70s", "60m"])
def test_a_tour_of_a_vehicle_whose_turns_cost_time_keeps_the_way_home(budget):
    result = fly(scenario_with(EXACT, {"policy": "orienteering", "budget": budget, "seed": 5}))
    assert result.outcome is Outcome.COMPLETED
    first = result.decisions[0].changes[0]
    assert len(first.path_m) > 1 and first.cost <= float(budget[:-1])
    assert np.hypot(*(first.path_m - first.position_m).T).max() > 1.0
    if budget == "70s":
        assert result.flights[0].flight_time_s < 70.5


def test_equal_runs_are_equal_to_the_bit_and_load_again(tmp_path):
    one, other = (fly(scenario_with(IDEAL, {"policy": Wanderer(Triggers(observations=9))})) for _ in range(2))
    for name in ("x", "y", "time_s", "values"):
        np.testing.assert_array_equal(getattr(one.observations, name), getattr(other.observations, name))
    assert one.history.scores == other.history.scores
    one.save(tmp_path / "run", plots=False)
    again = load_result(tmp_path / "run")
    assert [record.summary() for record in again.decisions] == [record.summary() for record in one.decisions]
    for mine, theirs in zip(one.decisions, again.decisions, strict=True):
        for left, right in zip(mine.alternatives, theirs.alternatives, strict=True):
            np.testing.assert_array_equal(left.points_m, right.points_m)
    table = one.tables()["decisions"]
    kinds = table.column("kind").to_pylist()
    assert kinds.count("change") == len(changes_of(one)) == kinds.count("alternative")


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (lambda s: Decision({1: [[-1.0, 0.0]]}), "leaves its area (request.room) at (-1.0, 0.0) m"),
        (lambda s: Decision({1: np.tile([[0.5, 0.5], [8.0, 8.0]], (20, 1))}), "left of the budget of 80"),
        (lambda s: "west", "answered with a str"),
    ],
)
def test_a_wrong_answer_is_noted_and_the_old_path_flown(answer, why):
    first = Decision({1: [[0.5, 0.5], [5.0, 5.0]]})
    policy = Wanderer(Triggers(period_s=5.0), lambda s: first if s.event is Event.START else answer(s))
    result = fly(scenario_with(IDEAL, {"policy": policy}))
    assert result.outcome is Outcome.COMPLETED
    assert len(result.decisions) > 2
    for record in result.decisions[1:]:
        assert why in record.refused and not record.changes
    assert np.hypot(result.track.x_m[-1] - 5.0, result.track.y_m[-1] - 5.0) < 0.3


def test_an_ideal_robot_that_is_to_go_home_now_ends_its_flight():
    """Its mission does not lead home: it is over where it is, as no way home is paid for."""
    first = Decision({1: [[0.5, 0.5], [8.5, 0.5], [8.5, 8.5]]})

    def home(observation):
        if observation.event is Event.START:
            return first
        return NO_CHANGE if observation.time_s < 12.0 else Decision({1: []}, reason="home")

    result = fly(scenario_with(IDEAL, {"policy": Wanderer(Triggers(period_s=3.0), home)}))
    assert result.outcome is Outcome.COMPLETED
    assert not result.bad_answers
    asked = [one for one in result.decisions if one.reason == "home"]
    (change,) = asked[0].changes
    assert (change.outcome, len(change.path_m), len(asked)) == ("flown", 0, 1)
    assert asked[0].time_s <= result.flight_time_s <= asked[0].time_s + 2.0


def test_without_a_first_path_nothing_flies():
    with pytest.raises(PlanningError, match=r"policy Wanderer has no path for vehicle 1"):
        fly(scenario_with(IDEAL, {"policy": Wanderer(Triggers(), lambda s: NO_CHANGE)}))


def test_without_anything_worth_a_first_flight_nothing_flies():
    with pytest.raises(PlanningError, match=r"policy Wanderer finds nothing worth a flight"):
        fly(scenario_with(IDEAL, {"policy": Wanderer(Triggers(), lambda s: Decision({1: []}))}))


def test_a_later_flight_that_is_not_worth_making_is_not_made(tmp_path):
    """The days go on, and what is believed holds for as long as the flight would have taken."""
    flown = []

    def every_other(observation):
        if observation.event is Event.START:
            flown.append(observation.day)
            return Decision({1: []}) if len(flown) % 2 == 0 else Decision({1: [[0.5, 0.5], [6.0, 6.0]]})
        return NO_CHANGE

    options = {**IDEAL.to_dict(), "days": 2, "day": 5, "budget": "30steps", "flights_per_day": 2}
    result = fly(
        scenario_with(
            scenario_with(Scenario(**options), {"score_points": 5}),
            {"policy": Wanderer(Triggers(), every_other)},
        )
    )
    assert result.outcome is Outcome.COMPLETED and not result.reason
    assert [(one.day, one.flight) for one in result.flights] == [(5, 1), (6, 1)]
    assert flown == [5, 5, 6, 6] and result.skipped_flights == 2
    history = result.history
    assert [one["flights"] for one in result.by_day()] == [1, 1]
    for day in (5, 6):
        of_day = history.of_day(day)
        assert of_day.observations[-5:] == [of_day.observations[-1]] * 5
        assert of_day.scores[-6:] == [of_day.scores[-1]] * 6, (
            "the end of the flight, and five times of the other"
        )
    held = [one for record in result.decisions for one in record.changes if not len(one.path_m)]
    assert [one.outcome for one in held] == [SKIPPED] * 2 and [one.cost for one in held] == [0.0] * 2
    result.save(tmp_path / "run", plots=False)
    again = load_result(tmp_path / "run")
    assert again.outcome is Outcome.COMPLETED and again.summary()["skipped_flights"] == 2


@pytest.mark.parametrize("policy", ["rolling-horizon", "orienteering"])
def test_days_go_on_where_nothing_is_left_to_gain(policy):
    options = {"farm": "miniberry-10", "vehicle": "ideal", "estimator": "adaptive-disk", "budget": "100steps"}
    result = fly(Scenario(**options, policy=policy, days=2, flights_per_day=3))
    assert result.outcome is Outcome.COMPLETED
    assert {one.day for one in result.flights} == {6, 7} and result.skipped_flights > 0
    assert len(result.flights) + result.skipped_flights == 6


def test_home_at_once_is_flown():
    def homewards(observation):
        if observation.event is Event.START:
            return Decision({1: [[8.0, 8.0], [1.0, 8.0]]})
        asked.append(observation)
        return Decision({1: []}) if len(asked) < 2 else NO_CHANGE

    asked = []
    result = fly(scenario_with(QUAD, {"policy": Wanderer(Triggers(period_s=3.0), homewards)}))
    assert result.outcome is Outcome.COMPLETED
    assert result.flight_time_s < 40.0
    assert changes_of(result)[1][0] == "flown"


def test_a_policy_is_asked_before_a_path_ends():
    def last_moment(observation):
        if observation.event is Event.START:
            return Decision({1: [[4.0, 4.0]]})
        if observation.event is Event.ENDING and observation.time_s < 40.0:
            return None
        return NO_CHANGE

    policy = Wanderer(Triggers(period_s=1000.0), last_moment)
    result = fly(scenario_with(QUAD, {"policy": policy}))
    ending = [one for one in policy.observations if one.event is Event.ENDING]
    assert len(ending) >= 2 and all(len(one.vehicles[0].rest_m) for one in ending)
    assert result.outcome is Outcome.COMPLETED
    assert sum(outcome == "flown" for outcome, _ in changes_of(result)) >= 2


def test_a_policy_is_not_asked_more_often_than_it_wants():
    result = fly(scenario_with(IDEAL, {"policy": Wanderer(Triggers(observations=1, least_s=6.0))}))
    times = [record.time_s for record in result.decisions if record.event == "observations"]
    assert len(times) > 5 and min(np.diff(times)) > 5.99


@pytest.mark.parametrize(
    ("policy", "autopilot"),
    [("greedy", "px4"), slow("rolling-horizon", "ardupilot"), slow("orienteering", "px4")],
)
def test_a_vehicle_whose_turns_cost_time_uses_its_budget(policy, autopilot):
    # Of point observations there is always more to learn.
    options = {"policy": policy, "autopilot": autopilot, "budget": "2min", "estimator": "point"}
    run = fly(scenario_with(QUAD, {**options, "estimate_errors": False}))
    assert run.outcome is Outcome.COMPLETED
    assert 0.8 * 120.0 < run.flights[0].flight_time_s <= 121.0
    assert len(run.observations) > 130


def test_a_battery_is_flown_down_to_its_reserve_and_no_further(tmp_path):
    small = tmp_path / "small.toml"
    small.write_text('kind = "multirotor"\nbase = "quad"\n[battery]\ncapacity_wh = 15.0\n')
    run = fly(Scenario(farm="miniberry-30", vehicle=str(small), policy="greedy", estimator="point"))
    assert run.outcome is Outcome.COMPLETED
    assert run.battery_used is not None
    assert 0.7 < run.battery_used < 0.8
