"""The battery in telemetry, and the failsafes of a voltage that is too low."""

from dataclasses import replace

import pytest

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.pilot.controls import RefusedError
from tests.support.rig import QUAD
from tests.support.rig import Rig as SafetyRig

# Cells of which each hangs low under the load of a flight.
SOFT = replace(QUAD, battery=replace(QUAD.battery, resistance_ohm=0.15))


class Rig(SafetyRig):
    def status(self):
        return self.vehicle.built(m.MAVLINK_MSG_ID_BATTERY_STATUS)[0]

    @property
    def voltage_v(self):
        return self.pilot.state.battery.voltage_v


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def test_what_the_messages_tell(autopilot):
    rig = Rig(autopilot)
    resting = rig.status()
    assert resting.voltages[:4] == pytest.approx([4350] * 4, abs=4)
    assert resting.voltages[4:] == [65535] * 6
    assert resting.time_remaining == 0
    rig.aloft()
    rig.run(150.0)
    flying, battery = rig.status(), rig.pilot.state.battery
    system = rig.vehicle.built(m.MAVLINK_MSG_ID_SYS_STATUS)[0]
    assert sum(flying.voltages[:4]) == pytest.approx(system.voltage_battery, abs=4)
    assert flying.voltages[0] < 4300
    assert flying.current_battery == system.current_battery == pytest.approx(1040, abs=40)
    # 1 hJ is 100 J; the charge and the energy go with the mean voltage.
    assert flying.energy_consumed == pytest.approx(battery.used_wh * 36.0, abs=1)
    assert flying.current_consumed / 1000.0 * 17.2 == pytest.approx(battery.used_wh, rel=0.03)
    assert flying.battery_remaining == system.battery_remaining == pytest.approx(91, abs=2)
    left_s = battery.fraction * QUAD.battery.capacity_wh * 3600.0 / 178.4
    assert flying.time_remaining == (pytest.approx(left_s, rel=0.03) if autopilot is PX4 else 0)
    assert flying.charge_state == m.MAV_BATTERY_CHARGE_STATE_OK


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def test_the_charge_state_follows_the_parameters(autopilot):
    rig = Rig(autopilot, low_fraction=0.5, critical_fraction=0.3, emergency_fraction=0.1)
    states = {0.51: "OK", 0.49: "LOW", 0.29: "CRITICAL", 0.09: "EMERGENCY"}
    for fraction, name in states.items():
        rig.pilot.drain_battery(fraction)
        rig.run(0.2)
        assert rig.status().charge_state == getattr(m, f"MAV_BATTERY_CHARGE_STATE_{name}")


def test_an_endless_battery_is_unknown():
    rig = Rig(PX4, replace(QUAD, battery=None))
    status = rig.status()
    assert status.voltages == [65535] * 10 and status.battery_remaining == -1
    assert rig.vehicle.built(m.MAVLINK_MSG_ID_SYS_STATUS)[0].battery_remaining == -1


def test_a_voltage_that_sags_for_too_long_is_a_low_battery():
    rig = Rig(ARDUPILOT, SOFT, low_voltage_v=16.2, low_voltage_timer_s=10.0)
    assert rig.voltage_v > 16.2
    rig.aloft()
    begun = rig.now_s
    assert rig.voltage_v < 16.2 and not any("Battery" in text for text in rig.texts)
    rig.run(15.0, until=lambda: rig.pilot.mode is Mode.RTL)
    assert rig.pilot.mode is Mode.RTL and rig.now_s - begun < 10.5
    assert any(text.startswith("Battery low (") and " V)" in text for text in rig.texts)
    assert rig.status().charge_state == m.MAV_BATTERY_CHARGE_STATE_LOW
    assert rig.pilot.state.battery.fraction > 0.9


def test_a_pack_below_the_voltage_does_not_arm():
    rig = Rig(ARDUPILOT, low_voltage_v=17.5)
    with pytest.raises(RefusedError, match=r"battery voltage low \(17\.\d\d V, least 17\.50 V\)"):
        rig.pilot.arm()
