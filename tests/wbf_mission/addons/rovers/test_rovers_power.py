"""The power of rovers."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.power_spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2
from sim_vehicle.energy.power import flight_power_w, power_coefficients
from wbf_mission.addons.rovers.kind import RoverPowerSpec, rover_power
from wbf_mission.addons.rovers.motion import kernel


@settings(deadline=None)
@given(st.floats(0.0, 40.0), st.floats(-10.0, 10.0), st.floats(0.0, 3.0))
def test_the_compiled_power_is_the_same(speed, airspeed, acceleration):
    rover = get_vehicle("rover")
    numbers = power_coefficients(rover.power, rover.battery)
    compiled = kernel.rover_power(numbers, speed, airspeed, acceleration)
    assert compiled == pytest.approx(rover_power(numbers, speed, airspeed, acceleration), rel=1e-12)


def test_the_resistance_of_a_rover():
    rover = RoverPowerSpec(
        mass_kg=20.0, rolling_resistance=0.1, drag_area_m2=0.3, efficiency=0.5, avionics_w=10.0, camera_w=0.0
    )
    rolling = 0.1 * 20.0 * GRAVITY_M_S2
    drag = 0.5 * AIR_DENSITY_KG_M3 * 0.3 * 4.0
    assert flight_power_w(rover, 2.0) == pytest.approx(10.0 + (rolling + drag) * 2.0 / 0.5)
    assert flight_power_w(rover) == 10.0
    assert flight_power_w(rover, 2.0, acceleration_m_s2=-5.0) == 10.0
    numbers = power_coefficients(rover)
    assert rover_power(numbers, 2.0, 8.0, 0.0) > rover_power(numbers, 2.0, 2.0, 0.0)
    assert rover_power(numbers, 2.0, -8.0, 0.0) < rover_power(numbers, 2.0, 2.0, 0.0)
