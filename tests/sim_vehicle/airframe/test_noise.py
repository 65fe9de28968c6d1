import math

import numpy as np
import pytest

from geo import get_farm
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sensors.camera.leaf_camera import LeafCamera
from sensors.camera.wire import ObservationAssembler
from sim_vehicle.airframe import navigation_errors as navigation
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.navigation_errors import BLOCK, GRID_S, NavigationErrors, SensorNoise
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.mavlink.fleet import Fleet

HOME = GeoPoint(28.05, -82.15, 12.0)
QUAD = get_vehicle("quad")


def errors_over(noise, count, every=1):
    errors = NavigationErrors(noise)
    return np.array([errors.at(k * every * GRID_S) for k in range(count)])


def ensemble(seconds, noise=3.0, baro=0.8, runs=400):
    """Return the errors of many vehicles at some times: float64[runs, times, 7]."""
    rows = []
    for seed in range(runs):
        errors = NavigationErrors(SensorNoise(noise, baro, seed=seed))
        rows.append([errors.at(time_s) for time_s in seconds])
    return np.array(rows)


# The processes.


@pytest.fixture(scope="module")
def many():
    return ensemble((0.0, 60.0, 300.0), runs=300)


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


def test_autocorrelation_over_time():
    # A day, so that one run averages over many time constants.
    rows = errors_over(SensorNoise(2.0, seed=5), 9000, every=100)
    for lag in (10, 55, 110):
        axes = rows[:, 3:5]
        measured = np.mean(axes[:-lag] * axes[lag:]) / np.mean(axes**2)
        # White noise takes its part at once, the rest dies away in 1100 s.
        white = (0.4 / 4.7) ** 2
        expected = math.exp(-lag * 100 * GRID_S / 1100.0) / (1.0 + white)
        assert measured == pytest.approx(expected, abs=0.12)


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


def test_sensors_draw_from_streams_of_their_own():
    both, gps, barometer = (
        errors_over(SensorNoise(*sizes, seed=3), 200) for sizes in ((1.0, 0.5), (1.0, 0.0), (0.0, 0.5))
    )
    np.testing.assert_array_equal(both[:, :2], gps[:, :2])
    np.testing.assert_array_equal(both[:, 2], barometer[:, 2])
    assert not gps[:, 2].any() and not barometer[:, :2].any() and not barometer[:, 3:6].any()
    twice = errors_over(SensorNoise(2.0, 0.0, seed=3), 200)
    np.testing.assert_allclose(twice[:, 3:6], 2.0 * gps[:, 3:6], rtol=1e-12)


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


def test_the_drift_is_the_difference_of_the_velocities():
    errors = NavigationErrors(SensorNoise(3.0, 1.0, seed=2))
    before, now = (errors.sense((0.0, 0.0, 50.0), time_s) for time_s in (99.9, 100.0))
    velocity = (np.array(now.true_m) - np.array(before.true_m)) / GRID_S
    assert now.drift_m_s == pytest.approx(tuple(velocity), abs=1e-6)
    assert np.abs(velocity).max() < 1.0


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


def test_a_restarted_autopilot_goes_on_in_the_same_world():
    vehicle = SimVehicle(QUAD, HOME, noise=SensorNoise(3.0, seed=6))
    vehicle.poll(50.0)
    before = vehicle.position_error(50e6)
    vehicle.reboot()
    vehicle.poll(51.0)
    assert vehicle.state.boot_ms == 1000
    assert vehicle.position_error(0.0) == before


# What the camera sees.


class Cells:
    """A world whose leaves read their own cell."""

    def __init__(self, shape):
        self.shape = shape

    def sample(self, _day, x, y):
        return np.column_stack((x, y, x)).astype(np.float32)


def seen(error_m, at_cells):
    farm = get_farm("miniberry-30")
    camera = LeafCamera(Cells(farm.grid().shape), farm.grid().shape, 0)
    told_of = None if error_m is None else lambda _time_us: error_m
    component = LeafCameraComponent(camera, farm, position_error=told_of)
    assembler = ObservationAssembler(farm, day=0)
    for number, (ix, iy) in enumerate(at_cells):
        latitude, longitude = farm.frame.to_wgs84(*farm.cell_centre(ix, iy))
        position = m.MAVLink_global_position_int_message(
            100 * number, round(latitude * 1e7), round(longitude * 1e7), 0, 10_000, 0, 0, 0, 0
        )
        position._header.srcSystem, position._header.srcComponent = 1, 1
        component.receive(position, 0.1 * number)
        order = m.MAVLink_command_long_message(1, 100, m.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 0, 1, 0, 0, 0, 0)
        for message in component.receive(order, 0.1 * number):
            assembler.add(message)
    return assembler.take()


def test_what_is_seen_at_the_true_place_is_booked_at_the_reported_one():
    cells = [(10, 12), (11, 12), (12, 12)]
    exact = seen(None, cells)
    assert np.array_equal(exact.values[:, 0], exact.x) and np.array_equal(exact.values[:, 1], exact.y)
    # It believes to be 3 cells east and 2 cells south of where it is.
    wrong = seen((3 * 0.3048, -2 * 0.3048), cells)
    assert np.array_equal(wrong.x, exact.x) and np.array_equal(wrong.y, exact.y)
    assert np.array_equal(wrong.values[:, 0], wrong.x - 3.0)
    assert np.array_equal(wrong.values[:, 1], wrong.y + 2.0)
