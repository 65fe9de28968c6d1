import math

import numpy as np
import pytest
from scipy.signal import welch

from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.mavlink.reports import STREAMS
from sim_vehicle.motion.legs import Leg, Route
from sim_vehicle.motion.model import MotionEvent
from sim_vehicle.motion.multirotor.model import Multirotor
from sim_vehicle.weather.atmosphere import (
    LEVELS_W20_M_S,
    Turbulence,
    WindShear,
    intensities_m_s,
    length_scales_m,
    spectrum,
)
from sim_vehicle.weather.gust_kernel import wind_at
from sim_vehicle.weather.wind import BLOCK, GRID_S, Wind

FOOT = 0.3048


def everything(wind, count):
    series = wind.series()
    parts = []
    for k in range(count):
        assert series.first == k * BLOCK
        parts.append(series.block)
        series.forward()
    return np.vstack(parts)


def test_weather_reports():
    north = Wind.from_direction(4.0, 0.0)
    assert (north.east_m_s, north.north_m_s) == (pytest.approx(0.0), pytest.approx(-4.0))
    with pytest.raises(VehicleError, match="east_m_s nan"):
        Wind(math.nan)
    with pytest.raises(VehicleError, match="negative"):
        Wind(gust_m_s=-1.0)
    with pytest.raises(VehicleError, match="negative"):
        Wind(correlation_s=0.0)


@pytest.mark.parametrize("seed", [1, np.random.SeedSequence(5), np.random.SeedSequence(5, spawn_key=(2,))])
def test_the_same_seed_gives_the_same_gusts_every_time(seed):
    wind = Wind(gust_m_s=1.5, seed=seed)
    np.testing.assert_array_equal(everything(wind, 3), everything(wind, 3))
    if not isinstance(seed, int):
        seed.spawn(2)
        np.testing.assert_array_equal(everything(wind, 1), everything(Wind(gust_m_s=1.5, seed=seed), 1))
    assert not np.array_equal(everything(wind, 1), everything(Wind(gust_m_s=1.5, seed=99), 1))


def test_statistics_of_the_gust():
    wind = Wind(2.0, -3.0, gust_m_s=1.5, correlation_s=5.0, seed=3)
    gust = everything(wind, 100)[:, :2] - [2.0, -3.0]
    assert np.abs(gust.mean(axis=0)).max() < 0.15
    assert gust.std(axis=0) == pytest.approx([1.5, 1.5], rel=0.05)
    lag = round(5.0 / GRID_S)
    for k in range(2):
        correlation = np.mean(gust[:-lag, k] * gust[lag:, k]) / gust[:, k].var()
        assert correlation == pytest.approx(math.exp(-1.0), abs=0.06)
    assert abs(np.mean(gust[:, 0] * gust[:, 1])) < 0.15


@pytest.mark.parametrize(
    "wind",
    [
        Wind(4.0, -3.0, gust_m_s=2.0, seed=5),
        Wind(5.0, turbulence=Turbulence(9.0, height_m=20.0), height_m=20.0, seed=6),
    ],
)
def test_how_often_the_wind_is_stronger_than_a_speed(wind):
    speeds = np.hypot(*everything(wind, 300)[:, :2].T)
    for limit in (4.0, 6.0, 8.0):
        assert wind.share_above(limit, wind.height_m) == pytest.approx(np.mean(speeds > limit), abs=0.02)


def test_of_gusts_and_turbulence_only_one_can_be_given():
    with pytest.raises(VehicleError, match="give one of them"):
        Wind(gust_m_s=1.0, turbulence=Turbulence(5.0))
    with pytest.raises(VehicleError, match="height 0"):
        Wind(height_m=0.0)


# The mean wind over the height.


def test_the_logarithmic_profile_is_that_of_the_military_specification():
    # MIL-F-8785C, 3.7.3: u = W20 ln(h / z0) / ln(20 / z0), z0 2 ft away from airfields.
    shear = WindShear("log", roughness_m=2.0 * FOOT)
    for feet in (3.0, 20.0, 100.0, 999.0):
        assert shear.factor(feet * FOOT, 20.0 * FOOT) == pytest.approx(
            math.log(feet / 2.0) / math.log(20.0 / 2.0), rel=1e-12
        )
    assert shear.factor(0.0, 6.0) == shear.factor(3.0 * FOOT, 6.0)
    assert shear.factor(5000.0, 6.0) == shear.factor(1000.0 * FOOT, 6.0)


def test_the_profile_of_ardupilots_simulator():
    # libraries/SITL: below 60 m times sqrt(h / 60), whatever height the wind was given for.
    wind = Wind(6.0, 0.0, height_m=10.0, shear=WindShear("sitl"))
    for height_m, factor in ((0.0, 0.0), (0.6, 0.1), (15.0, 0.5), (60.0, 1.0), (200.0, 1.0)):
        assert wind.mean_at(height_m)[0] == pytest.approx(6.0 * factor)
        assert wind.series().at(0, height_m)[0] == pytest.approx(6.0 * factor)


@pytest.mark.parametrize(
    "shear", [WindShear("log", roughness_m=0.03), WindShear("power"), WindShear("sitl"), None]
)
@pytest.mark.parametrize("height_m", [0.0, 2.0, 10.0, 47.0, 300.0])
def test_a_row_holds_for_all_heights(shear, height_m):
    wind = Wind(4.0, -3.0, shear=shear)
    assert wind.series().at(7, height_m) == pytest.approx((*wind.mean_at(height_m), 0.0), rel=1e-12)
    gusty = Wind(4.0, -3.0, seed=3, shear=shear, turbulence=Turbulence(0.0))
    assert gusty.series().at(7, height_m) == wind.series().at(7, height_m)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"law": "linear"}, "log or power or sitl"),
        ({"roughness_m": 0.0}, "roughness"),
        ({"roughness_m": 0.8}, "roughness"),
        ({"exponent": math.nan}, "exponent"),
    ],
)
def test_shear_that_makes_no_sense_is_refused(values, message):
    with pytest.raises(VehicleError, match=message):
        WindShear(**values)


# Dryden's turbulence.


def test_scales_and_intensities_of_the_specification():
    # At 1000 ft the formulas near the ground meet those above it: all scales 1000 ft, isotropic.
    assert length_scales_m(1000.0 * FOOT) == pytest.approx((304.8, 304.8, 304.8), rel=1e-3)
    assert intensities_m_s(1000.0 * FOOT, 10.0) == pytest.approx((1.0, 1.0, 1.0), rel=1e-3)
    # At 100 ft: 0.177 + 0.0823 = 0.2593.
    along, across, up = length_scales_m(100.0 * FOOT)
    assert along == across == pytest.approx(100.0 * FOOT / 0.2593**1.2)
    assert up == pytest.approx(100.0 * FOOT)
    assert intensities_m_s(100.0 * FOOT, 10.0) == pytest.approx((0.2593**-0.4, 0.2593**-0.4, 1.0))
    levels = [LEVELS_W20_M_S[level] for level in ("light", "moderate", "severe")]
    assert levels == pytest.approx([7.717, 15.433, 23.15], rel=1e-4)
    assert intensities_m_s(0.0, 5.0) == intensities_m_s(10.0 * FOOT, 5.0)


def test_spectra_of_the_gusts_by_welch():
    height, w20, airspeed = 20.0, 8.0, 10.0
    # A wind to the north: along it is north, across it is west.
    wind = Wind(0.0, 5.0, seed=3, height_m=height, turbulence=Turbulence(w20, height, airspeed))
    gust = everything(wind, 400)[:, :3] - [0.0, 5.0, 0.0]
    sigmas, lengths = intensities_m_s(height, w20), length_scales_m(height)
    for number, (component, column) in enumerate((("u", 1), ("v", 0), ("w", 2))):
        frequency, density = welch(gust[:, column], fs=1.0 / GRID_S, nperseg=4096)
        formula = spectrum(component, frequency, sigmas[number], lengths[number], airspeed)
        for low, high in ((0.005, 0.02), (0.02, 0.1), (0.1, 0.5), (0.5, 1.0)):
            band = (frequency > low) & (frequency <= high)
            assert density[band].mean() / formula[band].mean() == pytest.approx(1.0, abs=0.06), component
        assert gust[:, column].std() == pytest.approx(sigmas[number], rel=0.03)
    assert np.abs(np.corrcoef(gust.T) - np.eye(3)).max() < 0.05


@pytest.mark.parametrize("height_m", [0.0, 2.0, 5.0, 40.0, 500.0])
def test_intensities_follow_the_height_where_the_wind_is_read(height_m):
    wind = Wind(2.0, 1.0, seed=5, turbulence=Turbulence(7.0, 20.0, 8.0))
    rows = everything(wind, 60)
    read = np.array([wind_at(row, height_m) for row in rows]) - [2.0, 1.0, 0.0]
    whole = rows[:, :3] - [2.0, 1.0, 0.0]
    along, _, up = intensities_m_s(height_m, 7.0)
    base = intensities_m_s(10.0, 7.0)
    np.testing.assert_allclose(read[:, :2], whole[:, :2] * along / base[0], rtol=1e-9, atol=1e-12)
    fades = min(1.0, height_m / (10.0 * FOOT))
    np.testing.assert_allclose(read[:, 2], whole[:, 2] * fades * up / base[2], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("values", [(-1.0,), (math.nan,), (5.0, -1.0), (5.0, 10.0, 0.0)])
def test_turbulence_that_makes_no_sense_is_refused(values):
    with pytest.raises(VehicleError, match="outside"):
        Turbulence(*values)


# In flight.

QUAD = get_vehicle("quad")


def flown(wind, chunk, places=((60.0, 0.0, 20.0), (60.0, 40.0, 35.0))):
    vehicle = Multirotor(QUAD, wind)
    rows = []
    for place in places:
        vehicle.fly(Route.through([Leg(place, 8.0)]))
        while vehicle.advance(chunk) is not MotionEvent.REACHED:
            rows.append((vehicle.step, *vehicle.state[:17]))
    return vehicle, np.array(rows)


def test_gusts_cost_energy_and_calm_air_is_calm():
    calm, _ = flown(None, 1000)
    rough, _ = flown(
        Wind(seed=1, turbulence=Turbulence(LEVELS_W20_M_S["severe"], height_m=20.0, airspeed_m_s=8.0)), 1000
    )
    assert rough.step == calm.step
    assert 1.01 * calm.energy_j < rough.energy_j < 1.5 * calm.energy_j
    still, _ = flown(Wind(turbulence=Turbulence(0.0), shear=WindShear()), 1000)
    np.testing.assert_array_equal(still.state, calm.state)


# On the wire.


def message(vehicle, kind):
    (built,) = vehicle.built(kind)
    return built


def test_the_wind_is_told_as_each_autopilot_tells_it():
    wind = Wind.from_direction(5.0, 300.0)
    vehicle = SimVehicle(QUAD, GeoPoint(28.05, -82.15, 12.0), wind=wind)
    vehicle.poll(1.0)
    cov = message(vehicle, mavlink.MAVLINK_MSG_ID_WIND_COV)
    assert (cov.wind_y, cov.wind_x) == pytest.approx((wind.east_m_s, wind.north_m_s))
    told = message(vehicle, mavlink.MAVLINK_MSG_ID_WIND)
    assert (told.direction % 360.0, told.speed, told.speed_z) == pytest.approx((300.0, 5.0, 0.0))
    calm = SimVehicle(QUAD, GeoPoint(28.05, -82.15, 12.0))
    still = message(calm, mavlink.MAVLINK_MSG_ID_WIND)
    assert (still.direction, still.speed) == (0.0, 0.0)
    assert mavlink.MAVLINK_MSG_ID_WIND in STREAMS[mavlink.MAV_DATA_STREAM_EXTRA3]


def test_heading_and_direction_over_ground_are_two_things():
    # A wing that flies to the east with its nose 20 degrees into a north wind.
    vehicle = SimVehicle(QUAD, GeoPoint(28.05, -82.15, 12.0), wind=Wind(0.0, -4.0))
    vehicle.poll(1.0)
    vehicle.pilot.state = vehicle.pilot.state._replace(
        velocity_m_s=(11.0, 0.0, 0.0), yaw_rad=math.radians(70.0)
    )
    vehicle.state.sense(1.0)
    position = message(vehicle, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert (position.hdg, position.vx, position.vy) == (7000, 0, 1100)
    assert message(vehicle, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).cog == 9000
    hud = message(vehicle, mavlink.MAVLINK_MSG_ID_VFR_HUD)
    assert (hud.heading, hud.groundspeed) == (70, 11.0)
