"""Attitudes by command."""

import math

import pytest

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.execution.state import FlightPhase
from tests.wbf_mission.addons.modes.test_setpoints import HERE, POSITION, Rig, local

GUIDED_NOGPS, CIRCLE, FLIP, DRIFT, ZIGZAG = 20, 7, 14, 11, 24


def attitude(roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0, thrust=0.5, mask=7, rates=(0.0, 0.0, 0.0), scale=1.0):
    """SET_ATTITUDE_TARGET, as DroneKit's `set_attitude` example sends it."""
    r, p, y = (0.5 * math.radians(angle) for angle in (roll_deg, pitch_deg, yaw_deg))
    cr, sr, cp, sp, cy, sy = (f(a) for a in (r, p, y) for f in (math.cos, math.sin))
    q = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return m.MAVLink_set_attitude_target_message(0, 1, 1, mask, [scale * part for part in q], *rates, thrust)


class Copter(Rig):
    def __init__(self, autopilot=ARDUPILOT):
        super().__init__(autopilot)

    @property
    def results(self):
        return [answer.result for answer in self.sent if answer.get_type() == "COMMAND_ACK"]

    def mode(self, number):
        self.tell(m.MAVLink_command_long_message(1, 1, 176, 0, 1.0, number, *[0.0] * 5))
        return self.results[-1]

    def sticks(self, right=0, forward=0, up=500, turn=0):
        return m.MAVLink_manual_control_message(1, forward, right, up, turn, 0)

    @property
    def number(self):
        return self.vehicle.state.custom_mode

    @property
    def roll(self):
        return math.degrees(self.pilot.state.roll_rad)

    @property
    def pitch(self):
        return math.degrees(self.pilot.state.pitch_rad)

    @property
    def yaw(self):
        return math.degrees(self.pilot.state.yaw_rad)


def test_guided_flies_attitudes():
    rig = Copter().guided(HERE)
    rig.run(3.0, stream=attitude(pitch_deg=-10.0, yaw_deg=90.0))
    rig.run(3.0, stream=attitude(pitch_deg=-10.0, yaw_deg=90.0))
    assert (rig.roll, rig.pitch, rig.yaw) == pytest.approx((0.0, -10.0, 90.0), abs=0.5)
    # The nose down: it flies ahead, to the east once it looks there, and keeps its height.
    assert rig.velocity[0] > 2.0
    assert rig.place[2] == pytest.approx(20.0, abs=0.4)
    faster = rig.velocity[0]
    rig.run(3.0, stream=attitude(pitch_deg=-10.0, yaw_deg=90.0))
    assert rig.velocity[0] > faster
    rig.run(4.0, stream=attitude(roll_deg=15.0, yaw_deg=90.0, thrust=0.75))
    assert rig.roll == pytest.approx(15.0, abs=0.5)
    assert rig.velocity[1] < -2.0, "to its right, the south"
    assert rig.velocity[2] == pytest.approx(0.5 * rig.pilot.spec.climb_speed_m_s, abs=0.1)
    # No more than ANGLE_MAX.
    rig.run(1.5, stream=attitude(roll_deg=60.0, yaw_deg=90.0))
    assert rig.roll == pytest.approx(30.0, abs=0.5)
    # Silence for GUID_TIMEOUT: level.
    rig.run(5.0)
    assert rig.roll == pytest.approx(0.0, abs=0.5)
    assert rig.velocity[2] == pytest.approx(0.0, abs=0.05)
    # A position takes over, with the attitude that its flight has.
    rig.run(1.0, stream=local(POSITION, 0.0, 0.0, -20.0))
    assert rig.pilot.flown_attitude is None
    rig.run(60.0)
    assert rig.place == pytest.approx((0.0, 0.0, 20.0), abs=0.2)


def test_rates_of_turning_and_what_stops():
    rig = Copter().guided(HERE)
    rig.run(2.0, stream=attitude(mask=0, rates=(0.0, 0.0, 0.5)))
    start = rig.yaw
    rig.run(2.0, stream=attitude(mask=0, rates=(0.0, 0.0, 0.5)))
    assert (rig.yaw - start) % 360.0 == pytest.approx(math.degrees(1.0), abs=3.0)
    rig.run(1.0, stream=attitude(mask=128, rates=(math.radians(8.0), 0.0, 0.0)))
    assert rig.roll == pytest.approx(8.0, abs=1.5)
    for wrong in (attitude(mask=64 | 7), attitude(mask=3), attitude(mask=128 | 7), attitude(scale=1.2)):
        rig.run(0.5, stream=attitude(roll_deg=5.0))
        rig.run(0.2, stream=wrong)
        assert rig.pilot.state.phase is FlightPhase.HOLD
        assert rig.pilot.flown_attitude is None


def test_guided_nogps_needs_no_position_and_takes_attitudes_only():
    rig = Copter().guided(HERE)
    assert rig.mode(GUIDED_NOGPS) == 0
    assert rig.number == GUIDED_NOGPS
    place = rig.place
    rig.run(3.0, stream=local(POSITION, 50.0, 0.0, -20.0))
    assert rig.place == pytest.approx(place, abs=0.5)
    rig.run(3.0, stream=attitude(roll_deg=10.0))
    assert rig.roll == pytest.approx(10.0, abs=0.5)
    assert rig.mode(4) == 0
    rig.vehicle.pilot.position_ok = False
    ground = Copter()
    ground.pilot.position_ok = False
    assert ground.mode(4) == 4
    assert ground.mode(GUIDED_NOGPS) == 0


def test_px4_flies_attitudes_by_thrust():
    """MAVSDK's `offboard_attitude` begins on the ground; MPC_THR_HOVER of thrust holds the height."""
    rig = Copter(PX4)
    rig.pilot.arm()
    rig.run(0.5, stream=attitude(thrust=0.0))
    rig.pilot.set_mode(Mode.GUIDED)
    rig.run(2.0, stream=attitude(thrust=0.0))
    assert rig.place == (0.0, 0.0, 0.0)
    rig.run(4.0, stream=attitude(thrust=0.7))
    assert rig.place[2] > 2.0
    rig.run(3.0, stream=attitude(thrust=0.6, roll_deg=20.0))
    assert rig.roll == pytest.approx(20.0, abs=0.5)
    assert rig.velocity[0] > 2.0, "to its right, the east"
    rig.run(1.0, stream=attitude(thrust=0.6 / math.cos(math.radians(20.0)), roll_deg=20.0))
    climb = rig.velocity[2]
    rig.run(1.0, stream=attitude(thrust=0.6 / math.cos(math.radians(20.0)), roll_deg=20.0))
    assert rig.velocity[2] == pytest.approx(climb, abs=0.05)
    # Silence for COM_OF_LOSS_T: the way home.
    rig.run(3.0)
    assert rig.pilot.mode is Mode.RTL
    assert rig.pilot.flown_attitude is None


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def test_accelerations_lean(autopilot):
    rig = Copter(autopilot).guided(HERE)
    accelerate = m.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b110000111111, *[0.0] * 6, 0.0, 1.5, 0.0, 0.0, 0.0
    )
    rig.run(3.0, stream=accelerate)
    assert 2.0 < rig.velocity[0] < 4.6
    assert rig.velocity[1:] == pytest.approx((0.0, 0.0), abs=0.3)
    accelerate.afy, accelerate.afz = 0.0, -1.0
    before = rig.velocity[2]
    rig.run(1.0, stream=accelerate)
    assert rig.velocity[2] - before == pytest.approx(1.0, abs=0.3)
