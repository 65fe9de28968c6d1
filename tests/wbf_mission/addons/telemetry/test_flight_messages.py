"""What ArduPilot streams of the flight follows the simulated vehicle's state."""

import math

import pytest

from geo.frame import LocalFrame
from mission.link.codec.dialect import mavlink as m
from mission.model import MissionItem
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.execution.state import FlightPhase
from tests.support.peer import HOME, Peer

FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)
STREAMED = {
    1: {"RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE"},
    2: {"SYS_STATUS", "POWER_STATUS", "MEMINFO", "MISSION_CURRENT", "GPS_RAW_INT"}
    | {"NAV_CONTROLLER_OUTPUT", "EXTENDED_SYS_STATE"},
    3: {"SERVO_OUTPUT_RAW", "RC_CHANNELS"},
    6: {"GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"},
    10: {"ATTITUDE", "AHRS2"},
    11: {"VFR_HUD"},
    12: {"AHRS", "SYSTEM_TIME", "WIND", "TERRAIN_REPORT", "BATTERY_STATUS", "EKF_STATUS_REPORT"}
    | {"VIBRATION"},
}


class Copter(Peer):
    def __init__(self, spec="quad"):
        super().__init__(ARDUPILOT, spec)
        self.pilot = self.vehicle.pilot

    def aloft(self, height_m=20.0):
        self.pilot.set_mode(Mode.GUIDED)
        self.pilot.arm()
        self.pilot.takeoff(height_m)
        while self.pilot.state.phase is not FlightPhase.HOLD:
            self.wait(0.5)
        self.wait(5.0)
        return self

    def asked(self, message_id):
        answers = self.command(m.MAV_CMD_REQUEST_MESSAGE, message_id)
        assert answers[0].result == 0
        return next((answer for answer in answers if answer.get_msgId() == message_id), None)

    def goto(self, north, east, down):
        self.tell(
            m.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0b110111111000, north, east, down, *[0.0] * 8
            )
        )


@pytest.mark.parametrize("stream", sorted(STREAMED))
def test_each_group_streams_its_messages(stream):
    peer = Copter()
    peer.tell(m.MAVLink_request_data_stream_message(1, 1, stream, 2, 1))
    peer.told.clear()
    peer.wait(2.0)
    kinds = [message.get_type() for message in peer.told]
    assert set(kinds) - {"HEARTBEAT", "STATUSTEXT"} == STREAMED[stream]
    assert all(kinds.count(kind) in (4, 5) for kind in STREAMED[stream])


def test_navigation_tells_the_way_to_the_waypoint():
    peer = Copter().aloft()
    begun = peer.pilot.state.position_m
    peer.goto(0.0, 300.0, -20.0)
    peer.wait(10.0)
    x, _, z = peer.pilot.state.position_m
    told = peer.asked(62)
    assert told.wp_dist == pytest.approx(300.0 - x, abs=0.6)
    assert (told.target_bearing, told.nav_bearing) == (90, 90)
    assert told.alt_error == pytest.approx(20.0 - z, abs=0.05)
    assert told.nav_pitch == pytest.approx(math.degrees(peer.pilot.state.pitch_rad), abs=1e-3)
    # To the right of the track is positive.
    peer.pilot.executor.flight.began_m = (begun[0], begun[1] + 4.0, begun[2])
    assert peer.asked(62).xtrack_error == pytest.approx(4.0 * (1.0 - (x - begun[0]) / 300.0), abs=0.1)
    target = peer.asked(87)
    there = FRAME.from_wgs84(target.lat_int / 1e7, target.lon_int / 1e7)
    assert there == pytest.approx((300.0, 0.0), abs=0.1)
    assert (target.coordinate_frame, target.type_mask, target.alt) == (0, 0xFDF8, pytest.approx(40.0))
    local = peer.asked(85)
    assert (local.x, local.y, local.z, local.type_mask) == pytest.approx((0.0, 300.0, -20.0, 0xDF8), abs=1e-3)
    velocity = m.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b110111000111, 0.0, 0.0, 0.0, 3.0, -1.0, 0.5, *[0.0] * 5
    )
    peer.tell(velocity)
    peer.wait(0.5)
    local = peer.asked(85)
    assert (local.vx, local.vy, local.vz, local.type_mask) == pytest.approx((3.0, -1.0, 0.5, 0xC07))
    assert peer.asked(87) is None
    assert peer.asked(62).wp_dist == 0
    peer.pilot.set_mode(Mode.HOLD)
    assert (peer.asked(85), peer.asked(87)) == (None, None)


def test_navigation_follows_the_mission():
    peer = Copter()
    items = [MissionItem(22, 3, z=10.0)]
    for north, east in ((60.0, 0.0), (60.0, 80.0)):
        items.append(MissionItem.waypoint(*FRAME.to_wgs84(east, north), 10.0))
    peer.pilot.load(items)
    peer.pilot.set_mode(Mode.GUIDED)
    peer.pilot.arm()
    peer.pilot.set_mode(Mode.MISSION)
    while peer.pilot.mission.current_seq < 2:
        peer.wait(0.5)
    peer.wait(6.0)
    x, y, _ = peer.pilot.state.position_m
    told = peer.asked(62)
    assert told.wp_dist == pytest.approx(math.hypot(80.0 - x, 60.0 - y), abs=0.6)
    assert told.target_bearing == pytest.approx(math.degrees(math.atan2(80.0 - x, 60.0 - y)), abs=0.6)
    # It flies east: north of the track is to its left.
    assert told.xtrack_error == pytest.approx(60.0 - y, abs=0.1)


def test_sensors_follow_the_motion():
    peer = Copter().aloft()
    still = peer.asked(27)
    assert (still.xacc, still.yacc, still.zacc) == pytest.approx((0, 0, -1000), abs=3)
    assert (still.xgyro, still.ygyro, still.zgyro) == (0, 0, 0)
    peer.goto(200.0, 0.0, -20.0)
    peer.wait(1.0)
    peer.asked(27)
    peer.wait(0.2)
    pitching = peer.pilot.state
    told = peer.asked(27)
    assert told.ygyro < -10, "the nose goes down to fly ahead"
    assert told.zacc == pytest.approx(-1000.0 * (9.80665 + pitching.acceleration_m_s2[2]) / 9.80665, abs=60)
    second = peer.asked(116)
    assert (second.xacc, second.ygyro, second.zmag) == (told.xacc, told.ygyro, told.zmag)
    peer.wait(5.0)
    peer.command(m.MAV_CMD_CONDITION_YAW, 90.0, 30.0, 1.0)
    peer.wait(2.0)
    assert peer.asked(27).zgyro == pytest.approx(1000.0 * math.radians(30.0), rel=0.15)
    other = peer.asked(178)
    assert (other.roll, other.pitch) == pytest.approx((peer.pilot.state.roll_rad, peer.pilot.state.pitch_rad))
    assert other.altitude == pytest.approx(20.0 + peer.pilot.state.position_m[2], abs=0.01)
    ground = peer.asked(136)
    assert (ground.terrain_height, ground.current_height) == pytest.approx(
        (20.0, peer.pilot.state.position_m[2]), abs=0.01
    )


def test_outputs_follow_throttle_and_arming():
    peer = Copter()
    assert peer.asked(36).servo1_raw == 1000
    peer.pilot.arm()
    peer.wait(0.5)
    assert peer.asked(36).servo1_raw == 1100
    peer.aloft()
    hover = peer.asked(36).servo1_raw
    assert 1400 < hover < 1700
    peer.goto(0.0, 0.0, -60.0)
    peer.wait(0.8)
    assert peer.asked(36).servo1_raw > hover
    rover = Copter("rover")
    assert rover.asked(36).servo3_raw == 1500


def test_channels_are_those_that_are_overridden():
    peer = Copter()
    idle = peer.asked(65)
    assert [idle.chan1_raw, idle.chan2_raw, idle.chan3_raw, idle.chan4_raw] == [1500, 1500, 1000, 1500]
    assert (idle.chancount, idle.chan5_raw) == (16, 1800)
    peer.tell(m.MAVLink_rc_channels_override_message(1, 1, 1600, 1400, 1700, 1550, 0, 0, 0, 0))
    peer.wait(0.2)
    told = peer.asked(65)
    assert [told.chan1_raw, told.chan2_raw, told.chan3_raw, told.chan4_raw] == [1600, 1400, 1700, 1550]
    peer.wait(4.0)
    assert peer.asked(65).chan3_raw == 1000
