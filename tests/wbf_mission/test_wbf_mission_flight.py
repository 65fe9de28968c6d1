"""Whole flights, from the plan to the score."""

from dataclasses import replace

import numpy as np
import pytest
from stand_in import heard

from mission.files import write_mission
from mission.model import Command, Mission, MissionItem
from mission.outcome import Outcome
from sensors.estimation import RunEstimate
from sim_vehicle.host.simulation import Impairment
from wbf_mission.events import Found
from wbf_mission.exit_codes import exit_code_of_flight
from wbf_mission.flight import Simulated, fly
from wbf_mission.preflight.finding import PreflightError
from wbf_mission.run.plan import plan
from wbf_mission.run.resolve import make_environment
from wbf_mission.scenario import Scenario, ScenarioError, scenario_with

IDEAL = Scenario(farm="miniberry-10", planner="lawnmower", vehicle="ideal", seed=3, estimator="adaptive-disk")
QUAD = Scenario(
    farm="miniberry-30", planner="spiral", vehicle="quad", budget="150m", seed=3, estimator="adaptive-disk"
)


@pytest.fixture(scope="module")
def quad_flight():
    return fly(QUAD)


def test_the_quad_flies_what_was_planned_and_looks_all_the_way(quad_flight):
    result = quad_flight
    assert result.outcome is Outcome.COMPLETED, result.reason
    assert result.transfers[0].verified
    assert result.flight_time_s == pytest.approx(result.plan.prediction.duration_s, rel=0.05)
    assert result.battery_used == pytest.approx(result.plan.battery_used, rel=0.05)
    # By its estimate it wanders a little while it climbs and lands.
    assert result.track.length_m == pytest.approx(result.plan.length_m, rel=0.15)
    cells = result.plan.length_m / result.farm.cell_size_m
    assert 0.6 * cells < len(result.observations) < 1.2 * cells
    assert result.truth is not None
    seen = result.observations
    assert np.array_equal(seen.values, result.truth[:, seen.x, seen.y].T)


def test_equal_scenarios_give_equal_bytes(tmp_path):
    rough = {"wind_speed_m_s": 4.0, "wind_gust_m_s": 1.0, "camera_noise": 0.1, "false_negative_rate": 0.1}
    windy = scenario_with(QUAD, {"budget": "80m", **rough})
    first = fly(windy, by=Simulated(tlog=tmp_path / "first.tlog"))
    second = fly(windy, by=Simulated(tlog=tmp_path / "second.tlog"))
    other = fly(replace(windy, seed=4), by=Simulated(tlog=tmp_path / "other.tlog"))
    assert (tmp_path / "first.tlog").read_bytes() == (tmp_path / "second.tlog").read_bytes()
    assert (tmp_path / "first.tlog").read_bytes() != (tmp_path / "other.tlog").read_bytes()
    assert np.array_equal(first.observations.values, second.observations.values)
    assert first.history.scores == second.history.scores
    assert not np.array_equal(first.truth, other.truth)


def test_a_bad_radio_costs_time_but_no_picture(quad_flight):
    radio = Impairment(loss=0.1, duplication=0.05, delay_s=0.05, jitter_s=0.1, seed=2)
    result = fly(QUAD, by=Simulated(impairment=radio))
    assert result.outcome is Outcome.COMPLETED, result.reason
    assert result.transfers[0].verified
    assert result.transfers[0].retries > 0
    assert len(result.observations) == pytest.approx(len(quad_flight.observations), abs=20)


def test_no_contact_is_an_outcome():
    result = fly(QUAD, by=Simulated(impairment=Impairment(loss=1.0)))
    assert result.outcome is Outcome.NO_CONTACT
    assert len(result.observations) == 0
    assert result.summary()["outcome"] == "no_contact"


def test_an_item_that_cannot_be_flown_is_an_outcome(tmp_path):
    made = plan(QUAD).mission
    broken = Mission(
        (*made.items[:3], MissionItem(Command.NAV_SPLINE_WAYPOINT, 0), *made.items[3:]), made.home
    )
    path = tmp_path / "spline.plan"
    write_mission(broken, path)
    scenario = scenario_with(QUAD, {"mission": str(path)})
    with pytest.raises(PreflightError, match="nothing was flown, --force does it nevertheless"):
        fly(scenario)
    result = fly(scenario, by=Simulated(force=True))
    assert result.outcome in (Outcome.UPLOAD_FAILED, Outcome.MISSION_REJECTED)
    assert result.reason


def test_a_battery_that_does_not_last_is_an_outcome(tmp_path):
    small = tmp_path / "small.toml"
    small.write_text('kind = "multirotor"\nbase = "quad"\n[battery]\ncapacity_wh = 6.0\n')
    back_and_forth = {"vehicle": str(small), "planner": "random-waypoint", "budget": "1km"}
    long = plan(scenario_with(QUAD, back_and_forth))
    path = tmp_path / "long.plan"
    write_mission(long.mission, path)
    scenario = scenario_with(QUAD, {"vehicle": str(small), "mission": str(path), "score_points": 1})
    events, told = heard(Found)
    result = fly(scenario, by=Simulated(force=True), events=events)
    assert [(each.code, each.refuses) for each in told] == [("battery", False)]
    assert result.outcome in (Outcome.BATTERY_LOW, Outcome.BATTERY_DEPLETED), result.reason
    assert result.battery_used is not None
    assert result.battery_used > 0.75
    assert len(result.observations) > 0


def test_ctrl_c_keeps_what_was_seen(monkeypatch):
    learned = []
    original = RunEstimate.add

    def add(self, parts, offset_s=0.0):
        original(self, parts, offset_s)
        learned.append(sum(map(len, parts)))
        if sum(learned) > 100:
            raise KeyboardInterrupt

    monkeypatch.setattr(RunEstimate, "add", add)
    result = fly(QUAD)
    assert result.outcome is Outcome.INTERRUPTED
    assert len(result.observations) >= 100
    assert result.history.entries
    assert exit_code_of_flight(result.outcome) == 130


def test_the_environment_is_the_seeds_alone():
    farm = plan(IDEAL).farm
    first = make_environment(IDEAL, farm).values(6)
    again = make_environment(scenario_with(IDEAL, {"planner": "spiral", "vehicle": "quad"}), farm).values(6)
    assert np.array_equal(first, again)


@pytest.mark.parametrize("job", [fly, plan])
def test_what_is_no_scenario_is_refused(job):
    with pytest.raises(ScenarioError, match=r"the scenario is a dict: give a Scenario: write Scenario\(\*\*"):
        job({"farm": "miniberry-10"})
    with pytest.raises(ScenarioError, match=r"the scenario is a str: give a Scenario$"):
        job("miniberry-10")
