import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.power_spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2, BatterySpec, PowerSpec
from sim_vehicle.energy.power import (
    REGAINED,
    flight_power_w,
    multirotor_power,
    power_coefficients,
    profile_power_w,
)
from sim_vehicle.motion import stepping

QUAD = get_vehicle("quad")
# Zeng, Xu, Zhang 2019, table I: W = 20 N, A = 0.503 m2, Utip = 120 m/s, s = 0.05, delta = 0.012, k = 0.1
# (added to 1), d0 = 0.6.
PUBLISHED = PowerSpec(
    mass_kg=20.0 / GRAVITY_M_S2,
    disc_area_m2=0.503,
    tip_speed_m_s=120.0,
    solidity=0.05,
    blade_drag=0.012,
    induced_factor=1.1,
    drag_area_m2=0.6 * 0.05 * 0.503,
    efficiency=1.0,
    avionics_w=1e-9,
    camera_w=0.0,
)

_SPEEDS = st.floats(-16.0, 16.0)
_ACCELERATIONS = st.floats(-8.0, 8.0)


def _zeng(speed):
    v0 = math.sqrt(20.0 / (2.0 * AIR_DENSITY_KG_M3 * 0.503))
    profile = 79.8563 * (1.0 + 3.0 * speed**2 / 120.0**2)
    ratio = speed**2 / (2.0 * v0**2)
    induced = 88.6279 * math.sqrt(math.sqrt(1.0 + ratio**2) - ratio)
    return profile + induced + 0.00924 * speed**3


def test_the_hover_of_the_published_example():
    assert profile_power_w(PUBLISHED) == pytest.approx(79.86, rel=2e-3)
    assert flight_power_w(PUBLISHED) == pytest.approx(79.86 + 88.63, rel=2e-3)


@pytest.mark.parametrize("speed", [3.0, 6.0, 10.2, 14.0])
def test_level_flight_is_that_of_the_published_formula(speed):
    # The formula leaves out that the drag tilts the disc.
    assert flight_power_w(PUBLISHED, speed) == pytest.approx(_zeng(speed), rel=0.005)


@given(_SPEEDS, _SPEEDS, st.floats(-6.0, 6.0), _ACCELERATIONS, _ACCELERATIONS, st.floats(-12.0, 8.0))
def test_the_compiled_rotor_has_the_same_power(x, y, climb, ax, ay, az):
    numbers = power_coefficients(QUAD.power, QUAD.battery)
    compiled = stepping.multirotor_power(numbers, x, y, climb, ax, ay, az)
    assert compiled == pytest.approx(multirotor_power(numbers, x, y, climb, ax, ay, az), rel=1e-9)
    assert math.isfinite(compiled) and compiled >= 12.0


@given(st.floats(0.0, 12.0), st.floats(0.01, 3.0))
def test_a_descent_gives_back_no_more_than_its_share(airspeed, sink):
    level = flight_power_w(QUAD.power, airspeed)
    saved = level - flight_power_w(QUAD.power, airspeed, -sink)
    given_back = QUAD.power.mass_kg * GRAVITY_M_S2 * sink / QUAD.power.efficiency
    assert 0.0 <= saved < given_back
    if airspeed == 0.0:
        assert saved == pytest.approx(REGAINED * given_back, rel=1e-6)


def test_an_acceleration_needs_thrust_and_work():
    assert flight_power_w(QUAD.power, 0.0, load_factor=1.2) > 1.2 * flight_power_w(QUAD.power) - 12.0
    cruise = flight_power_w(QUAD.power, 8.0)
    speeding_up = flight_power_w(QUAD.power, 8.0, acceleration_m_s2=2.0) - cruise
    work = QUAD.power.mass_kg * 2.0 * 8.0 / QUAD.power.efficiency
    # More thrust takes more induced and profile power; the disc leans into the airflow, which spares some.
    assert 0.9 * work < speeding_up < 1.3 * work
    braking = flight_power_w(QUAD.power, 8.0, acceleration_m_s2=-2.0)
    assert 0.5 * cruise < braking < 1.1 * cruise


def test_without_thrust_only_the_avionics_run():
    numbers = power_coefficients(QUAD.power)
    assert multirotor_power(numbers, 0.0, 0.0, -10.0, 0.0, 0.0, -GRAVITY_M_S2) == pytest.approx(12.0)
    assert multirotor_power(power_coefficients(None), 5.0, 0.0, 1.0, 1.0, 0.0, 0.0) == 0.0


# Endurance as the makers tell it, at several speeds of one aircraft, and so its mean power (docs/energy.md).
# Mass kg, propellers in, Wh, V of a cell, cells, minutes of hover, m/s and minutes of flight.
DRONES = {
    "Mavic 2": (0.907, 8.3, 59.29, 3.85, 4, 29.0, ((25.0 / 3.6, 31.0), (50.0 / 3.6, 18.0 / 50.0 * 60.0))),
    "Mavic Pro": (0.734, 8.3, 43.6, 3.8, 3, 24.0, ((25.0 / 3.6, 27.0),)),
    "Mavic Pro Platinum": (0.734, 8.3, 43.6, 3.8, 3, 27.0, ((25.0 / 3.6, 30.0),)),
    "Mavic 3": (0.895, 9.4, 77.0, 3.85, 4, 40.0, ((9.0, 46.0),)),
}


@pytest.mark.parametrize("name", DRONES)
def test_flying_takes_what_the_makers_tell_when_hovering_does(name):
    mass, inches, energy, cell_v, cells, hover, flights = DRONES[name]
    battery = BatterySpec(energy, cells, cell_v, full_cell_v=4.4)
    disc = math.pi * (0.0254 * inches) ** 2

    def minutes(drag, speed):
        rotors = PowerSpec(
            mass_kg=mass,
            disc_area_m2=disc,
            tip_speed_m_s=60.0,
            solidity=0.1,
            blade_drag=drag,
            drag_area_m2=0.03,
            avionics_w=6.0,
        )
        return 60.0 * energy / flight_power_w(rotors, speed, battery=battery)

    low, high = 1e-3, 0.5
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if minutes(middle, 0.0) > hover else (low, middle)
    assert minutes(low, 0.0) == pytest.approx(hover, rel=1e-3)
    for speed, published in flights:
        assert minutes(low, speed) == pytest.approx(published, rel=0.08)
