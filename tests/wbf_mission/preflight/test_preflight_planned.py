"""What our own planners make has no errors, whoever flies it."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sweeps import slow, sweep

from mission.errors import PlanningError
from wbf_mission.preflight.finding import Severity
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario

PLANNERS = ("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint")
VEHICLES = (("quad", "px4"), ("quad", "ardupilot"), ("fixed-wing", "px4"), ("fixed-wing", "ardupilot"))


COMBINATIONS = [
    # A fixed wing flies thousands of random waypoints in these minutes.
    pytest.param(*vehicle, planner, marks=pytest.mark.slow if wide else ())
    for vehicle in VEHICLES
    for planner in PLANNERS
    for wide in [vehicle[0] == "fixed-wing" and planner == "random-waypoint"]
]


@pytest.mark.parametrize(("vehicle", "autopilot", "planner"), COMBINATIONS)
@sweep(few=1, many=5)
@given(
    farm=st.sampled_from(("miniberry-10", "miniberry-30")),
    minutes=st.integers(2, 4),
    wind=st.sampled_from(((0.0, 0.0), (4.0, 250.0))),
    seed=st.integers(0, 1000),
)
@example(farm="miniberry-30", minutes=4, wind=(4.0, 250.0), seed=7)
def test_no_planner_makes_a_plan_with_an_error(planner, vehicle, autopilot, farm, minutes, wind, seed):
    scenario = Scenario(
        farm=farm,
        planner=planner,
        budget=f"{minutes}min",
        vehicle=vehicle,
        autopilot=autopilot,
        wind_speed_m_s=wind[0],
        wind_direction_deg=wind[1],
        seed=seed,
        # A plan is checked as if the estimate were exact.
        estimate_errors=False,
    )
    try:
        made = plan(scenario)
    except PlanningError:
        return  # no path within the budget
    checked = check_mission(made.mission, Circumstances(scenario.vehicle, scenario.weather, made.farm))
    assert not checked.report.has_errors, [str(one) for one in checked.report.of(Severity.ERROR)]
    assert checked.subject.prediction.duration_s == pytest.approx(made.prediction.duration_s, rel=1e-6)


ROWS = ("lawnmower", "adaptive-lawnmower", "spiral")
QUICK = [*(("miniberry-30", "quad", planner) for planner in ROWS), ("miniberry-30", "rover", "lawnmower")]
FITTING = [
    *QUICK,
    *(
        slow(*one)
        for one in (
            *(("miniberry-30", "mapping-quad", planner) for planner in ROWS),
            *(("miniberry-30", "rover", planner) for planner in ROWS[1:]),
            ("miniberry-100", "quad", "spiral"),
            ("waterberry", "quad", "lawnmower"),
            ("waterberry", "fixed-wing", "lawnmower"),
            ("waterberry", "fixed-wing", "spiral"),
        )
    ),
]


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(("farm", "vehicle", "planner"), FITTING)
def test_a_plan_for_the_whole_battery_of_a_vehicle_that_fits_the_farm_has_no_warning(
    farm, vehicle, planner, autopilot
):
    scenario = Scenario(farm=farm, planner=planner, vehicle=vehicle, autopilot=autopilot)
    made = plan(scenario)
    assert made.warnings == []
    report = check_mission(made.mission, Circumstances(scenario.vehicle, scenario.weather, made.farm)).report
    assert [str(one) for one in report.findings if one.severity is not Severity.NOTE] == []


def test_an_autopilot_that_ignores_a_parameter_is_counted_the_same_everywhere():
    scenario = Scenario(
        farm="miniberry-30", planner="lawnmower", autopilot="ardupilot", acceptance_radius_m=2.0
    )
    made = plan(scenario)
    (remark,) = made.rendered.remarks
    report = check_mission(made.mission, Circumstances(scenario.vehicle, scenario.weather, made.farm)).report
    (found,) = [one for one in report.findings if one.code == "autopilot-ignores"]
    waypoints = sum(item.command == 16 for item in made.mission.items)
    assert remark.count == found.count == remark.summary()["count"] == waypoints > 50
    assert remark.item is not None and found.item == remark.item + 1
    assert str(found) == str(remark)
