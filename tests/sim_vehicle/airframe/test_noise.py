import math

import numpy as np
import pytest

from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe import navigation_errors as navigation
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.navigation_errors import BLOCK, GRID_S, NavigationErrors, SensorNoise
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.mavlink.fleet import Fleet

HOME = GeoPoint(28.05, -82.15, 12.0)
QUAD = get_vehicle("quad")


def errors_over(noise, count, every=1):
    errors = NavigationErrors(noise)
    return np.array([errors.at(k * every * GRID_S) for k in range(count)])


@pytest.fixture(scope="module")
def many():
    """The errors of many vehicles after 0, 60 and 300 s: float64[runs, times, 7]."""
    rows = []
    for seed in range(300):
        errors = NavigationErrors(SensorNoise(3.0, 0.8, seed=seed))
        rows.append([errors.at(time_s) for time_s in (0.0, 60.0, 300.0)])
    return np.array(rows)


def test_sizes_are_what_was_asked_for(many):
    later = many[:, 2]
    up = 9.2 / 4.7
    expected = {
        "gps_east_m": 3.0 * math.hypot(1.0, 0.4 / 4.7),
        "gps_north_m": 3.0 * math.hypot(1.0, 0.4 / 4.7),
        "gps_up_m": 3.0 * up * math.hypot(1.0, 0.7 / 9.2),
        "east_m": 3.0,
        "north_m": 3.0,
    }
    names = navigation.SensorErrors._fields
    for name, size in expected.items():
        column = later[:, names.index(name)]
        assert column.std() == pytest.approx(size, rel=0.1), name
        assert abs(column.mean()) < 0.15 * size
    correlation = np.corrcoef(later[:, :6].T)
    assert abs(correlation[0, 1]) < 0.15 and abs(correlation[0, 5]) < 0.15


def test_slow_errors_have_the_time_constant_of_the_source(many):
    for lag_s, place in ((60.0, 1), (300.0, 2)):
        for axis in (0, 1):
            measured = np.corrcoef(many[:, 0, axis], many[:, place, axis])[0, 1]
            assert measured == pytest.approx(math.exp(-lag_s / navigation.TIME_CONSTANT_S), abs=0.05)


def test_the_height_is_zeroed_on_the_ground_and_drifts_away(many):
    names = navigation.SensorErrors._fields
    height = many[:, :, names.index("up_m")]
    assert np.abs(height[:, 0]).max() < 0.15
    # A Gauss-Markov process less its beginning: variance 2 sigma^2 (1 - exp(-t/T)).
    for place, time_s in ((1, 60.0), (2, 300.0)):
        size = 0.8 * math.sqrt(2.0 * -math.expm1(-time_s / navigation.BAROMETER_TIME_CONSTANT_S))
        assert height[:, place].std() == pytest.approx(size, rel=0.12)


def test_white_noise_is_on_the_sensor_and_smoothed_in_the_estimate():
    rows = errors_over(SensorNoise(2.0, 1.0, seed=8), 4000)
    names = navigation.SensorErrors._fields
    for read, believed, size in (
        ("gps_east_m", "east_m", 2.0 * 0.4 / 4.7),
        ("barometer_m", "up_m", navigation.BAROMETER_WHITE),
    ):
        steps = np.diff(rows[:, names.index(read)])
        assert steps.std() == pytest.approx(math.sqrt(2.0) * size, rel=0.06)
        assert np.corrcoef(steps[:-1], steps[1:])[0, 1] == pytest.approx(-0.5, abs=0.06)
        assert np.diff(rows[:, names.index(believed)]).std() < 0.1 * steps.std()
        # The estimate follows the sensor, late by the filter, and not beside it.
        between = rows[:, names.index(read)] - rows[:, names.index(believed)]
        assert abs(between.mean()) < 0.1 * size


def test_errors_do_not_depend_on_when_they_are_asked_for():
    noise = SensorNoise(1.5, 0.4, seed=np.random.SeedSequence(4, spawn_key=(7,)))
    whole = errors_over(noise, 2 * BLOCK + 50)
    errors = NavigationErrors(noise)
    for index in (0, 3, 700, 2 * BLOCK + 40, BLOCK + 1, 2 * BLOCK + 41):
        assert errors.at(index * GRID_S) == pytest.approx(tuple(whole[index]), abs=1e-6)
    half = NavigationErrors(noise).at(10.05)
    assert half.east_m == pytest.approx(0.5 * (whole[100, 0] + whole[101, 0]), abs=1e-9)
    np.testing.assert_array_equal(errors_over(noise, 300), whole[:300])
    # Long after, what is forgotten is the oldest that is known.
    errors.at(10 * BLOCK * GRID_S)
    assert math.isfinite(errors.at(0.0).east_m)


@pytest.mark.parametrize("values", [(-1.0,), (math.nan,), (101.0,), (1.0, -0.1), (1.0, math.inf)])
def test_noise_that_makes_no_sense_is_refused(values):
    with pytest.raises(VehicleError, match="sensor noise"):
        SensorNoise(*values)


# Truth and belief.


def test_aloft_the_vehicle_is_beside_what_it_believes_and_on_the_ground_it_stands():
    errors = NavigationErrors(SensorNoise(2.0, 1.0, seed=1))
    error = errors.at(200.0)
    aloft = errors.sense((10.0, 20.0, 30.0), 200.0)
    assert aloft.believed_m == pytest.approx((10.0, 20.0, 30.0))
    assert aloft.true_m == pytest.approx((10.0 - error.east_m, 20.0 - error.north_m, 30.0 - error.up_m))
    assert aloft.gps_m[0] - aloft.true_m[0] == pytest.approx(error.gps_east_m)
    assert aloft.barometer_m - aloft.true_m[2] == pytest.approx(error.barometer_m)
    standing = errors.sense((10.0, 20.0, 0.0), 200.0)
    assert standing.true_m[2] == 0.0
    assert standing.believed_m[2] == error.up_m
    heights = [errors.sense((0.0, 0.0, z), 200.0).true_m[2] for z in np.linspace(0.0, 20.0, 200)]
    assert np.all(np.diff(heights) > 0.0)


# On the wire.


def told(vehicle, message_id, now_s):
    vehicle.poll(now_s)
    (message,) = vehicle.built(message_id)
    return message


def metres(vehicle, latitude_e7, longitude_e7):
    return vehicle.pilot.frame.from_wgs84(latitude_e7 / 1e7, longitude_e7 / 1e7)


@pytest.mark.parametrize(
    ("autopilot", "kind"),
    [("px4", m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION), ("ardupilot", m.MAVLINK_MSG_ID_SIM_STATE)],
)
def test_messages_tell_belief_sensor_and_truth(autopilot, kind):
    vehicle = SimVehicle(QUAD, HOME, autopilot=get_autopilot(autopilot), noise=SensorNoise(3.0, 0.5, seed=6))
    now_s = 40.0
    believed = told(vehicle, m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, now_s)
    read = told(vehicle, m.MAVLINK_MSG_ID_GPS_RAW_INT, now_s)
    true = told(vehicle, kind, now_s)
    error = vehicle.errors.at(now_s)
    place = (true.lat_int, true.lon_int) if autopilot == "ardupilot" else (true.lat, true.lon)
    assert metres(vehicle, believed.lat, believed.lon) == pytest.approx((0.0, 0.0), abs=0.02)
    assert metres(vehicle, *place) == pytest.approx((-error.east_m, -error.north_m), abs=0.02)
    assert metres(vehicle, read.lat, read.lon) == pytest.approx(
        (error.gps_east_m - error.east_m, error.gps_north_m - error.north_m), abs=0.02
    )
    assert read.alt / 1000.0 == pytest.approx(12.0 + error.gps_up_m, abs=0.002)
    altitude = true.alt if autopilot == "ardupilot" else true.alt / 1000.0
    assert altitude == pytest.approx(12.0, abs=0.001)
    assert believed.relative_alt == pytest.approx(1000.0 * error.up_m, abs=1.0)
    # HDOP and accuracies agree: h_acc is HDOP times the ranging error.
    assert (read.eph, read.epv) == (130, 180)
    assert read.h_acc == pytest.approx(1000.0 * math.sqrt(2.0) * 3.0, abs=1)
    assert read.v_acc == pytest.approx(1000.0 * 3.0 * 9.2 / 4.7, abs=1)
    assert vehicle.schedule.interval_us(kind) == 100_000
    pressure = told(vehicle, m.MAVLINK_MSG_ID_SCALED_PRESSURE, now_s).press_abs
    expected = 1013.25 * (1.0 - 2.25577e-5 * (12.0 + error.barometer_m)) ** 5.25588
    assert pressure == pytest.approx(expected, abs=1e-3)


def test_each_vehicle_has_its_own_errors_and_the_first_those_that_were_given():
    noise = SensorNoise(1.0, seed=9)
    fleet = Fleet(QUAD, HOME, 3, noise=noise)
    at = [vehicle.errors.at(5.0).east_m for vehicle in fleet.vehicles]
    assert at[0] == NavigationErrors(noise).at(5.0).east_m
    assert len(set(at)) == 3
