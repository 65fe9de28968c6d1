"""What `plan` predicts against the whole simulated flight over MAVLink."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from sweeps import slow

from geo.farms import get_farm
from mission.errors import PlanningError
from mission.files import write_mission
from mission.outcome import Outcome
from mission.planners import PlannedPath, PlanningRequest, StepBudget
from mission.planners.budget import BatchBudget, LengthBudget
from sim_vehicle.prediction.onward import InFlight
from sim_vehicle.prediction.predict import plan_prediction
from wbf_mission.flight import fly
from wbf_mission.planning import MissionBuilder
from wbf_mission.planning.budget import FlightBudget, make_budget, onward_predictor
from wbf_mission.planning.conditions import wind_of_run
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, scenario_with
from wbf_mission.scenario.parts import WeatherOptions

PLANNERS = ["lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint"]
VEHICLES = [
    ("quad", "px4"),
    ("quad", "ardupilot"),
    ("mapping-quad", "px4"),
    ("mapping-quad", "ardupilot"),
    ("mini-quad", "px4"),
    ("mini-quad", "ardupilot"),
    ("rover", "px4"),
    ("rover", "ardupilot"),
]


def compared(scenario):
    """Return predicted and flown time and energy."""
    result = fly(scenario_with(scenario, {"estimator": "point"}))
    assert result.outcome is Outcome.COMPLETED
    prediction = result.plan.prediction
    assert prediction.feasible
    used = (result.battery_used or 0.0) * (
        result.plan.vehicle.battery.capacity_wh if result.battery_used else 1
    )
    return prediction.duration_s, result.flight_time_s, prediction.energy_wh, used


@pytest.mark.slow
# A flight takes too long for shrinking.
@settings(
    max_examples=16,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
@given(
    farm=st.sampled_from(["miniberry-10", "miniberry-30", "miniberry-100"]),
    planner=st.sampled_from(PLANNERS),
    vehicle=st.sampled_from(VEHICLES),
    minutes=st.sampled_from([4, 5, 6]),
    blows=st.floats(0.0, 4.0),
    direction=st.floats(0.0, 360.0),
    shear=st.sampled_from([None, "log", "power"]),
    seed=st.integers(0, 3),
)
def test_the_flight_takes_what_was_predicted(farm, planner, vehicle, minutes, blows, direction, shear, seed):
    scenario = Scenario(
        farm=farm,
        planner=planner,
        vehicle=vehicle[0],
        autopilot=vehicle[1],
        estimator="point",
        budget=f"{minutes}min",
        wind_speed_m_s=blows,
        wind_direction_deg=direction,
        wind_shear=shear,
        seed=seed,
        estimate_errors=False,
    )
    try:
        predicted_s, flown_s, predicted_wh, flown_wh = compared(scenario)
    except PlanningError:
        assume(False)
    assert predicted_s == pytest.approx(flown_s, rel=0.02)
    # Counted by the ground station in whole mAh, at the beginning and at the end: 0.011 Wh each of a rover.
    assert predicted_wh == pytest.approx(flown_wh, rel=0.03, abs=0.025)


@pytest.mark.parametrize("planner", PLANNERS)
def test_the_ideal_robot_takes_as_many_steps_as_predicted(planner):
    predicted_s, flown_s, _, _ = compared(Scenario(farm="miniberry-10", planner=planner, vehicle="ideal"))
    assert predicted_s - 1.0 <= flown_s <= predicted_s


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("vehicle", ["wing", "fixed-wing"])
def test_a_wing_takes_what_was_predicted(vehicle, autopilot):
    scenario = Scenario(
        farm="waterberry",
        vehicle=vehicle,
        autopilot=autopilot,
        planner="lawnmower",
        estimator="point",
        budget="12min",
        wind_speed_m_s=3.0,
        wind_direction_deg=200.0,
    )
    predicted_s, flown_s, predicted_wh, flown_wh = compared(scenario)
    assert predicted_s == pytest.approx(flown_s, rel=0.02)
    assert predicted_wh == pytest.approx(flown_wh, rel=0.03)


def test_errors_of_the_estimate_are_predicted_by_their_statistics():
    scenario = Scenario(
        farm="miniberry-30", vehicle="quad", planner="lawnmower", estimator="point", budget="3min"
    )
    low_s, high_s = plan(scenario).prediction.duration_interval_s
    flown = [compared(Scenario(**{**scenario.to_dict(), "seed": seed})) for seed in range(5)]
    times_s = [flown_s for _, flown_s, _, _ in flown]
    assert len(set(times_s)) == 5
    assert sum(low_s < time_s < high_s for time_s in times_s) >= 4
    assert flown[0][0] == pytest.approx(np.mean(times_s), rel=0.01)
    exact_s, *_ = compared(Scenario(**{**scenario.to_dict(), "estimate_errors": False}))
    assert exact_s < min(times_s)


@pytest.mark.parametrize("gusts", [{"turbulence": "light"}, slow({"wind_gust_m_s": 1.0})])
def test_gusts_are_predicted_by_their_statistics_only(gusts):
    scenario = Scenario(
        farm="miniberry-30",
        planner="spiral",
        vehicle="mini-quad",
        autopilot="ardupilot",
        estimator="point",
        budget="3min",
        wind_speed_m_s=4.0,
        wind_direction_deg=120.0,
        **gusts,
    )
    flown = [compared(Scenario(**{**scenario.to_dict(), "seed": seed})) for seed in range(4)]
    assert len({one[0] for one in flown}) == 1
    assert len({one[3] for one in flown}) > 1
    predicted_s, flown_s, predicted_wh, flown_wh = np.mean(flown, axis=0)
    assert predicted_s == pytest.approx(flown_s, rel=0.02)
    assert predicted_wh == pytest.approx(flown_wh, rel=0.03)


def test_a_flight_budget_prices_many_paths_as_it_prices_one():
    scenario = Scenario(
        farm="miniberry-30", vehicle="quad", autopilot="px4", budget="3min", wind_speed_m_s=3.0
    )
    result = plan(scenario)
    builder = MissionBuilder.of(scenario, result.farm)
    for unit in ("s", "Wh"):
        budget = FlightBudget(180.0 if unit == "s" else 9.0, unit, builder)
        assert isinstance(budget, BatchBudget)
        home = np.array([result.farm.home_m])
        paths = [np.vstack((home, result.path_m[:n])) for n in (1, 3, 5)]
        assert budget.costs(paths) == [budget.cost(path) for path in paths]
        assert np.isfinite(budget.costs(paths)).all()
    limit, _ = make_budget(scenario.mission.budget, builder)
    request = PlanningRequest(result.farm.owner_area, result.farm.home_m, limit)
    assert request.costs([result.path_m]) == [request.cost(result.path_m)]
    plain = PlanningRequest(result.farm.owner_area, result.farm.home_m, LengthBudget(1000.0))
    assert plain.costs([path[1:] for path in paths]) == [plain.cost(path[1:]) for path in paths]


def test_a_mission_predicted_again_is_not_flown_again(monkeypatch):
    scenario, flown = Scenario(farm="miniberry-30", vehicle="quad", autopilot="px4"), []
    farm = get_farm("miniberry-30")
    builder, path = MissionBuilder.of(scenario, farm), np.array([[20.0, 20.0], [20.0, 40.0]])
    short, long = (
        [builder.mission(PlannedPath(path[:count].copy(), None, name)) for name in ("search", "plan")]
        for count in (1, 2)
    )

    def counted(mission, *args, **how):
        flown.append(mission)
        return plan_prediction(mission, *args, **how)

    monkeypatch.setattr("wbf_mission.planning.builder.plan_prediction", counted)
    found = [builder.predict(mission) for mission in (*short, *long, short[0])]
    assert flown == [short[0], long[0], short[0]]
    for mission, prediction in zip((*short, *long, short[0]), found, strict=True):
        fresh = MissionBuilder.of(scenario, farm).predict(mission)
        assert fresh.track_m.tobytes() == prediction.track_m.tobytes()
        assert fresh.energy_wh == prediction.energy_wh and fresh.duration_s == prediction.duration_s
    assert replace(builder, weather=WeatherOptions(wind_speed_m_s=4.0)).predict(short[0]) is not found[-1]


def ideal_looks(farm, path_m, folder):
    """Fly a path as the ideal robot; return the cells that it looked at, and how many steps it took."""
    scenario = Scenario(farm=farm.name, vehicle="ideal", planner="spiral", budget="20steps")
    builder = MissionBuilder.of(scenario, farm)
    mission = builder.mission(PlannedPath(path_m, None, "test"))
    priced = StepBudget(20.0, farm.cell_size_m).cost(np.vstack((farm.home_m, path_m)))
    assert builder.predict(mission).duration_s == priced * builder.vehicle.step_s
    write_mission(mission, folder / "path.plan")
    file = str(folder / "path.plan")
    seen = fly(Scenario(farm=farm.name, vehicle="ideal", mission=file, estimator="point")).observations
    return Counter(zip(seen.x.tolist(), seen.y.tolist(), strict=True)), priced


@pytest.mark.parametrize("at", [0, 1, 2])
def test_the_ideal_robot_stays_and_looks_as_often_as_its_path_says(tmp_path, at):
    farm = get_farm("miniberry-10")
    cells = np.array([(3, 0), (3, 2), (5, 2)])
    path_m = np.array(farm.home_m) + farm.cell_size_m * cells
    looks, steps = ideal_looks(farm, path_m, tmp_path)
    staying, longer = ideal_looks(farm, np.insert(path_m, at, [path_m[at]] * 2, axis=0), tmp_path)
    assert longer == steps + 2
    assert staying - looks == {tuple(cells[at].tolist()): 2} and not looks - staying


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_who_may_be_carried_over_an_edge_near_home_pays_for_the_dearer_side(autopilot):
    # PX4 returns at 30 m from beyond 10 m (RTL_MIN_DIST); with an exact estimate it turns home from within.
    farm = get_farm("miniberry-100")
    x, y = farm.home_m
    here = InFlight((x + 5.0, y), 10.0, (1.0, 0.0))
    whole = [np.array([(x, y), (x + 5.0, y), (x + length_m, y)]) for length_m in (8.0, 10.1, 14.0)]
    rests = [np.array([(x + length_m, y)]) for length_m in (8.0, 9.7, 14.0)]
    costs = {}
    for errs in (False, True):
        scenario = Scenario(
            farm="miniberry-100", planner="spiral", autopilot=autopilot, budget="5min", estimate_errors=errs
        )
        builder = MissionBuilder.of(scenario, farm)
        seconds, _ = onward_predictor(builder).rest(here, rests)
        costs[errs] = np.array([FlightBudget(300.0, "s", builder).costs(whole), seconds])
    dearer = costs[True] - costs[False]
    if autopilot == "px4":
        assert (dearer[:, 1] > 20.0).all()
        dearer = dearer[:, [0, 2]]
    assert not dearer.any()


def test_too_much_wind_is_known_before_the_flight():
    scenario = Scenario(
        farm="miniberry-30",
        vehicle="quad",
        autopilot="px4",
        budget="5min",
        wind_speed_m_s=9.0,
        turbulence="severe",
    )
    assert wind_of_run(scenario).is_gusty
    with pytest.raises(PlanningError, match="less wind"):
        plan(scenario)


FROM_WEST = {"wind_speed_m_s": 5.0, "wind_direction_deg": 270.0}


@pytest.mark.parametrize(
    ("planner", "autopilot", "wind"),
    [
        ("random-waypoint", "px4", {}),
        slow("random-waypoint", "px4", {**FROM_WEST, "wind_gust_m_s": 1.0}),
        slow("spiral", "px4", {**FROM_WEST, "wind_gust_m_s": 2.0}),
        ("random-waypoint", "ardupilot", {**FROM_WEST, "wind_gust_m_s": 2.0}),
    ],
)
def test_flights_for_the_whole_battery_come_home_with_its_reserve(planner, autopilot, wind, tmp_path):
    small = tmp_path / "small.toml"
    small.write_text('kind = "multirotor"\nbase = "quad"\n[battery]\ncapacity_wh = 9.0\n')
    scenario = Scenario(
        farm="miniberry-30",
        planner=planner,
        vehicle=str(small),
        autopilot=autopilot,
        estimator="point",
        **wind,
    )
    for seed in (1, 2):
        result = fly(Scenario(**{**scenario.to_dict(), "seed": seed}))
        assert result.outcome is Outcome.COMPLETED, seed
        # Spared for chance, not wasted: the ratio of bound and price is learned from a path like it.
        assert result.plan.prediction.most_wh <= 1.05 * 7.2
        if planner == "random-waypoint":
            assert result.plan.prediction.most_wh >= 0.95 * 7.2
