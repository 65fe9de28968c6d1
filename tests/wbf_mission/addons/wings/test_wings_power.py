"""The power of fixed wings."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.power_spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2
from sim_vehicle.energy.power import flight_power_w, power_coefficients
from wbf_mission.addons.wings.kind import FixedWingPowerSpec, fixed_wing_power
from wbf_mission.addons.wings.motion import kernel


@settings(deadline=None)
@given(st.floats(0.0, 40.0), st.floats(-10.0, 10.0), st.floats(0.0, 3.0))
def test_the_compiled_power_is_the_same(speed, climb, load):
    wing = get_vehicle("wing")
    numbers = power_coefficients(wing.power, wing.battery)
    compiled = kernel.fixed_wing_power(numbers, speed, climb, load)
    assert compiled == pytest.approx(fixed_wing_power(numbers, speed, climb, load), rel=1e-12)


def test_the_drag_of_a_wing():
    wing = FixedWingPowerSpec(
        mass_kg=2.0,
        wing_area_m2=0.4,
        wing_span_m=1.8,
        parasitic_drag=0.03,
        oswald=0.8,
        efficiency=0.5,
        avionics_w=10.0,
        camera_w=0.0,
    )
    speed, weight = 15.0, 2.0 * GRAVITY_M_S2
    pressure = 0.5 * AIR_DENSITY_KG_M3 * speed**2
    for load in (1.0, 1.5):
        lift = load * weight / (pressure * 0.4)
        drag = pressure * 0.4 * (0.03 + lift**2 / (math.pi * 0.8 * 1.8**2 / 0.4))
        assert flight_power_w(wing, speed, load_factor=load) == pytest.approx(10.0 + drag * speed / 0.5)
    climb = flight_power_w(wing, speed, 2.0) - flight_power_w(wing, speed)
    assert climb == pytest.approx(weight * 2.0 / 0.5)
    faster = flight_power_w(wing, speed, acceleration_m_s2=1.0) - flight_power_w(wing, speed)
    assert faster == pytest.approx(2.0 * speed / 0.5)
    assert flight_power_w(wing, speed, -5.0) == 10.0
    assert flight_power_w(wing) == 10.0
