"""Follow-me of PX4: about a target that tells where it is."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import FRAME, HOME, QUAD
from sweeps import sweep

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from tests.support.peer import Peer
from tests.wbf_mission.addons.modes.test_setpoints import Rig

FOLLOW = (4, 8)
SPEED = 3.0
MODELS = pytest.mark.parametrize("spec", [QUAD, with_autopilot(QUAD, "px4")], ids=["generic", "px4"])


def target(east, north, up=0.0, velocity=(0.0, 0.0, 0.0)):
    """FOLLOW_TARGET as MAVSDK sends it; the velocity is north, east, down."""
    latitude, longitude = FRAME.to_wgs84(east, north)
    unknown = [math.nan] * 3
    return m.MAVLink_follow_target_message(
        *(0, 1, round(latitude * 1e7), round(longitude * 1e7), HOME.altitude_m + up),
        *(list(velocity), unknown, [1.0, math.nan, math.nan, math.nan], unknown, unknown, 0),
    )


class Follower(Rig):
    """A PX4 in the air in the mode Follow me; a target that walks tells of itself each second."""

    def __init__(self, autopilot=PX4, spec=QUAD):
        super().__init__(autopilot, spec)
        self.pilot.arm()
        self.pilot.takeoff(10.0)
        self.run(20.0)
        self.pilot.set_mode(Mode.FOLLOW)

    def walk(self, seconds, start=(0.0, 0.0), velocity=(0.0, 0.0), told=True, up=0.0):
        """Walk east and north; where the target is at the end."""
        east, north = start
        for _ in range(seconds):
            speed = (velocity[1], velocity[0], 0.0) if told else (math.nan,) * 3
            self.tell(target(east, north, up, speed))
            self.run(1.0)
            east, north = east + velocity[0], north + velocity[1]
        return east, north

    @property
    def heading(self):
        return math.degrees(self.pilot.state.yaw_rad) % 360.0


@pytest.mark.parametrize("told", [True, False], ids=["velocity", "positions only"])
@MODELS
def test_it_flies_behind_a_target_that_walks_and_looks_at_it(told, spec):
    rig = Follower(spec=spec)
    _, north = rig.walk(40, (20.0, 0.0), (0.0, SPEED), told)
    x, y, z = rig.place
    assert x == pytest.approx(20.0, abs=1.5)
    assert north - y == pytest.approx(8.0, abs=2.0), "FLW_TGT_DST behind it"
    assert z == pytest.approx(8.0, abs=0.7), "FLW_TGT_HT above home"
    assert rig.heading == pytest.approx(0.0, abs=10.0) or rig.heading > 350.0
    assert math.hypot(*rig.velocity[:2]) == pytest.approx(SPEED, abs=0.7)


@pytest.mark.parametrize(
    ("angle", "east", "north"),
    [(0.0, 0.0, 12.0), (90.0, 12.0, 0.0), (-90.0, -12.0, 0.0), (480.0, 10.4, -6.0)],
)
def test_its_parameters_say_where(angle, east, north):
    rig = Follower()
    for name, value in (("FLW_TGT_FA", angle), ("FLW_TGT_DST", 12.0), ("FLW_TGT_HT", 15.0)):
        rig.tell(m.MAVLink_param_set_message(1, 1, name.encode(), value, m.MAV_PARAM_TYPE_REAL32))
    there = rig.walk(40, (0.0, 0.0), (0.0, 2.0))
    x, y, z = rig.place
    assert (x - there[0], y - there[1]) == pytest.approx((east, north), abs=1.5)
    assert z == pytest.approx(15.0, abs=0.7)


@pytest.mark.parametrize(("up", "height"), [(-30.0, 1.0), (1e6, QUAD.max_altitude_m)])
@MODELS
def test_a_target_of_an_altitude_out_of_reach_is_followed_as_high_or_low_as_it_goes(spec, up, height):
    rig = Follower(spec=spec)
    rig.pilot.parameters.stored["FLW_TGT_ALT_M"] = 2.0
    rig.walk(60, (40.0, 0.0), up=up)
    if height < 10.0:
        assert math.dist(rig.place, (40.0, 0.0, height)) == pytest.approx(8.0, abs=1.0)
        assert rig.place[2] == pytest.approx(height, abs=0.5)
    else:
        assert rig.velocity[2] > 1.0


@MODELS
def test_it_turns_about_the_target_no_faster_than_is_set(spec):
    rig = Follower(spec=spec)
    rig.pilot.parameters.stored["FLW_TGT_MAX_VEL"] = 2.0
    rig.walk(25)
    rig.pilot.parameters.stored["FLW_TGT_FA"] = 0.0
    fastest = 0.0
    for _ in range(40):
        rig.tell(target(0.0, 0.0))
        rig.run(0.5)
        fastest = max(fastest, math.hypot(*rig.velocity[:2]))
        assert 5.0 < math.hypot(*rig.place[:2]) < 11.0, "round it, not over it"
    assert 1.3 < fastest < 2.6
    assert rig.place[1] == pytest.approx(8.0, abs=1.0), "in front of it"


def test_a_target_that_falls_silent_is_waited_at():
    rig = Follower()
    _, north = rig.walk(30, (0.0, 0.0), (0.0, SPEED))
    rig.run(15.0)
    last = rig.place
    assert math.hypot(*rig.velocity[:2]) < 0.2
    rig.run(5.0)
    assert math.dist(rig.place, last) < 0.5
    assert last[1] == pytest.approx(north + 2.0 * SPEED - 8.0, abs=2.5), "it is thought to walk on for 3 s"
    assert rig.vehicle.pilot.mode is Mode.FOLLOW


def test_hold_ends_it():
    rig = Follower()
    rig.walk(10, (0.0, 0.0), (0.0, SPEED))
    rig.pilot.set_mode(Mode.HOLD)
    rig.run(5.0)
    held = rig.place
    rig.walk(10, (100.0, 100.0))
    assert math.dist(rig.place, held) < 0.5


@given(
    st.integers(-(2**31), 2**31 - 1),
    st.integers(-(2**31), 2**31 - 1),
    st.floats(width=32),
    st.lists(st.floats(width=32), min_size=3, max_size=3),
)
@sweep(few=10, many=40)
def test_a_target_without_a_place_is_none(latitude, longitude, altitude, velocity):
    message = target(0.0, 0.0)
    message.lat, message.lon, message.alt, message.vel = latitude, longitude, altitude, velocity
    rig = Rig(PX4)
    rig.pilot.arm()
    rig.pilot.takeoff(10.0)
    rig.run(15.0)
    rig.pilot.set_mode(Mode.FOLLOW)
    before = rig.place
    rig.tell(message)
    rig.run(2.0)
    assert all(map(math.isfinite, rig.place))
    assert math.dist(rig.place, before) < 40.0


def test_a_px4_does_not_arm_in_it_and_others_do_not_have_it():
    peer = Peer(PX4)
    assert peer.result(176, 1, *FOLLOW) == 0
    assert peer.result(400, 1.0) == 1
    for other in (Peer(PX4, "fixed-wing"), Peer(PX4, "rover")):
        assert other.result(176, 1, *FOLLOW) != 0
    assert Peer(ARDUPILOT).result(176, 1, 23) == 4
