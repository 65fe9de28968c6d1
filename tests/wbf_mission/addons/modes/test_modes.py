"""CIRCLE and FLIP of ArduCopter, orbits of PX4."""

import math

import pytest

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from tests.sim_vehicle.mavlink.test_answers import NAN, Peer
from tests.wbf_mission.addons.modes.test_attitude import CIRCLE, DRIFT, FLIP, ZIGZAG, Copter
from tests.wbf_mission.addons.modes.test_setpoints import HERE, POSITION, local


def test_circle_flies_a_circle_ahead_with_the_nose_to_its_centre():
    rig = Copter().guided(HERE)
    rig.pilot.parameters.stored.update(CIRCLE_RADIUS=1500.0, CIRCLE_RATE=10.0)
    rig.run(1.0)
    x, y, z = rig.place
    yaw = rig.pilot.state.yaw_rad
    centre = (x + 15.0 * math.sin(yaw), y + 15.0 * math.cos(yaw))
    assert rig.mode(CIRCLE) == 0
    assert rig.number == CIRCLE
    rig.run(15.0)
    bearings = []
    for _ in range(10):
        rig.run(1.0)
        east, north = rig.place[0] - centre[0], rig.place[1] - centre[1]
        assert math.hypot(east, north) == pytest.approx(15.0, abs=1.0)
        assert rig.place[2] == pytest.approx(z, abs=0.2)
        bearings.append(math.degrees(math.atan2(east, north)))
        assert math.remainder(rig.yaw - bearings[-1] - 180.0, 360.0) == pytest.approx(0.0, abs=15.0)
    # Clockwise, at 10 deg/s.
    assert (bearings[-1] - bearings[0]) % 360.0 == pytest.approx(90.0, abs=12.0)
    rig.pilot.set_mode(Mode.GUIDED)
    rig.run(8.0)
    turned = rig.yaw
    rig.tell(local(POSITION, 80.0, 0.0, -20.0))
    rig.run(10.0)
    assert rig.yaw != pytest.approx(turned, abs=1.0), "the nose is free again"


def test_flip_rolls_once_round_and_goes_back_to_its_mode():
    rig = Copter().guided(HERE)
    assert rig.mode(FLIP) == 4, "only from STABILIZE, ACRO and ALT_HOLD"
    for mode in (ZIGZAG, DRIFT):
        assert rig.mode(mode) == 0
        assert rig.mode(FLIP) == 4
    assert rig.mode(2) == 0
    rig.run(3.0, stream=rig.sticks())
    rig.run(0.2, stream=rig.sticks(right=950))
    assert rig.mode(FLIP) == 4, "the pilot leans too far"
    rig.run(2.0, stream=rig.sticks())
    height = rig.place[2]
    assert rig.mode(FLIP) == 0
    assert rig.number == FLIP
    rolls, begun_s = [], rig.now_s
    while rig.number == FLIP and rig.now_s < begun_s + 5.0:
        rig.run(0.1, stream=rig.sticks())
        rolls.append(rig.roll)
    assert 0.9 < rig.now_s - begun_s < 2.5
    assert max(rolls) > 100.0
    assert min(rolls) < -60.0
    steps = [math.remainder(b - a, 360.0) for a, b in zip([0.0, *rolls], rolls, strict=False)]
    assert sum(steps[:-1]) == pytest.approx(360.0, abs=15.0)
    assert rig.number == 2
    rig.run(4.0, stream=rig.sticks())
    assert rig.roll == pytest.approx(0.0, abs=5.0)
    assert rig.place[2] == pytest.approx(height, abs=8.0)
    assert Copter().mode(FLIP) == 4


def test_a_radius_of_nothing_turns_on_the_spot():
    rig = Copter().guided(HERE)
    rig.pilot.parameters.stored.update(CIRCLE_RADIUS=0.0, CIRCLE_RATE=-20.0)
    place = rig.place
    assert rig.mode(CIRCLE) == 0
    rig.run(3.0)
    start = rig.yaw
    rig.run(3.0)
    assert (start - rig.yaw) % 360.0 == pytest.approx(60.0, abs=4.0)
    assert rig.place == pytest.approx(place, abs=0.5)


def test_px4_orbits_in_position_control():
    peer = Peer("px4")
    peer.fly()
    order = m.MAVLink_command_int_message(1, 1, 5, 34, 0, 0, 20.0, 3.0, 0, 0, 280500000, -821500000, 20.0)
    peer.tell(order)
    peer.wait(2.0)
    assert peer.of("HEARTBEAT")[-1].custom_mode == 1 << 24 | 3 << 16


@pytest.mark.parametrize("frame", [0, 3, 5, 6])
def test_the_altitude_of_an_orbit_is_above_the_sea_in_any_frame_and_its_approach_fast(frame):
    """MAVSDK sends it so with frame 3."""
    peer = Peer("px4")
    peer.fly()
    east_m, north_m, up_m = peer.vehicle.pilot.state.position_m
    latitude, longitude = peer.vehicle.pilot.frame.to_wgs84(east_m + 60.0, north_m)
    degrees = (round(latitude * 1e7), round(longitude * 1e7))
    amsl_m = peer.vehicle.home.altitude_m + up_m + 5.0
    peer.tell(m.MAVLink_command_int_message(1, 1, frame, 34, 0, 0, 10.0, 2.0, 0, NAN, *degrees, amsl_m))
    peer.wait(6.0)
    assert math.hypot(*peer.vehicle.pilot.state.velocity_m_s[:2]) > 3.0
    peer.wait(20.0)
    east, north, up = peer.vehicle.pilot.state.position_m
    assert up == pytest.approx(up_m + 5.0, abs=0.5)
    assert math.hypot(east - east_m - 60.0, north - north_m) == pytest.approx(10.0, abs=0.5)
    assert math.hypot(*peer.vehicle.pilot.state.velocity_m_s[:2]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize(
    ("behaviour", "off_deg"), [(0, 180.0), (1, None), (3, 90.0), (5, 180.0), (NAN, 180.0)]
)
def test_the_nose_in_an_orbit(behaviour, off_deg):
    peer = Peer("px4", spec=with_autopilot(get_vehicle("quad"), "px4"))
    peer.fly()
    pilot = peer.vehicle.pilot
    began_rad = pilot.state.yaw_rad
    latitude, longitude = pilot.frame.to_wgs84(20.0, 0.0)
    degrees = (round(latitude * 1e7), round(longitude * 1e7))
    above_sea_m = peer.vehicle.home.altitude_m + 10.0
    peer.tell(
        m.MAVLink_command_int_message(1, 1, 0, 34, 0, 0, 12.0, 3.0, behaviour, NAN, *degrees, above_sea_m)
    )
    peer.wait(40.0)
    for _ in range(10):
        peer.wait(2.0)
        east, north, _ = pilot.state.position_m
        at_rad = math.atan2(east - 20.0, north)
        wanted_rad = began_rad if off_deg is None else at_rad + math.radians(off_deg)
        assert abs(math.remainder(pilot.state.yaw_rad - wanted_rad, math.tau)) < math.radians(12.0)
