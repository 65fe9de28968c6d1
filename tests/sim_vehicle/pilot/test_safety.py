"""Safety functions of both autopilots: geofence, link, battery, position, motors, arming, rally points."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from mission.link.codec.dialect import mavlink as m
from mission.model import MissionItem, MissionType
from mission.outcome import Outcome
from mission.transfer import wire
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.pilot.controls import RefusedError
from sim_vehicle.pilot.fence import Breach
from tests.support.rig import FRAME, HOME, QUAD, Rig

BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])


def wp(x, y, z=10.0, **options):
    return MissionItem.waypoint(*FRAME.to_wgs84(float(x), float(y)), z, **options)


def zone(command, points, first=None):
    places = [FRAME.to_wgs84(float(x), float(y)) for x, y in points]
    return [MissionItem(command, 0, float(first or len(points)), x=a, y=b) for a, b in places]


def takeoff(z=10.0):
    return MissionItem(22, 3, 0, 0, 0, None, HOME.latitude_deg, HOME.longitude_deg, z)


RTL = MissionItem(20)
SQUARE = [(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)]


def drifting(autopilot, x, y=0.0, *, height_m=20.0, fence=None, **tuning):
    """A vehicle that flies at a velocity out of a fence, by default that of the square."""
    rig = Rig(autopilot, **tuning)
    rig.pilot.set_fence(fence or zone(5001, SQUARE))
    rig.aloft(height_m)
    rig.drift(x, y)
    return rig


ACTIONS = [
    (PX4, 2, Mode.HOLD),
    (PX4, 3, Mode.RTL),
    (PX4, 5, Mode.LAND),
    (ARDUPILOT, 1, Mode.RTL),
    (ARDUPILOT, 2, Mode.LAND),
    (ARDUPILOT, 4, Mode.HOLD),
]


@pytest.mark.parametrize(("autopilot", "action", "mode"), ACTIONS)
def test_leaving_the_fence_has_its_action(autopilot, action, mode):
    rig = Rig(autopilot, fence_enable=1, fence_action=action)
    rig.pilot.set_fence(zone(5001, SQUARE))
    rig.aloft()
    assert rig.health(1 << 20)
    rig.drift(6.0, 0.0)
    rig.run(60.0, until=lambda: rig.pilot.mode is mode and rig.pilot.failsafe.active)
    assert rig.pilot.failsafe.fence.breach is Breach.BOUNDARY
    assert not rig.health(1 << 20)
    assert any("outside the area" in text for text in rig.texts)
    (status,) = rig.vehicle.built(m.MAVLINK_MSG_ID_FENCE_STATUS)
    assert (status.breach_status, status.breach_count, status.breach_type) == (1, 1, 3)
    assert 50.0 < rig.place[0] < 52.0
    rig.run(80.0)
    assert rig.place[0] < 62.0
    assert rig.pilot.outcome is Outcome.FENCE_BREACHED
    if mode is Mode.RTL:
        assert rig.pilot.failsafe.fence.breach is Breach.NONE
        assert not rig.pilot.armed
        assert sum("cleared" in text for text in rig.texts) == 1


@BOTH
def test_a_warning_only_warns_and_nothing_is_nothing(autopilot):
    rig = drifting(autopilot, 6.0, fence_enable=1, fence_action=0 if autopilot is ARDUPILOT else 1)
    rig.run(15.0)
    assert rig.place[0] > 70.0
    assert any("outside the area" in text for text in rig.texts)
    assert not rig.pilot.failsafe.active
    quiet = drifting(autopilot, 6.0, fence_enable=0)
    quiet.run(15.0)
    assert not any("outside" in text for text in quiet.texts)


def test_termination_at_the_fence():
    rig = drifting(PX4, 8.0, height_m=40.0, fence_action=4)
    rig.run(40.0, until=lambda: not rig.pilot.armed)
    assert rig.pilot.outcome is Outcome.CRASHED
    assert rig.place[2] == 0.0
    assert 50.0 < rig.place[0] < 85.0


def test_ceiling_and_radius():
    rig = Rig(PX4, fence_ceiling_m=25.0, fence_action=3)
    rig.aloft(20.0)
    rig.drift(0.0, 0.0, 3.0)
    rig.run(20.0, until=lambda: rig.pilot.mode is Mode.RTL)
    assert any("25 m are allowed" in text for text in rig.texts)
    rig = Rig(ARDUPILOT, fence_enable=1, fence_radius_m=40.0)
    rig.aloft(20.0)
    rig.drift(0.0, 5.0)
    rig.run(20.0, until=lambda: rig.pilot.mode is Mode.RTL)
    assert any("40 m are allowed" in text for text in rig.texts)
    rig.tune(fence_type=4)
    assert rig.pilot.failsafe.outside((500.0, 0.0, 10.0)) is None


def test_an_exclusion_zone_is_not_entered_for_long():
    rig = drifting(PX4, 8.0, fence=zone(5004, [(60.0, 0.0)], 20.0), fence_action=2)
    rig.run(30.0)
    assert 40.0 < rig.place[0] < 56.0
    assert rig.pilot.mode is Mode.HOLD


def own_return_point(x, y, z):
    latitude, longitude = FRAME.to_wgs84(x, y)
    return [*zone(5001, SQUARE), MissionItem(5000, 3, x=latitude, y=longitude, z=z)]


@pytest.mark.parametrize(("action", "mode"), [(1, None), (2, Mode.HOLD), (5, Mode.LAND)])
def test_the_fences_own_return_point_is_for_the_action_return_only(action, mode):
    rig = drifting(PX4, 6.0, fence=own_return_point(0.0, -20.0, 15.0), fence_action=action)
    before = rig.pilot.mode
    rig.run(20.0)
    assert rig.place[0] > 50.0
    assert rig.pilot.mode is (mode or before)
    assert rig.pilot.failsafe.active is (mode is not None)


def test_the_fences_own_return_point():
    rig = drifting(PX4, 6.0, 3.0, fence=own_return_point(-20.0, 10.0, 30.0), fence_action=3)
    rig.run(80.0)
    assert rig.place == pytest.approx((-20.0, 10.0, 30.0), abs=0.2)
    assert rig.pilot.armed


@sweep(few=4, many=20)
@given(
    st.floats(0.0, 2.0 * math.pi),
    st.floats(1.0, 13.0),
    st.sampled_from(["circle", "square", "ceiling"]),
    st.sampled_from([2, 3, 5]),
)
def test_a_vehicle_goes_no_farther_out_than_it_needs_to_stop(angle, speed, kind, action):
    rig = Rig(PX4, fence_action=action, fence_ceiling_m=40.0 if kind == "ceiling" else 0.0)
    if kind == "circle":
        rig.pilot.set_fence(zone(5003, [(0.0, 0.0)], 60.0))
    elif kind == "square":
        rig.pilot.set_fence(zone(5001, SQUARE))
    rig.aloft()
    watch = rig.pilot.failsafe.fence
    across = 0.0 if kind == "ceiling" else speed
    rig.drift(
        across * math.cos(angle), across * math.sin(angle), min(speed, 4.0) if kind == "ceiling" else 0.0
    )
    rig.run(120.0, until=lambda: watch.breach is not Breach.NONE)
    assert watch.breach is not Breach.NONE
    state = rig.pilot.state
    velocity = math.hypot(*state.velocity_m_s)
    # What it takes to stop along a leg, and what was flown until the next look.
    a, j = (0.8 * QUAD.acceleration_m_s2, 0.8 * QUAD.jerk_m_s3)
    if kind == "ceiling":
        a, j = 0.8 * QUAD.vertical_acceleration_m_s2, 0.8 * QUAD.vertical_jerk_m_s3
    stopping = 0.5 * velocity * (velocity / a + a / j) + 0.1 * velocity + 0.5
    farthest = 0.0
    for _ in range(600):
        rig.run(0.1)
        farthest = min(farthest, watch.evaluate(rig.place, (0.0, 0.0, 0.0))[2])
        if not rig.pilot.armed:
            break
    assert -farthest <= stopping
    if action == 3:
        assert watch.evaluate(rig.place, (0.0, 0.0, 0.0))[0] is Breach.NONE


def refuses_to_arm_in_mission(rig):
    rig.pilot.set_mode(Mode.MISSION)
    rig.pilot.arm()


@BOTH
def test_missions_and_targets_outside_the_fence_are_refused(autopilot):
    rig = Rig(autopilot, fence_enable=1)
    rig.pilot.load([takeoff(), wp(20, 0), wp(70, 0), RTL])
    assert rig.pilot.mission.why_not is None
    rig.pilot.set_fence(zone(5001, SQUARE))
    assert "item 3 (NAV_WAYPOINT): outside the fence, 20.0 m outside the area" in rig.pilot.mission.why_not
    rig.run(0.2)
    # ArduCopter has no word for it.
    assert any(text.startswith("Mission rejected: item 3") for text in rig.texts) is (autopilot is PX4)
    with pytest.raises(RefusedError, match="outside the fence"):
        rig.pilot.start_mission() if autopilot is ARDUPILOT else refuses_to_arm_in_mission(rig)
    rig.pilot.load([takeoff(), wp(20, 0), RTL])
    rig.pilot.set_mode(Mode.HOLD)
    assert rig.pilot.mission.why_not is None
    rig.aloft()
    with pytest.raises(RefusedError, match="fence"):
        rig.goto(80, 0)
    rig.goto(40, 0)
    rig.tune(fence_ceiling_m=15.0)
    rig.pilot.set_fence(())
    with pytest.raises(RefusedError, match="15 m are allowed"):
        rig.goto(40, 0, 30.0)


@BOTH
def test_no_arming_outside_the_fence(autopilot):
    rig = Rig(autopilot, fence_enable=1)
    rig.pilot.set_fence(zone(5002, SQUARE))
    expected = "Arm: fence" if autopilot is ARDUPILOT else "Preflight Fail: fence"
    with pytest.raises(RefusedError, match=expected):
        rig.pilot.arm()
    rig.run(0.2)
    assert any(text.startswith(expected) for text in rig.texts)
    assert not rig.health(1 << 28)
    rig.pilot.arm(force=True)
    assert rig.pilot.armed


@pytest.mark.parametrize(
    ("autopilot", "action", "mode"),
    [
        (PX4, 1, Mode.HOLD),
        (PX4, 2, Mode.RTL),
        (PX4, 3, Mode.LAND),
        (ARDUPILOT, 1, Mode.RTL),
        (ARDUPILOT, 5, Mode.LAND),
    ],
)
def test_the_loss_of_the_ground_station(autopilot, action, mode):
    rig = Rig(autopilot, link_action=action)
    timeout = rig.pilot.parameters.link_timeout_s
    assert timeout == (5.0 if autopilot is ARDUPILOT else 10.0)
    with pytest.raises(RefusedError, match="no connection to the ground control station"):
        rig.pilot.arm()
    rig.run(2.0, beats=True)
    rig.aloft(beats=True)
    rig.goto(300, 0)
    rig.run(2.0 * timeout, beats=True)
    assert not rig.pilot.failsafe.link_lost
    rig.run(timeout + 1.2, until=lambda: rig.pilot.failsafe.link_lost)
    silent_s = rig.now_s
    assert rig.pilot.mode is mode
    assert rig.pilot.outcome is Outcome.LINK_LOST
    rig.run(3.0, beats=True)
    assert rig.now_s > silent_s
    assert any(text in rig.texts for text in ("Data link regained", "GCS Failsafe Cleared"))
    assert not rig.pilot.failsafe.link_lost


@BOTH
def test_without_an_action_the_loss_of_the_link_is_only_told(autopilot):
    rig = Rig(autopilot)
    rig.run(2.0, beats=True)
    rig.aloft()
    rig.run(20.0)
    assert rig.texts.count("Data link lost") == (autopilot is PX4)
    assert not any("GCS" in text for text in rig.texts), "ArduPilot says nothing with FS_GCS_ENABLE 0"
    assert rig.pilot.state.phase is FlightPhase.HOLD
    never = Rig(autopilot)
    never.aloft()
    never.run(20.0)
    assert not any("link" in text or "GCS" in text for text in never.texts)


def test_other_heartbeats_do_not_count():
    rig = Rig(PX4, link_action=2)
    rig.beat()
    rig.aloft()
    for _ in range(20):
        rig.tell(m.MAVLink_heartbeat_message(m.MAV_TYPE_CAMERA, 8, 0, 0, 4, 3), 1, 100)
        rig.run(1.0)
    assert rig.pilot.failsafe.link_lost


LEVELS = [
    (PX4, {"low_battery_action": 0}, (None, None, None)),
    (PX4, {"low_battery_action": 1}, (Mode.RTL, Mode.LAND, Mode.LAND)),
    (PX4, {"low_battery_action": 2}, (None, Mode.LAND, Mode.LAND)),
    (PX4, {"low_battery_action": 3}, (None, Mode.RTL, Mode.LAND)),
    (ARDUPILOT, {"low_battery_action": 0, "critical_battery_action": 0}, (None, None, None)),
    (ARDUPILOT, {}, (Mode.RTL, Mode.LAND, Mode.LAND)),
    (ARDUPILOT, {"low_battery_action": 1, "critical_battery_action": 2}, (Mode.LAND, Mode.LAND, Mode.LAND)),
]


@pytest.mark.parametrize(("autopilot", "tuning", "modes"), LEVELS)
def test_the_battery_failsafes_of_both_autopilots(autopilot, tuning, modes):
    rig = Rig(autopilot, **tuning)
    rig.aloft(30.0)
    rig.goto(200, 0, 30.0)
    rig.run(25.0)
    mode = rig.pilot.mode
    for fraction, expected, word in zip(
        (0.19, 0.09, 0.04), modes, ("low", "critical", "almost empty"), strict=True
    ):
        rig.pilot.drain_battery(fraction)
        rig.run(0.5)
        mode = expected or mode
        assert rig.pilot.mode is mode
        assert any(f"Battery {word}" in text for text in rig.texts)
    assert rig.pilot.failsafe.active is any(modes)


@BOTH
def test_a_dead_battery(autopilot):
    rig = Rig(autopilot)
    rig.aloft()
    rig.pilot.drain_battery(0.0)
    rig.run(30.0)
    assert rig.pilot.outcome is Outcome.BATTERY_DEPLETED
    assert rig.place[2] == 0.0
    with pytest.raises(RefusedError, match="battery"):
        rig.pilot.arm()


@BOTH
def test_the_loss_of_the_position(autopilot):
    rig = Rig(autopilot)
    rig.pilot.position_ok = False
    with pytest.raises(RefusedError, match="no position"):
        rig.pilot.arm()
    rig.pilot.position_ok = True
    rig.aloft()
    rig.goto(100, 0)
    rig.run(5.0)
    rig.pilot.position_ok = False
    rig.run(0.3)
    assert rig.pilot.mode is Mode.LAND
    assert "Position lost: landing" in rig.texts
    with pytest.raises(RefusedError, match="no position"):
        rig.pilot.set_mode(Mode.RTL)
    rig.pilot.position_ok = True
    rig.run(0.3)
    assert "Position regained" in rig.texts
    rig.pilot.set_mode(Mode.RTL)
    rig.run(120.0)
    assert not rig.pilot.armed
    assert math.hypot(*rig.place) < 0.2


@BOTH
def test_a_motor_that_fails(autopilot):
    rig = Rig(autopilot)
    rig.aloft(30.0)
    rig.goto(100, 0, 30.0)
    rig.run(5.0)
    rig.pilot.fail_motor()
    assert rig.pilot.state.phase is FlightPhase.FALLING
    with pytest.raises(RefusedError, match="falling"):
        rig.pilot.set_mode(Mode.HOLD)
    rig.run(8.0)
    assert rig.pilot.outcome is Outcome.CRASHED
    assert not rig.pilot.armed
    assert rig.pilot.landed is LandedState.ON_GROUND
    assert any("motor failure" in text for text in rig.texts)
    with pytest.raises(RefusedError, match="motor failure"):
        rig.pilot.arm()
    rig.pilot.fail_motor(False)
    rig.pilot.set_mode(Mode.HOLD)
    rig.pilot.arm()
    assert rig.pilot.armed
    rig.pilot.fail_motor()
    rig.run(0.5)
    assert not rig.pilot.armed, "on the ground it only disarms"


@BOTH
@pytest.mark.parametrize("items", [[takeoff(), wp(40, 0), RTL], []])
def test_a_mission_that_comes_while_the_vehicle_falls_is_taken_and_not_flown(autopilot, items):
    rig = Rig(autopilot)
    rig.pilot.load([takeoff(), wp(70, 0), RTL])
    rig.pilot.arm()
    rig.pilot.set_mode(Mode.MISSION)
    rig.pilot.start_mission()
    rig.run(20.0)
    rig.pilot.fail_motor()
    rig.pilot.load(items)
    assert rig.pilot.state.phase is FlightPhase.FALLING
    rig.run(8.0)
    assert rig.pilot.outcome is Outcome.CRASHED and not rig.pilot.armed


@BOTH
def test_rally_points_are_returned_to(autopilot):
    rig = Rig(autopilot)
    latitude, longitude = FRAME.to_wgs84(120.0, 0.0)
    rig.pilot.set_rally([MissionItem(5100, 3, x=latitude, y=longitude, z=35.0), MissionItem(16, 3)])
    rig.aloft()
    rig.goto(90, 0)
    rig.run(25.0)
    rig.pilot.set_mode(Mode.RTL)
    rig.run(120.0)
    assert not rig.pilot.armed
    assert rig.place == pytest.approx((120.0, 0.0, 0.0), abs=0.1)


def test_orders_that_change_a_flight():
    rig = Rig(PX4)
    rig.aloft()
    assert rig.command(186, 30.0, 3.0) == 0
    rig.run(15.0)
    assert rig.place[2] == pytest.approx(30.0, abs=0.1)
    latitude, longitude = FRAME.to_wgs84(0.0, 50.0)
    assert rig.command(34, 15.0, 4.0, 0, 0, latitude, longitude, 50.0) == 0
    rig.run(40.0)
    # COMMAND_LONG carries the place as 32-bit floats, good to half a metre.
    assert math.hypot(rig.place[0], rig.place[1] - 50.0) == pytest.approx(15.0, abs=1.5)
    assert rig.command(195, 0, 0, 0, 0, latitude, longitude, 0.0) == 0
    rig.run(5.0)
    x, y, _ = rig.place
    assert math.remainder(rig.pilot.state.yaw_rad - math.atan2(-x, 50.0 - y), 2 * math.pi) == pytest.approx(
        0, abs=0.4
    )
    assert rig.command(197) == 0
    assert rig.command(207, 1.0) == 3
    assert rig.command(115, 90.0) == 3
    assert rig.command(186, math.nan, 3.0) == 2
    assert rig.command(186, 30.0, 9.0) == 2
    assert rig.command(189) != 0
    assert rig.command(185, 0.0) == 0
    assert rig.pilot.armed
    assert rig.command(185, 1.0) == 0
    rig.run(10.0)
    assert rig.pilot.outcome is Outcome.CRASHED


def test_orders_of_ardupilot():
    rig = Rig(ARDUPILOT)
    rig.pilot.set_fence(zone(5001, SQUARE))
    assert not rig.pilot.failsafe.fence_enabled
    assert rig.command(207, 1.0) == 0
    assert rig.pilot.failsafe.fence_enabled
    assert rig.command(207, 7.0) in (2, 4)
    rig.aloft()
    assert rig.command(115, 120.0) == 0
    rig.run(8.0)
    assert math.degrees(rig.pilot.state.yaw_rad) == pytest.approx(120.0, abs=0.5)
    assert rig.command(115, 30.0, 0, -1.0, 1.0) == 0
    rig.run(8.0)
    assert math.degrees(rig.pilot.state.yaw_rad) == pytest.approx(90.0, abs=0.5)
    assert rig.command(34, 15.0) == 3
    assert rig.command(115, 400.0) == 4
    assert rig.command(115, 30.0, 0.0, 0.0, 0.5) == 4


@BOTH
def test_the_landing_part_of_a_mission_is_gone_to(autopilot):
    rig = Rig(autopilot)
    items = [takeoff(), wp(40, 0, hold_s=500.0), MissionItem(189), wp(0, 30), RTL]
    rig.pilot.load(items)
    rig.pilot.arm()
    rig.pilot.set_mode(Mode.MISSION)
    rig.run(20.0)
    assert rig.pilot.mission.current_seq == 1
    assert rig.command(189) == 0
    rig.run(1.0)
    assert rig.pilot.mission.current_seq == 3
    rig.run(120.0)
    assert rig.pilot.outcome is Outcome.COMPLETED


@BOTH
def test_pause_and_continue_at_any_moment(autopilot):
    for when_s in (1.0, 12.0, 22.0):
        rig = Rig(autopilot)
        rig.pilot.load([takeoff(), wp(40, 0, hold_s=5.0), wp(40, 40), RTL])
        rig.pilot.arm()
        rig.pilot.set_mode(Mode.MISSION)
        rig.run(when_s)
        seq = rig.pilot.mission.current_seq
        assert rig.pilot.mission.state == 3
        assert rig.command(193, 0.0) == (0 if autopilot is ARDUPILOT else 3)
        if autopilot is PX4:
            rig.pilot.set_mode(Mode.HOLD)
        assert rig.pilot.mode is (Mode.MISSION if autopilot is ARDUPILOT else Mode.HOLD)
        assert rig.pilot.mission.state == 4
        rig.run(10.0)
        assert math.hypot(*rig.pilot.state.velocity_m_s) < 0.05
        assert rig.pilot.mission.current_seq == seq
        if autopilot is PX4:
            rig.pilot.set_mode(Mode.MISSION)
        else:
            assert rig.command(193, 1.0) == 0
        assert rig.pilot.mission.state == 3
        rig.run(150.0)
        assert rig.pilot.outcome is Outcome.COMPLETED
    assert rig.command(193, 0.5) == (2 if autopilot is ARDUPILOT else 3)


@BOTH
@pytest.mark.parametrize("when_s", [2.0, 30.0])
def test_the_current_item_is_set_at_any_moment(autopilot, when_s):
    rig = Rig(autopilot)
    rig.pilot.load([takeoff(), wp(40, 0, hold_s=5.0), wp(40, 40), RTL])
    rig.pilot.arm()
    rig.pilot.set_mode(Mode.MISSION)
    rig.run(when_s)
    own = 2
    rig.tell(m.MAVLink_mission_set_current_message(1, 1, rig.vehicle.state.wire_seq(own)))
    assert rig.pilot.mission.current_seq == own
    rig.run(150.0)
    assert rig.pilot.outcome is Outcome.COMPLETED


def test_a_fence_and_rally_points_come_over_the_link():
    rig = Rig(PX4)
    latitude, longitude = FRAME.to_wgs84(30.0, 0.0)
    plans = {1: zone(5001, SQUARE), 2: [MissionItem(5100, 3, x=latitude, y=longitude, z=20.0)]}
    for kind, items in plans.items():
        rig.tell(m.MAVLink_mission_count_message(1, 1, len(items), kind))
        for seq, item in enumerate(items):
            rig.tell(wire.item_to_message(item, seq, MissionType(kind), (1, 1)))
    assert rig.pilot.failsafe.outside((80.0, 0.0, 10.0)) == "30.0 m outside the area"
    (point,) = rig.pilot.executor.mission.return_points.rally_m
    assert point == pytest.approx((30.0, 0.0, 20.0), abs=0.02)
    rig.tell(m.MAVLink_mission_clear_all_message(1, 1, 1))
    rig.tell(m.MAVLink_mission_clear_all_message(1, 1, 2))
    assert rig.pilot.failsafe.outside((80.0, 0.0, 10.0)) is None
    assert rig.pilot.executor.mission.return_points.rally_m == ()


@BOTH
def test_the_parameters_act(autopilot):
    rig = Rig(autopilot)
    values = (
        {"FENCE_ENABLE": (1, "fence_enable"), "FENCE_ALT_MAX": (77.0, "fence_ceiling_m")}
        if autopilot is ARDUPILOT
        else {"GF_ACTION": (3, "fence_action"), "GF_MAX_HOR_DIST": (77.0, "fence_radius_m")}
    )
    for name, (value, field) in values.items():
        sent, kind = float(value), 9
        if isinstance(value, int):
            kind = 6
            if autopilot is PX4:
                sent = struct.unpack("<f", struct.pack("<i", value))[0]
        rig.tell(m.MAVLink_param_set_message(1, 1, name.encode(), sent, kind))
        assert getattr(rig.pilot.parameters, field) == value
    away = (78.0, 0.0, 10.0) if autopilot is PX4 else (0.0, 0.0, 78.0)
    assert rig.pilot.failsafe.outside(away) is not None


def test_a_moved_home_is_returned_to_and_measured_from():
    rig = Rig(PX4, fence_radius_m=60.0)
    rig.aloft()
    rig.goto(50, 0)
    rig.run(20.0)
    assert rig.command(179, 1.0) == 0
    assert rig.pilot.home_m == pytest.approx((50.0, 0.0, 20.0), abs=0.1)
    assert rig.pilot.failsafe.outside((100.0, 0.0, 10.0)) is None
    rig.goto(100, 0)
    rig.run(20.0)
    rig.pilot.set_mode(Mode.RTL)
    rig.run(100.0)
    assert rig.place == pytest.approx((50.0, 0.0, 0.0), abs=0.1)
    (message,) = rig.vehicle.built(m.MAVLINK_MSG_ID_HOME_POSITION)
    assert FRAME.from_wgs84(message.latitude / 1e7, message.longitude / 1e7) == pytest.approx(
        (50.0, 0.0), abs=0.1
    )


@BOTH
def test_a_low_battery_on_the_way_home_is_told_but_orders_nothing(autopilot):
    returns = 1 if autopilot is PX4 else 2
    rig = Rig(autopilot, low_battery_action=returns, low_voltage_v=0.0, critical_voltage_v=0.0)
    rig.aloft()
    rig.goto(150, 0)
    rig.run(15.0)
    rig.pilot.set_mode(Mode.RTL)
    rig.run(2.0)
    assert rig.pilot.state.phase is FlightPhase.RETURN
    plan = rig.pilot.executor.flight.plan
    rig.pilot.drain_battery(rig.pilot.parameters.low_fraction - 0.02)
    rig.run(1.0)
    told = [text for text in rig.texts if text.startswith("Battery low")]
    assert len(told) == 1
    assert told[0].endswith(" %)"), "it does not say that it returns: it is returning"
    assert not rig.pilot.failsafe.active
    assert rig.pilot.outcome is Outcome.RUNNING
    assert rig.pilot.executor.flight.plan is plan, "the way home goes on"
    on_order = Rig(autopilot, low_battery_action=returns, low_voltage_v=0.0, critical_voltage_v=0.0)
    on_order.aloft()
    on_order.pilot.drain_battery(on_order.pilot.parameters.low_fraction - 0.02)
    on_order.run(1.0)
    assert any(text.startswith("Battery low") and text.endswith(": returning") for text in on_order.texts)
