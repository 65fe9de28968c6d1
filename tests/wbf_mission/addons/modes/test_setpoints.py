"""Setpoints: GUIDED as ArduPilot, OFFBOARD as PX4."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import FRAME
from rig import Rig as SafetyRig
from sweeps import sweep

from mission.link.codec.dialect import mavlink as m
from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import RefusedError

POSITION, VELOCITY = 0b110111111000, 0b110111000111
YAW = 0b100111111111
BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])


class Rig(SafetyRig):
    def guided(self, first):
        """Be in the air in the mode for setpoints."""
        self.pilot.arm()
        self.pilot.takeoff(20.0)
        self.run(40.0, until=lambda: self.pilot.state.phase is FlightPhase.HOLD)
        self.run(0.3, stream=first)
        self.pilot.set_mode(Mode.GUIDED)
        return self

    @property
    def velocity(self):
        return self.pilot.state.velocity_m_s


def local(mask, x=0.0, y=0.0, z=0.0, vx=0.0, vy=0.0, vz=0.0, yaw=0.0, rate=0.0, frame=1, target=(1, 1)):
    return m.MAVLink_set_position_target_local_ned_message(
        0, *target, frame, mask, x, y, z, vx, vy, vz, 0.0, 0.0, 0.0, yaw, rate
    )


def world(mask, x, y, altitude, frame=6, **extra):
    latitude, longitude = FRAME.to_wgs84(float(x), float(y))
    values = {name: extra.get(name, 0.0) for name in ("vx", "vy", "vz")}
    return m.MAVLink_set_position_target_global_int_message(
        0,
        1,
        1,
        frame,
        mask,
        round(latitude * 1e7),
        round(longitude * 1e7),
        altitude,
        *values.values(),
        0,
        0,
        0,
        0,
        0,
    )


HERE = local(POSITION, 0.0, 0.0, -20.0)


@BOTH
def test_places_in_the_local_and_the_global_frame(autopilot):
    rig = Rig(autopilot).guided(HERE)
    rig.run(20.0, stream=local(POSITION, 30.0, -10.0, -25.0))
    assert rig.place == pytest.approx((-10.0, 30.0, 25.0), abs=0.06)
    rig.run(20.0, stream=world(POSITION, 15.0, 5.0, 18.0))
    assert rig.place == pytest.approx((15.0, 5.0, 18.0), abs=0.1)
    rig.run(20.0, stream=world(POSITION, 0.0, 0.0, 50.0, frame=5))
    assert rig.place == pytest.approx((0.0, 0.0, 30.0), abs=0.1)
    assert rig.pilot.mode is Mode.GUIDED
    rig.run(12.0, stream=local(0b110111111011, z=-12.0))
    assert rig.place == pytest.approx((0.0, 0.0, 12.0), abs=0.2)


@BOTH
def test_velocities(autopilot):
    rig = Rig(autopilot).guided(HERE)
    rig.run(8.0, stream=local(VELOCITY, vx=3.0, vy=-2.0, vz=-1.0))
    assert rig.velocity == pytest.approx((-2.0, 3.0, 1.0), abs=1e-3)
    rig.run(8.0, stream=world(VELOCITY, 0, 0, 0, vx=0.0, vy=4.0, vz=0.0))
    assert rig.velocity == pytest.approx((4.0, 0.0, 0.0), abs=1e-3)
    # A velocity across at a height.
    rig.run(15.0, stream=local(0b110111100011, z=-40.0, vx=2.0))
    assert rig.velocity == pytest.approx((0.0, 2.0, 0.0), abs=1e-2)
    assert rig.place[2] == pytest.approx(40.0, abs=0.1)


@BOTH
def test_headings_and_rates(autopilot):
    rig = Rig(autopilot).guided(HERE)
    rig.run(8.0, stream=local(0b100111000111, vx=1.0, yaw=1.2))
    assert rig.pilot.state.yaw_rad == pytest.approx(1.2, abs=1e-3)
    rig.run(8.0, stream=local(0b010111000111, vx=1.0, rate=0.4))
    assert rig.pilot.state.yaw_rate_rad_s == pytest.approx(0.4)
    rig.run(8.0, stream=local(0b100111111000, 50.0, 0.0, -20.0, yaw=-1.0))
    assert math.remainder(rig.pilot.state.yaw_rad + 1.0, 2 * math.pi) == pytest.approx(0.0, abs=1e-3)
    rig.run(8.0, stream=local(YAW, yaw=2.0))
    assert rig.pilot.state.yaw_rad == pytest.approx(2.0, abs=1e-3)


@BOTH
def test_velocities_of_the_body(autopilot):
    rig = Rig(autopilot).guided(HERE)
    rig.run(5.0, stream=local(YAW, yaw=math.pi / 2))
    # ArduCopter's nose follows a velocity without a heading; 0 is where it points.
    rig.run(8.0, stream=local(VELOCITY & ~1024, vx=2.0, vy=1.0, frame=8))
    # Forward is east now, right is south.
    assert rig.velocity[:2] == pytest.approx((2.0, -1.0), abs=0.02)


def test_offsets_are_flown_by_ardupilot_and_refused_by_px4():
    rig = Rig(ARDUPILOT).guided(HERE)
    rig.run(15.0, stream=local(POSITION, 10.0, 0.0, -20.0))
    rig.tell(local(POSITION, 5.0, 0.0, -2.0, frame=7))
    rig.run(10.0)
    assert rig.place == pytest.approx((0.0, 15.0, 22.0), abs=0.1)
    rig = Rig(PX4).guided(HERE)
    rig.run(1.0, stream=local(POSITION, 5.0, 0.0, -2.0, frame=9))
    assert rig.texts.count("Setpoint refused: no positions in frame 9") == 1


def test_px4_wants_a_stream_before_and_during_offboard():
    rig = Rig(PX4)
    rig.pilot.arm()
    rig.pilot.takeoff(20.0)
    rig.run(15.0)
    with pytest.raises(RefusedError, match="no setpoints"):
        rig.pilot.set_mode(Mode.GUIDED)
    rig.tell(HERE)
    rig.run(1.5)
    with pytest.raises(RefusedError, match="no setpoints"):
        rig.pilot.set_mode(Mode.GUIDED)
    rig.run(0.5, stream=local(VELOCITY, vx=3.0))
    rig.pilot.set_mode(Mode.GUIDED)
    rig.run(6.0, stream=local(VELOCITY, vx=3.0))
    assert rig.velocity[1] == pytest.approx(3.0, abs=1e-3)
    rig.run(0.9)
    assert rig.pilot.mode is Mode.GUIDED
    rig.run(0.4)
    assert rig.pilot.mode is Mode.RTL
    assert "Offboard control lost: returning" in rig.texts


def test_ardupilot_flies_velocities_for_three_seconds_and_places_for_ever():
    rig = Rig(ARDUPILOT).guided(HERE)
    rig.tell(local(VELOCITY, vx=4.0))
    rig.run(2.9)
    assert rig.velocity[1] == pytest.approx(4.0, abs=0.1)
    rig.run(6.0)
    assert math.hypot(*rig.velocity) < 0.01
    assert rig.pilot.mode is Mode.GUIDED
    assert rig.texts.count("Guided timeout: stopping") == 1
    rig.tell(local(POSITION, 60.0, 0.0, -20.0))
    rig.run(20.0)
    assert rig.place == pytest.approx((0.0, 60.0, 20.0), abs=0.1)


def test_ardupilot_listens_in_guided_only():
    rig = Rig(ARDUPILOT)
    rig.pilot.set_mode(Mode.GUIDED)
    rig.pilot.arm()
    rig.pilot.takeoff(10.0)
    rig.run(15.0)
    assert rig.pilot.mode is Mode.GUIDED
    rig.pilot.set_mode(Mode.HOLD)
    rig.run(5.0, stream=local(VELOCITY, vx=4.0))
    assert math.hypot(*rig.velocity[:2]) < 0.01
    assert rig.texts.count("Guided timeout: stopping") == 0


STANDING = [
    local(VELOCITY),
    local(YAW & VELOCITY),
    local(VELOCITY, vx=2.0),
    local(VELOCITY, vz=1.0),
    local(POSITION),
    local(POSITION, 5.0, 5.0, 0.0),
    local(POSITION, 0.0, 0.0, 3.0),
]


@pytest.mark.parametrize("standing", STANDING)
def test_offboard_begins_on_the_ground_with_any_setpoint_and_lifts_with_one_that_climbs(standing):
    """PX4 looks at the age of the setpoints only; MAVSDK's examples begin with one that stands."""
    rig = Rig(PX4)
    rig.pilot.arm()
    rig.run(0.5, stream=standing)
    rig.pilot.set_mode(Mode.GUIDED)
    rig.run(2.0, stream=standing)
    assert rig.place == (0.0, 0.0, 0.0)
    assert rig.pilot.landed is LandedState.ON_GROUND
    assert rig.pilot.armed
    assert not [text for text in rig.texts if "refused" in text or "not available" in text]
    rig.run(15.0, stream=local(POSITION, 0.0, 0.0, -5.0))
    assert rig.place == pytest.approx((0.0, 0.0, 5.0), abs=0.1)
    rig.run(3.0, stream=local(VELOCITY))
    assert rig.place == pytest.approx((0.0, 0.0, 5.0), abs=0.3)


REFUSED = [
    (local(POSITION, 1.0, 1.0, -5.0, frame=20), "frame 20"),
    (world(POSITION, 1, 1, 5.0, frame=11), "frame 11"),
    (local(0b110111111111), "neither position nor velocity"),
    (local(POSITION & ~448 | 512, 1.0, 1.0, -5.0), "forces"),
    (local(POSITION, 1e7, 1.0, -5.0), "from the start"),
    (local(POSITION, 1.0, 1.0, -501.0), "altitude"),
    (local(VELOCITY, vx=math.inf), "infinite values"),
]


@BOTH
@pytest.mark.parametrize(("message", "reason"), REFUSED)
def test_what_is_not_flown_is_refused_with_a_reason_once(autopilot, message, reason):
    rig = Rig(autopilot).guided(HERE)
    before = rig.place
    for _ in range(5):
        rig.tell(message)
        rig.run(0.1)
    assert sum(reason in text for text in rig.texts) == 1
    assert rig.place == pytest.approx(before, abs=0.05)


@pytest.mark.parametrize(
    ("current", "frame", "height"), [(2, 3, 15.0), (2, 6, 15.0), (2, 0, 35.0), (0, 3, 15.0)]
)
def test_ardupilot_flies_to_an_item_for_the_guided_mode(current, frame, height):
    """DroneKit's `simple_goto`: a mission item with `current` 2."""
    rig = Rig(ARDUPILOT).guided(HERE)
    mission = rig.pilot.mission.items
    latitude, longitude = FRAME.to_wgs84(20.0, 40.0)
    numbers = (1, 1, 0, frame, 16, current, 0, 0.0, 0.0, 0.0, 0.0)
    item = m.MAVLink_mission_item_message(*numbers, latitude, longitude, height)
    if frame == 6:
        position = (round(latitude * 1e7), round(longitude * 1e7))
        item = m.MAVLink_mission_item_int_message(*numbers, *position, height)
    rig.tell(item)
    rig.run(25.0)
    there = (20.0, 40.0, 15.0) if current == 2 else (0.0, 0.0, 20.0)
    assert rig.place == pytest.approx(there, abs=1.0)
    assert rig.pilot.mission.items == mission
    assert rig.pilot.mode is Mode.GUIDED


def test_setpoints_for_others_and_a_disarmed_vehicle():
    rig = Rig(ARDUPILOT).guided(HERE)
    rig.run(5.0, stream=local(VELOCITY, vx=4.0, target=(2, 1)))
    assert math.hypot(*rig.velocity) < 0.01
    ground = Rig(ARDUPILOT)
    ground.pilot.set_mode(Mode.GUIDED)
    ground.run(2.0, stream=local(POSITION, 5.0, 5.0, -5.0))
    assert ground.place == (0.0, 0.0, 0.0)


def test_ardupilot_keeps_guided_positions_within_the_fence():
    rig = Rig(ARDUPILOT)
    rig.pilot.parameters.fence_enable = 1
    rig.pilot.parameters.fence_radius_m = 50.0
    rig.pilot.apply_parameters()
    rig.guided(HERE)
    rig.tell(local(POSITION, 80.0, 0.0, -20.0))
    rig.run(3.0)
    assert any("outside the fence" in text for text in rig.texts)
    assert math.hypot(*rig.place[:2]) < 0.5


FLOATS = st.floats(allow_nan=True, allow_infinity=True, width=32)


@sweep(few=25, many=120)
@given(
    st.sampled_from([PX4, ARDUPILOT]),
    st.lists(
        st.tuples(st.integers(0, 65535), st.sampled_from([1, 7, 8, 9, 12, 3, 255]), st.tuples(*[FLOATS] * 8)),
        min_size=1,
        max_size=5,
    ),
)
def test_hostile_setpoints_do_no_harm(autopilot, orders):
    rig = Rig(autopilot).guided(HERE)
    for mask, frame, values in orders:
        rig.tell(local(mask, *values, frame=frame))
        rig.run(1.0)
    numbers = [*rig.place, *rig.velocity, rig.pilot.state.yaw_rad, rig.pilot.state.yaw_rate_rad_s]
    assert all(map(math.isfinite, numbers))
    assert rig.place[2] >= -0.1


def yaw(rig, angle_deg, rate_deg_s=0.0, direction=1.0, relative=0.0):
    """CONDITION_YAW, as DroneKit's `condition_yaw` and MAVProxy's `setyaw` send it."""
    numbers = (angle_deg, rate_deg_s, direction, relative, 0.0, 0.0, 0.0)
    rig.tell(m.MAVLink_command_long_message(1, 1, 115, 0, *numbers))


def degrees(rig):
    return math.degrees(rig.pilot.state.yaw_rad)


def test_the_nose_turns_while_arducopter_flies_on():
    rig, straight = Rig(ARDUPILOT).guided(HERE), Rig(ARDUPILOT).guided(HERE)
    far = local(POSITION, 0.0, 200.0, -20.0)
    for one in (rig, straight):
        one.tell(far)
        one.run(8.0)
    assert degrees(rig) == pytest.approx(90.0, abs=1.0)
    yaw(rig, 180.0, 20.0)
    rig.run(2.5)
    straight.run(2.5)
    # 20 deg/s, after it has begun to turn; and nothing of the flight itself is another one.
    assert 110.0 < degrees(rig) < 150.0
    rig.run(5.0)
    straight.run(5.0)
    assert degrees(rig) == pytest.approx(180.0, abs=1.0)
    assert degrees(straight) == pytest.approx(90.0, abs=1.0)
    assert rig.place == pytest.approx(straight.place, abs=1e-9)
    assert math.hypot(*rig.velocity) > 5.0
    # It stays to the end of the way and there.
    rig.run(30.0)
    assert rig.place == pytest.approx((200.0, 0.0, 20.0), abs=0.1)
    assert degrees(rig) == pytest.approx(180.0, abs=1.0)
    # The next target is flown to by WP_YAW_BEHAVIOR again, also if it is the same one.
    rig.tell(local(POSITION, 0.0, 100.0, -20.0))
    rig.run(6.0)
    assert degrees(rig) == pytest.approx(270.0, abs=1.0)
    yaw(rig, 0.0)
    rig.run(5.0)
    assert math.remainder(degrees(rig), 360.0) == pytest.approx(0.0, abs=1.0)
    rig.tell(local(POSITION, 0.0, 100.0, -20.0))
    rig.run(5.0)
    assert degrees(rig) == pytest.approx(270.0, abs=1.0)


@pytest.mark.parametrize("own", [True, False], ids=["arducopter", "generic"])
def test_in_a_mission_an_ordered_heading_ends_at_the_next_waypoint(own):
    rig = Rig(ARDUPILOT, with_autopilot(get_vehicle("quad"), "ardupilot") if own else get_vehicle("quad"))
    rig.guided(HERE)
    places = [FRAME.to_wgs84(x, y) for x, y in ((0.0, 80.0), (0.0, 150.0), (60.0, 150.0))]
    rig.pilot.load([MissionItem.waypoint(*place, 20.0) for place in places])
    rig.pilot.set_mode(Mode.MISSION)
    rig.run(4.0)
    yaw(rig, 270.0, direction=-1.0)
    rig.run(4.0)
    assert rig.pilot.mission.current_seq == 0
    assert degrees(rig) == pytest.approx(270.0, abs=1.5)
    rig.run(30.0, until=lambda: rig.pilot.mission.current_seq == 1)
    rig.run(5.0)
    assert rig.pilot.mission.current_seq == 1
    assert math.remainder(degrees(rig), 360.0) == pytest.approx(0.0, abs=1.5)


def test_a_heading_is_turned_to_as_it_is_told():
    rig = Rig(ARDUPILOT).guided(HERE)
    rig.run(1.0)
    yaw(rig, 30.0)
    rig.run(5.0)
    # The long way round, clockwise.
    yaw(rig, 350.0, 30.0, 1.0)
    rig.run(4.0)
    assert 80.0 < degrees(rig) < 160.0
    rig.run(12.0)
    assert degrees(rig) == pytest.approx(350.0, abs=1.0)
    yaw(rig, 40.0, 0.0, -1.0, 1.0)
    rig.run(4.0)
    assert degrees(rig) == pytest.approx(310.0, abs=1.0)
    # What is told of it again counts from the heading that was asked for.
    yaw(rig, 90.0, 10.0, 1.0, 1.0)
    yaw(rig, 20.0, 0.0, 1.0, 1.0)
    rig.run(6.0)
    assert degrees(rig) == pytest.approx(330.0, abs=1.0)
    # A velocity is flown with it, too.
    rig.run(3.0, stream=local(VELOCITY, vx=3.0))
    yaw(rig, 90.0)
    rig.run(2.5)
    assert degrees(rig) == pytest.approx(90.0, abs=15.0)
    assert rig.velocity == pytest.approx((0.0, 3.0, 0.0), abs=1e-2)
