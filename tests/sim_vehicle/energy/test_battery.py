import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from sim_vehicle.airframe.catalog import get_vehicle, vehicle_names
from sim_vehicle.energy.battery import WH_J, BatteryMeter, remaining_fraction

BATTERY = get_vehicle("quad").battery
CAPACITY_J = BATTERY.capacity_wh * WH_J
PACKS = [get_vehicle(name).battery for name in vehicle_names() if get_vehicle(name).battery is not None]


def _resting(fraction, power=0.0):
    return BatteryMeter(BATTERY).read(0.0, (1.0 - fraction) * CAPACITY_J, power)


@given(st.lists(st.floats(0.0, 1.2 * CAPACITY_J), min_size=2, max_size=20), st.floats(0.0, 400.0))
def test_voltage_and_fraction_fall_with_use(used, power):
    states = [BatteryMeter(BATTERY).read(0.0, joules, power) for joules in sorted(used)]
    for earlier, later in pairwise(states):
        assert later.fraction <= earlier.fraction
        assert later.voltage_v <= earlier.voltage_v + 1e-12
        assert later.used_mah >= earlier.used_mah - 1e-9
    assert all(math.isfinite(s.voltage_v) and 10.0 < s.voltage_v <= 17.4 for s in states)


def test_a_full_and_an_empty_pack():
    assert _resting(1.0).voltage_v == pytest.approx(4 * 4.35)
    assert _resting(0.0).voltage_v == pytest.approx(4 * 3.0)
    assert _resting(0.0).depleted and not _resting(0.01).depleted
    assert _resting(-0.5).fraction == 0.0
    assert _resting(0.5).remaining_s == math.inf


@pytest.mark.parametrize("pack", PACKS, ids=lambda pack: f"{pack.capacity_wh} Wh")
def test_the_charge_of_the_discharge_curve_is_that_of_the_data_sheet(pack):
    empty = BatteryMeter(pack).read(0.0, pack.capacity_wh * WH_J, 0.0)
    assert empty.used_mah == pytest.approx(pack.capacity_mah, rel=0.015)


def test_the_current_is_the_rate_of_the_charge():
    meter = BatteryMeter(BATTERY)
    power, step = 178.0, 1.0
    charge = 0.0
    last = meter.read(0.0, 0.0, power)
    for second in range(1, 1700):
        state = meter.read(second * step, second * power, power)
        charge += 0.5 * (last.current_a + state.current_a) * step / 3.6
        last = state
    assert charge == pytest.approx(last.used_mah, rel=1e-4)


def test_the_sag_of_a_load_builds_up_and_recovers():
    meter = BatteryMeter(BATTERY)
    resting = meter.read(0.0, 0.0, 0.0).voltage_v
    at_once = meter.read(0.001, 0.0, 300.0).voltage_v
    current = 300.0 / 17.4
    assert resting - at_once == pytest.approx(BATTERY.resistance_ohm * current, rel=1e-3)
    held = [meter.read(0.001 + 10.0 * k, 0.0, 300.0).voltage_v for k in range(1, 30)]
    assert all(later < earlier + 1e-12 for earlier, later in pairwise(held))
    assert at_once - held[-1] == pytest.approx(BATTERY.polarization_ohm * current, rel=1e-3)
    released = meter.read(290.002, 0.0, 0.0).voltage_v
    assert released == pytest.approx(resting - BATTERY.polarization_ohm * current, abs=1e-3)
    later = meter.read(290.002 + BATTERY.relaxation_s, 0.0, 0.0).voltage_v
    assert resting - later == pytest.approx((resting - released) * math.exp(-1.0), rel=0.01)
    assert meter.read(2000.0, 0.0, 0.0).voltage_v == pytest.approx(resting, abs=1e-6)


@sweep(few=30, many=200)
@given(st.floats(0.0, 2.0 * CAPACITY_J))
def test_the_fraction_without_a_meter_is_the_same(used):
    assert remaining_fraction(BATTERY, used) == BatteryMeter(BATTERY).read(0.0, used, 100.0).fraction


def test_a_load_that_changed_between_two_looks_counts_with_its_mean():
    battery = get_vehicle("quad").battery
    elapsed_s, last_w, now_w = 20.0, 300.0, 100.0
    meter = BatteryMeter(battery)
    meter.read(0.0, 0.0, last_w)
    state = meter.read(elapsed_s, 0.0, now_w)
    full_v = battery.cells * battery.full_cell_v
    mean_w = 0.5 * (last_w + now_w)
    built_up = 1.0 - math.exp(-elapsed_s / battery.relaxation_s)
    sag_v = battery.polarization_ohm * mean_w / full_v * built_up
    assert state.rest_voltage_v == pytest.approx(full_v - sag_v, abs=1e-9)
    # Of the first look on, the average is the load now.
    assert WH_J * battery.capacity_wh / now_w > state.remaining_s > WH_J * battery.capacity_wh / mean_w
