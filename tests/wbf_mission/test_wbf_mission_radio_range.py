"""A ground station whose radio reaches only so far: what is seen beyond arrives later."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sweeps import slow, sweep

from mission.outcome import Outcome
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, Status
from mission.policies.policy import FixedPlan, Triggers
from wbf_mission import Scenario, Simulated, fly
from wbf_mission.planning.station_range import SLOWER, SPARE_S, StationRange
from wbf_mission.run import joint_flight
from wbf_mission.run.resolve import resolve
from wbf_mission.run.sortie import SILENT_S
from wbf_mission.scenario import ScenarioError, scenario_with

PLACE = {"farm": "miniberry-30", "estimator": "point", "budget": "60m", "altitude_m": 3.0}
ROWS = {**PLACE, "planner": "lawnmower"}
AUTOPILOTS = ("px4", "ardupilot")
RANGES_M = (1.0, 6.0)


def test_reach_tells_how_long_a_plan_explains_silence():
    station = StationRange(5.0, (0.0, 0.0), 3.0, 2.5)
    assert station.radius_m == pytest.approx(4.0)
    there = np.array([[20.0, 0.0], [0.0, 0.0]])

    def seconds(length_m):
        return pytest.approx(SLOWER * length_m / 2.0 + SPARE_S, abs=0.5)

    # Out along x and well in again: 16 m there, 16.9 m back.
    assert station.absence_s((4.0, 0.0), there, 2.0) == seconds(32.9)
    # Inside first, out and in again, and the end of a path that does not come back.
    assert station.absence_s((0.0, 0.0), there, 2.0) == seconds(36.9)
    assert station.absence_s((4.0, 0.0), there[:1], 2.0) == seconds(16.0)
    # Heard well inside, with nothing to fly: it should be heard all the time.
    assert station.absence_s((1.0, 0.0), np.empty((0, 2)), 2.0) == SPARE_S
    assert StationRange(2.0, (0.0, 0.0), 3.0, 2.0).radius_m == 0.0
    assert station.is_near_border((0.0, 0.0), 8.0)
    assert not StationRange(50.0, (0.0, 0.0), 3.0, 2.0).is_near_border((9.0, 0.0), 8.0)


@pytest.mark.parametrize(("vehicles", "autopilot"), [slow(1, "px4"), (2, "ardupilot")])
def test_the_map_of_a_fixed_plan_is_the_same_in_the_end(autopilot, vehicles):
    # Behind each other, or the first vehicle would start beyond the least range; a PX4 lands up to a metre
    # beside where it started.
    scenario = {**ROWS, "autopilot": autopilot, "vehicles": vehicles}
    whole = fly(Scenario(**scenario))
    for range_m in RANGES_M[vehicles - 1 :]:
        limited = fly(Scenario(**scenario, radio_range_m=max(range_m, 5.5 * (vehicles - 1))))
        assert limited.outcome is Outcome.COMPLETED, limited.reason
        assert np.array_equal(limited.model.value, whole.model.value)
        assert limited.final_score == whole.final_score
        assert [one.camera.images for one in limited.flights] == [one.camera.images for one in whole.flights]
        assert all(one.camera.lost == 0 for one in limited.flights)
        assert [one.flight_time_s for one in limited.flights] == pytest.approx(
            [one.flight_time_s for one in whole.flights], abs=0.5
        )


class Watching:
    """Flies rows, and notes what is told every two seconds."""

    triggers = Triggers(period_s=2.0)

    def __init__(self):
        self.plan = FixedPlan("lawnmower")
        self.observations = []

    def start(self):
        self.observations = []
        self.plan.start()

    def decide(self, observation):
        self.observations.append(observation)
        return self.plan.decide(observation) if len(self.observations) == 1 else NO_CHANGE


def test_a_policy_knows_how_old_is_what_it_sees():
    policy = Watching()
    result = fly(Scenario(**PLACE, vehicles=2, radio_range_m=6.0, policy=policy))
    assert result.outcome is Outcome.COMPLETED
    # Only asked while somebody can be told something; then the other one may be silent.
    reports = [one for observation in policy.observations for one in observation.vehicles]
    silent = [one for one in reports if one.status is Status.SILENT]
    assert silent and all(one.age_s > 2.0 and not one.steerable for one in silent)
    heard = [one for one in reports if one.status is Status.FLYING]
    assert heard and all(one.age_s <= 2.0 for one in heard)
    assert Counter(one.status for one in reports)[Status.LOST] == 0


@pytest.mark.parametrize(
    ("policy", "speed_m_s", "autopilot"),
    [("greedy", 2.0, "ardupilot"), slow("greedy", 5.0, "ardupilot"), slow("rolling-horizon", 2.0, "px4")],
)
def test_beyond_the_range_a_policy_flies_all_that_its_budget_pays_for(policy, speed_m_s, autopilot):
    rows = {"farm": "miniberry-100", "estimator": "adaptive-disk", "estimate_errors": False}
    limits = {"cruise_speed_m_s": speed_m_s, "budget": "150s", "radio_range_m": 30.0}
    scenario = Scenario(**rows, **limits, autopilot=autopilot, policy=policy)
    result = fly(scenario)
    assert result.outcome is Outcome.COMPLETED, result.reason
    assert result.flights[0].flight_time_s > 120.0
    farm, seen = resolve(scenario).farm, result.observations
    x_m, y_m = (farm.cell_size_m * (one + 0.5) for one in (seen.x, seen.y))
    assert np.hypot(x_m - farm.home_m[0], y_m - farm.home_m[1]).max() > 30.0, "it flies beyond, too"
    changes = [one for record in result.decisions[1:] for one in record.changes]
    # A fast vehicle that leaves its mission for a change may be out of range before that is over.
    sure = autopilot == "px4" or speed_m_s < 5.0
    assert (sum(one.outcome == "flown" for one in changes) >= 2) == sure


class GoneTooFar(Watching):
    """Ends its path beyond the range, and wants to fly on when it is heard again."""

    def decide(self, observation):
        self.observations.append(observation)
        return Decision({1: [[8.5, 8.5], [8.5, 7.5]] if len(self.observations) == 1 else [[4.5, 4.5]]})


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_mission_that_ended_unheard_is_completed_and_not_changed_on_the_way_home(autopilot):
    policy = GoneTooFar()
    policy.triggers = Triggers(period_s=0.5)
    options = {**PLACE, "budget": "200m", "autopilot": autopilot, "estimate_errors": False}
    result = fly(Scenario(**options, radio_range_m=7.0, policy=policy))
    assert result.outcome is Outcome.COMPLETED, result.reason
    last = policy.observations[-1]
    assert last.vehicle(1).status is Status.FLYING and last.time_s < 0.5 * result.flights[0].flight_time_s
    outcomes = {one.outcome.partition(":")[0] for record in result.decisions[1:] for one in record.changes}
    assert outcomes <= {"not sent", "flown", "flown already"}


class NearAndFar(Watching):
    """The first vehicle stays near home for long, the second flies far out and back once."""

    def decide(self, observation):
        self.observations.append(observation)
        if len(self.observations) > 1:
            return NO_CHANGE
        near = [[0.5 + 3.0 * (k % 2), 0.5 + 0.04 * k] for k in range(32)]
        return Decision({1: near, 2: [[8.5, 8.5], [8.5, 0.5], [0.5, 0.5]]})


def test_a_vehicle_that_fails_beyond_the_range_is_lost_after_the_time_that_its_plan_explains(monkeypatch):
    monkeypatch.setattr(joint_flight, "FLIGHT_LIMIT_EXTRA_S", 0.0)
    monkeypatch.setattr(joint_flight, "FLIGHT_LIMIT_FACTOR", 2.0)
    policy = NearAndFar()
    # Layers of exact vehicles are thin enough for that range.
    fleet = Scenario(**{**PLACE, "budget": "200m"}, vehicles=2, radio_range_m=7.0, estimate_errors=False)
    assert fly(scenario_with(fleet, {"policy": policy})).outcome is Outcome.COMPLETED
    reports = [(one.time_s, one.vehicle(2)) for one in policy.observations]
    assert all(one.status is not Status.LOST for _, one in reports)
    away_s = next(time_s for time_s, one in reports if one.status is Status.SILENT)
    fly(
        scenario_with(fleet, {"policy": policy}),
        by=Simulated(faults=[f"motor-failure,vehicle=2,at=armed,from={away_s - 1.0}"]),
    )
    assert policy.observations[-1].event is not Event.START
    reports = [one.vehicle(2) for one in policy.observations]
    silent = [one.age_s for one in reports if one.status is Status.SILENT]
    lost = [one.age_s for one in reports if one.status is Status.LOST]
    assert lost and SILENT_S < max(silent) < min(lost) < SILENT_S + 40.0
    assert (
        next(one for one in policy.observations if one.vehicle(2).status is Status.LOST).event is Event.LOST
    )


@sweep(1, 10)
@given(
    autopilot=st.sampled_from(AUTOPILOTS),
    range_m=st.floats(3.5, 14.0),
    vehicles=st.integers(1, 2),
    seed=st.integers(0, 99),
)
@example(autopilot="px4", range_m=4.0, vehicles=2, seed=66)
def test_whatever_the_range_it_ends_at_home_within_its_battery(autopilot, range_m, vehicles, seed):
    scenario = Scenario(
        farm="miniberry-30",
        estimator="point",
        policy="greedy",
        budget="70s",
        altitude_m=3.0,
        autopilot=autopilot,
        vehicles=vehicles,
        radio_range_m=max(range_m, 5.5 * (vehicles - 1)),
        seed=seed,
    )
    result = fly(scenario)
    for one, vehicle in zip(result.flights, resolve(scenario).vehicles, strict=True):
        assert one.outcome is Outcome.COMPLETED, one.reason
        end = one.track.x_m[-1], one.track.y_m[-1]
        # A PX4 whose estimate of its velocity errs drifts by a metre while it lands.
        assert np.hypot(*np.subtract(end, vehicle.task.request.start_xy_m)) < 1.5
        assert one.flight_time_s <= 70.0 * 1.15 and one.battery_used < 0.8
        assert one.camera.lost == 0


def test_the_papers_robot_does_not_come_home_and_is_given_up():
    robot = {"farm": "miniberry-30", "vehicle": "ideal", "estimator": "point", "planner": "lawnmower"}
    result = fly(Scenario(**robot, budget="100steps", radio_range_m=12.0))
    assert result.outcome is Outcome.LINK_LOST and "beyond radio range" in result.reason
    assert 0 < len(result.observations) < 100


def test_a_vehicle_beyond_the_range_at_its_start_is_refused():
    with pytest.raises(ScenarioError, match=r"radio range 3 m: vehicle 2 starts 4\.0 m .*give more than 4 m"):
        fly(Scenario(**ROWS, vehicles=2, radio_range_m=3.0))
    with pytest.raises(ScenarioError, match=r"radio range 0\.5 is out of range"):
        Scenario(radio_range_m=0.5)
