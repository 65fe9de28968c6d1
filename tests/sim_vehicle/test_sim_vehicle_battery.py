import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_vehicle.battery import WH_J, battery_state, flight_power_w, power_coefficients
from sim_vehicle.motion.kernel import rotor_power
from sim_vehicle.spec import QUAD, PowerSpec

BATTERY = QUAD.battery
POWER = QUAD.power


def test_hover_endurance_is_that_of_the_data_sheet():
    minutes = BATTERY.capacity_wh / flight_power_w(POWER) * 60.0
    assert 25.0 < minutes < 32.0


def test_the_published_example():
    # Zeng, Xu, Zhang 2019, table I: W = 20 N, A = 0.503 m2, Utip = 120 m/s, s = 0.05, delta = 0.012, k = 0.1
    # gives P0 = 79.86 W, Pi = 88.63 W, v0 = 4.03 m/s.
    published = PowerSpec(20.0 / 9.80665, 0.503, 120.0, 0.05, 0.012, 1.1, 0.6 * 0.05 * 0.503, 1.0)
    p0, pi, _, v0, drag, _, _ = power_coefficients(published)
    assert p0 == pytest.approx(79.86, rel=2e-3)
    assert pi == pytest.approx(88.63, rel=2e-3)
    assert v0 == pytest.approx(4.03, rel=2e-3)
    assert drag == pytest.approx(0.00924, rel=5e-3)


def test_power_over_speed_has_its_minimum_between_hover_and_top_speed():
    speeds = np.linspace(0.0, 16.0, 161)
    power = [flight_power_w(POWER, v) for v in speeds]
    best = speeds[int(np.argmin(power))]
    assert 4.0 < best < 13.0
    assert power[-1] > min(power)


@settings(deadline=None)
@given(st.floats(0.0, 25.0), st.floats(-5.0, 5.0))
def test_the_kernel_has_the_same_power(airspeed, climb):
    compiled = rotor_power(power_coefficients(POWER), airspeed * airspeed, climb)
    assert compiled == pytest.approx(flight_power_w(POWER, airspeed, climb), rel=1e-9)


@given(st.floats(0.0, 20.0), st.floats(0.0, 5.0), st.floats(0.01, 2.0))
def test_climbing_costs_more_and_descending_saves_nothing(airspeed, climb, more):
    assert flight_power_w(POWER, airspeed, climb + more) > flight_power_w(POWER, airspeed, climb)
    assert flight_power_w(POWER, airspeed, -more) == flight_power_w(POWER, airspeed, 0.0)


@given(st.lists(st.floats(0.0, 400e3), min_size=2, max_size=20), st.floats(0.0, 400.0))
def test_voltage_and_fraction_fall_with_use(used, power):
    states = [battery_state(BATTERY, u, power) for u in sorted(used)]
    for earlier, later in pairwise(states):
        assert later.fraction <= earlier.fraction
        assert later.voltage_v <= earlier.voltage_v + 1e-12
    assert all(math.isfinite(s.voltage_v) and 10.0 < s.voltage_v <= 16.8 for s in states)


def test_levels():
    def at(fraction):
        return battery_state(BATTERY, (1.0 - fraction) * BATTERY.capacity_wh * WH_J, 170.0)

    assert not at(0.21).low
    assert at(0.19).low and not at(0.19).critical
    assert at(0.09).critical and not at(0.09).depleted
    assert at(0.0).depleted and at(-0.5).fraction == 0.0
    assert at(0.5).used_mah == pytest.approx(5868.0 / 2.0, rel=1e-3)
    assert at(0.5).current_a * at(0.5).voltage_v == pytest.approx(170.0)
