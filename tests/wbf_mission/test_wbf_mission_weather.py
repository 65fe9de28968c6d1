import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from geo import get_farm
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.weather.atmosphere import LEVELS_W20_M_S
from wbf_mission.addons.base.simulator import make_components
from wbf_mission.flight import fly
from wbf_mission.planning import MissionBuilder
from wbf_mission.planning.conditions import flight_level, noise_of, wind_of, wind_of_run
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError
from wbf_mission.scenario.values import shear_values, turbulence_value

WINDY = Scenario(
    farm="miniberry-10",
    planner="lawnmower",
    estimator="adaptive-disk",
    seed=5,
    wind_speed_m_s=5.0,
    wind_direction_deg=250.0,
    wind_shear="log",
    turbulence="wind",
)
LOST = replace(WINDY, gps_noise_m=1.5, baro_noise_m=0.4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wind_shear": "linear"}, "wind shear 'linear': choose log, power, sitl"),
        ({"wind_roughness_m": 0.0}, "wind roughness"),
        ({"turbulence": "awful"}, "turbulence 'awful': choose light, moderate, severe, wind"),
        ({"turbulence": math.nan}, "turbulence nan"),
        ({"turbulence": "light", "wind_gust_m_s": 1.0}, "give only one of the two"),
        ({"baro_noise_m": 99.0}, "baro noise"),
    ],
)
def test_weather_that_makes_no_sense_is_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        Scenario(**changes)


def test_the_wind_of_a_scenario():
    wind = wind_of_run(WINDY)
    assert wind.turbulence is not None
    w20 = 5.0 * math.log(6.096 / 0.1) / math.log(10.0 / 0.1)
    assert wind.turbulence.w20_m_s == pytest.approx(w20)
    assert math.hypot(*wind.mean_at(10.0)) == pytest.approx(5.0)
    level = wind_of_run(replace(WINDY, turbulence="severe", altitude_m=25.0, cruise_speed_m_s=3.0)).turbulence
    assert level is not None
    assert (level.w20_m_s, level.height_m) == (LEVELS_W20_M_S["severe"], 25.0)
    assert level.airspeed_m_s == pytest.approx(math.hypot(3.0, *wind.mean_at(25.0)))
    told = wind_of(WINDY.weather, flight_level(WINDY.mission, WINDY.vehicle), gusts=False)
    assert told.turbulence is None and told.mean_at(30.0) == wind.mean_at(30.0)
    assert noise_of(WINDY.vehicle, 5).is_off


def test_options():
    assert shear_values("log, 0.03, 2") == {
        "wind_shear": "log",
        "wind_roughness_m": 0.03,
        "wind_height_m": 2.0,
    }
    assert turbulence_value("moderate") == "moderate"
    for wrong in ("linear", "log,a", "log,1,2,3", "sitl,60", ""):
        with pytest.raises(ScenarioError, match="--wind-shear"):
            shear_values(wrong)


def test_a_wind_too_strong_at_the_height_of_the_flight_is_refused():
    calm_below = Scenario(wind_speed_m_s=12.0, wind_height_m=2.0, wind_shear="log", altitude_m=60.0)
    with pytest.raises(ScenarioError, match="blown away"):
        plan(calm_below)


@pytest.fixture(scope="module")
def flights():
    return fly(WINDY), fly(LOST)


def test_noise_leaves_the_wind_and_the_belief_alone(flights):
    sure, lost = flights
    assert sure.outcome.is_good and lost.outcome.is_good
    assert lost.battery_used == sure.battery_used
    # The last centimetres above the ground are told with the error of the height.
    assert lost.flight_time_s == pytest.approx(sure.flight_time_s, abs=0.5)
    np.testing.assert_array_equal(lost.track.x_m, sure.track.x_m)
    np.testing.assert_array_equal(lost.track.y_m, sure.track.y_m)


def test_the_truth_is_beside_what_was_believed(flights):
    sure, lost = flights
    assert sure.true_track is None and sure.summary()["position_error_m"] is None
    assert lost.true_track is not None
    error_m = lost.track.distance_m(lost.true_track)
    told = lost.summary()["position_error_m"]
    assert told == {"rms": pytest.approx(np.sqrt(np.mean(error_m**2))), "max": error_m.max()}
    assert 0.1 < told["rms"] < 6.0
    heights = lost.true_track.altitude_m
    assert heights.min() >= 0.0 and heights[-1] == 0.0


def test_errors_of_place_cost_score_and_put_leaves_into_wrong_cells(flights):
    sure, lost = flights
    assert sure.truth is not None and sure.model is not None and lost.model is not None
    for result, right in ((sure, True), (lost, False)):
        seen = result.observations
        truth = sure.truth[:, seen.x, seen.y].T
        assert np.allclose(seen.values, truth) == right
    assert lost.history.entries[-1].score < sure.history.entries[-1].score


def test_an_ardupilot_tells_the_truth_too():
    result = fly(replace(LOST, autopilot="ardupilot"))
    assert result.outcome.is_good and result.true_track is not None
    assert len(result.true_track.time_s) > 0.8 * len(result.track.time_s)


def test_the_simulator_has_the_weather_and_the_errors():
    simulated = make_components(LOST, count=2, with_camera=False)
    first, second = simulated.vehicles
    assert first.errors is not None and second.errors is not None
    assert first.errors.at(9.0) != second.errors.at(9.0)
    assert first.pilot.state.wind_m_s != (0.0, 0.0)
    assert make_components(WINDY, with_camera=False).vehicle.errors is None


@pytest.mark.parametrize("vehicle", ["quad", "mini-quad"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_greatest_speeds_bound_the_wind_and_the_cruise_speed(vehicle, autopilot):
    flown = with_autopilot(get_vehicle(vehicle), autopilot)
    limits = {"wind_speed_m_s": flown.airspeed_limit_m_s, "cruise_speed_m_s": flown.fastest_m_s}
    for name, fastest in limits.items():
        for share in (0.99, 1.01):
            values = {name: share * fastest, "vehicle": vehicle, "autopilot": autopilot}
            scenario = Scenario(farm="miniberry-10", altitude_m=10.0, **values)
            refused = pytest.raises(ScenarioError, match=f"at most {fastest:.3g} m/s")
            with refused if share > 1.0 else nullcontext():
                MissionBuilder.of(scenario, get_farm("miniberry-10"))
