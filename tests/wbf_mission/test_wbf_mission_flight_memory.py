"""Flights that are flown once for several runs: the runs are those that fly on their own."""

import numpy as np
import pytest

from mission.files import write_mission
from mission.outcome import Outcome
from wbf_mission.flight import Simulated, fly
from wbf_mission.run.plan import plan
from wbf_mission.run.reuse import FlightMemory
from wbf_mission.scenario import Scenario, scenario_with

BASE = Scenario(farm="miniberry-10", vehicle="ideal", budget="30steps", planner="spiral", estimator="point")
EXACT = {"vehicle": "quad", "budget": "60m", "estimate_errors": False}


def assert_alike(one, other):
    assert one.history == other.history
    assert one.outcome is Outcome.COMPLETED and other.outcome is Outcome.COMPLETED
    for name in ("x", "y", "time_s", "day", "values"):
        np.testing.assert_array_equal(getattr(one.observations, name), getattr(other.observations, name))
    assert one.model is not None and other.model is not None
    np.testing.assert_array_equal(one.model.value, other.model.value)
    np.testing.assert_array_equal(one.track.x_m, other.track.x_m)
    assert timeless(one) == timeless(other)


def timeless(run):
    summary = run.summary()
    for key in ("wall_time_s", "realtime_factor", "timings_s"):
        del summary[key]
    summary["decisions"] = [{**one, "compute_s": 0.0} for one in summary["decisions"]]
    return summary


@pytest.mark.parametrize(
    ("changes", "flown"),
    [
        pytest.param({}, 1, id="ideal"),
        pytest.param({"vehicle": "quad", "budget": "60m", "autopilot": "ardupilot"}, 1, id="quad"),
        pytest.param({"vehicle": "quad", "budget": "60m"}, 2, id="PX4's estimate"),
        pytest.param({"planner": "random-waypoint"}, 2, id="planner that draws"),
        pytest.param({**EXACT, "wind_gust_m_s": 2.0}, 2, id="gusts"),
        pytest.param({"days": 2, "flights_per_day": 2, "camera_noise": 0.1}, 1, id="days"),
    ],
)
def test_runs_with_a_memory_are_those_that_fly_on_their_own(changes, flown):
    memory = FlightMemory()
    for seed, estimator in ((1, "point"), (1, "adaptive-disk"), (2, "point")):
        scenario = scenario_with(BASE, {**changes, "seed": seed, "estimator": estimator})
        before, run = len(memory), fly(scenario, memory=memory)
        if len(memory) == before:
            assert_alike(run, fly(scenario))
    assert len(memory) == flown


def test_other_missions_and_vehicles_are_other_flights():
    memory = FlightMemory()
    for changes in (
        {},
        {"budget": "40steps"},
        {"camera_footprint": 3},
        {"vehicle": "quad", "budget": "60m"},
        {"vehicle": "quad", "budget": "60m", "autopilot": "ardupilot"},
        {"vehicle": "quad", "budget": "60m", "parameters": {"MPC_ACC_HOR": 2.0}},
    ):
        before = len(memory)
        fly(scenario_with(BASE, changes), memory=memory)
        assert len(memory) == before + 1, changes


def test_equal_missions_under_other_cameras_are_other_flights(tmp_path):
    """A mission of a file is the same whatever the camera sees; what it reads is not."""
    path = str(tmp_path / "rows.plan")
    write_mission(plan(BASE).mission, path)
    memory = FlightMemory()
    given = {"mission": path, "planner": None, "budget": None, "estimator": "point"}
    base = scenario_with(BASE, {**given, "estimate_errors": False})
    for changes in ({}, {"camera_footprint": 3}, {"fields": ["tylcv", "soil"]}):
        scenario, before = scenario_with(base, changes), len(memory)
        assert_alike(fly(scenario, memory=memory), fly(scenario))
        assert len(memory) == before + 1, changes


def test_what_a_policy_flies_depends_on_what_it_sees():
    memory = FlightMemory()
    scenario = scenario_with(BASE, {"policy": "greedy"})
    assert_alike(fly(scenario, memory=memory), fly(scenario))
    assert not len(memory)


def test_one_run_cannot_change_what_another_gets():
    memory = FlightMemory()
    first = fly(BASE, memory=memory)
    record = first.flights[0]
    record.texts.clear()
    record.transfers.clear()
    record.camera.images = 0
    assert_alike(fly(BASE, memory=memory), fly(BASE))


def test_a_flight_with_a_log_is_flown_again(tmp_path):
    memory = FlightMemory()
    for name in ("first", "again"):
        fly(BASE, by=Simulated(tlog=tmp_path / name), memory=memory)
    assert (tmp_path / "first").read_bytes() == (tmp_path / "again").read_bytes()
    assert not len(memory)
