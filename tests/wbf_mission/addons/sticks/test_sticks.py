"""Flight by the sticks of a ground station, and its failsafe."""

import math
from dataclasses import fields

import pytest

from mission.link.codec.dialect import mavlink as m
from mission.outcome import Outcome
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.weather.wind import Wind
from tests.sim_vehicle.mavlink.test_answers import Peer, landed, push
from tests.wbf_mission.addons.modes.test_attitude import DRIFT, ZIGZAG, Copter
from tests.wbf_mission.addons.modes.test_setpoints import HERE


@pytest.mark.parametrize("mode", [1.0, 2.0, 3.0, 7.0], ids=["MANUAL", "ALTCTL", "POSCTL", "STABILIZED"])
def test_px4_wants_sticks_in_the_modes_that_they_fly(mode):
    peer = Peer("px4")
    assert peer.result(176, 1.0, mode) == 0
    assert peer.result(400, 1.0) == 1
    assert peer.texts()[0] == "Preflight Fail: No manual control input"
    peer.tell(sticks(z=0))
    assert peer.result(400, 1.0) == 0
    peer = Peer("px4")
    peer.fly()
    assert peer.result(176, 1.0, mode) == 1
    names = {1.0: "Manual", 2.0: "Altitude", 3.0: "Position", 7.0: "Stabilized"}
    assert peer.texts()[-1] == f"Switching to {names[mode]} is currently not available"
    assert peer.vehicle.pilot.mode is Mode.HOLD
    peer.tell(sticks())
    assert peer.result(176, 1.0, mode) == 0


def test_arducopter_waits_while_the_throttle_stick_is_up():
    peer = Peer("ardupilot")
    assert peer.result(176, 1.0, 2.0) == 0
    assert peer.result(400, 1.0) == 0
    push(peer, 15.0, sticks(z=400))
    assert peer.vehicle.pilot.armed
    push(peer, 9.0, sticks(z=0))
    assert peer.vehicle.pilot.armed
    push(peer, 2.0, sticks(z=0))
    assert not peer.vehicle.pilot.armed


@pytest.mark.parametrize("kind", ["quad", "fixed-wing", "rover"])
def test_ardupilot_does_not_arm_in_a_radio_failsafe(kind):
    peer = Peer("ardupilot", kind)
    peer.tell(sticks(z=0))
    peer.wait(3.0)
    assert peer.result(400, 1.0) == 4
    assert peer.texts()[-1] == "Arm: Radio failsafe on"
    peer.tell(sticks(z=0))
    assert peer.result(400, 1.0) == 0
    peer = Peer("ardupilot", kind)
    name = "THR_FAILSAFE" if kind == "fixed-wing" else "FS_THR_ENABLE"
    peer.vehicle.pilot.parameters.stored[name] = 0.0
    peer.tell(sticks(z=0))
    peer.wait(3.0)
    assert peer.result(400, 1.0) == 0


def sticks(x=0, y=0, z=500, r=0, target=1):
    return m.MAVLink_manual_control_message(target, x, y, z, r, 0)


def test_sticks_move_px4_in_its_position_mode():
    peer = Peer("px4")
    peer.fly()
    height = peer.vehicle.pilot.state.position_m[2]
    for _ in range(30):
        peer.tell(sticks(x=500))
        peer.wait(0.1)
    assert math.hypot(*peer.vehicle.pilot.state.velocity_m_s[:2]) < 0.1, "in another mode they do nothing"
    assert peer.result(176, 1.0, 3.0) == 0
    yaw = peer.vehicle.pilot.state.yaw_rad
    for _ in range(50):
        peer.tell(sticks(x=500))
        peer.wait(0.1)
    east, north, _ = peer.vehicle.pilot.state.velocity_m_s
    assert math.hypot(east, north) == pytest.approx(2.3, abs=0.1)
    assert math.atan2(east, north) == pytest.approx(math.remainder(yaw, 2.0 * math.pi), abs=0.05)
    peer.tell(sticks())
    peer.wait(5.0)
    assert math.hypot(*peer.vehicle.pilot.state.velocity_m_s[:2]) < 0.05
    assert peer.vehicle.pilot.state.position_m[2] == pytest.approx(height, abs=0.3)
    for _ in range(20):
        peer.tell(sticks(z=1000, r=500))
        peer.wait(0.1)
    assert peer.vehicle.pilot.state.position_m[2] > height + 2.0
    assert abs(math.remainder(peer.vehicle.pilot.state.yaw_rad - yaw, 2.0 * math.pi)) > 0.2


def test_sticks_for_others_and_on_the_ground_do_nothing():
    peer = Peer("px4")
    assert peer.result(176, 1.0, 3.0) == 0
    peer.tell(sticks(x=1000))
    assert peer.result(400, 1.0) == 0
    for _ in range(20):
        peer.tell(sticks(x=1000))
        peer.tell(sticks(z=1000, target=7))
        peer.wait(0.1)
    assert peer.vehicle.pilot.state.position_m[2] == 0.0
    for _ in range(30):
        peer.tell(sticks(z=1000))
        peer.wait(0.1)
    assert peer.vehicle.pilot.state.position_m[2] > 2.0, "the throttle takes off"


def flown_by_hand(autopilot, mode, kind="quad"):
    """A vehicle in the air (or armed on its wheels), in one of its modes."""
    peer = Peer(autopilot, kind)
    if kind == "quad":
        peer.fly()
    else:
        assert peer.result(400, 1.0) == 0
    if autopilot == "px4":
        peer.tell(sticks())
    assert peer.result(176, 1.0, mode) == 0
    if autopilot == "px4" or kind == "quad":
        push(peer, 3.0, sticks())
    else:
        peer.wait(3.0)
    return peer


def override(roll=0, pitch=0, throttle=0, yaw=0):
    return m.MAVLink_rc_channels_override_message(1, 1, roll, pitch, throttle, yaw, 0, 0, 0, 0)


def ground_speed(peer):
    return math.hypot(*peer.vehicle.pilot.state.velocity_m_s[:2])


def test_px4_holds_and_returns_when_sticks_that_fly_it_fall_silent():
    peer = flown_by_hand("px4", 3.0)
    push(peer, 2.0, sticks(x=500))
    peer.wait(1.0)
    assert peer.vehicle.pilot.mode is Mode.HOLD
    assert peer.texts()[-1] == "Failsafe activated: entering Hold for 5 seconds"
    push(peer, 1.0, sticks())
    assert peer.vehicle.pilot.mode is Mode.POSITION, "they are back"
    peer.wait(6.0)
    assert peer.vehicle.pilot.mode is Mode.RTL
    assert peer.texts()[-1] == "Failsafe activated"
    assert peer.vehicle.pilot.outcome is Outcome.LINK_LOST
    peer.tell(sticks(x=500))
    peer.wait(1.0)
    assert peer.vehicle.pilot.mode is Mode.RTL


def test_px4_returns_without_the_sticks_that_fly_it_even_if_it_is_to_do_nothing():
    peer = flown_by_hand("px4", 3.0)
    peer.vehicle.pilot.parameters.stored["NAV_RCL_ACT"] = 0.0
    push(peer, 2.0, sticks(x=500))
    peer.wait(7.0)
    assert peer.vehicle.pilot.mode is Mode.RTL


@pytest.mark.parametrize(("options", "mode"), [(0, Mode.LAND), (2, Mode.HOLD)])
def test_px4_acts_in_other_modes_unless_they_are_excepted(options, mode):
    peer = Peer("px4")
    peer.fly()
    peer.vehicle.pilot.parameters.stored["NAV_RCL_ACT"] = 3.0
    peer.vehicle.pilot.parameters.failsafe_options = options
    peer.tell(sticks())
    peer.wait(7.0)
    assert peer.vehicle.pilot.mode is mode


def test_sticks_that_were_gone_at_arming_are_not_missed():
    peer = Peer("px4")
    peer.tell(sticks())
    peer.wait(5.0)
    peer.fly()
    assert not [text for text in peer.texts() if "Failsafe" in text]


@pytest.mark.parametrize("mode", [5.0, 2.0, 16.0], ids=["LOITER", "ALT_HOLD", "POSHOLD"])
def test_sticks_move_arducopter(mode):
    peer = flown_by_hand("ardupilot", mode)
    pilot = peer.vehicle.pilot
    pilot.parameters.stored["LOIT_SPEED"] = 700.0
    height, yaw = pilot.state.position_m[2], pilot.state.yaw_rad
    push(peer, 5.0, sticks(x=500))
    full = 7.0 if mode == 5.0 else pilot.spec.top_speed_m_s
    assert ground_speed(peer) == pytest.approx(full * 0.46 / 0.96, rel=0.05)
    east, north, _ = pilot.state.velocity_m_s
    assert math.atan2(east, north) == pytest.approx(math.remainder(yaw, 2.0 * math.pi), abs=0.05)
    push(peer, 6.0, sticks())
    assert ground_speed(peer) < 0.1
    assert pilot.state.position_m[2] == pytest.approx(height, abs=0.3)
    push(peer, 3.0, sticks(z=1000))
    assert pilot.state.velocity_m_s[2] == pytest.approx(2.5, abs=0.1), "PILOT_SPEED_UP"
    push(peer, 3.0, sticks(z=560))
    assert abs(pilot.state.velocity_m_s[2]) < 0.1, "within THR_DZ"
    before = pilot.state.yaw_rad
    push(peer, 0.5, sticks(r=-300))
    assert math.remainder(pilot.state.yaw_rad - before, 2.0 * math.pi) < -0.1


@pytest.mark.parametrize("order", [(176, 1.0, 5.0), (176, 1.0, 2.0), (176, 1.0, 16.0), (17,)])
def test_arducopter_sinks_without_sticks_in_the_modes_that_they_fly(order):
    """SITL's receiver has the throttle down: PILOT_SPEED_UP, as PILOT_SPEED_DN is 0; then DISARM_DELAY."""
    peer = Peer("ardupilot")
    peer.fly()
    pilot = peer.vehicle.pilot
    pilot.parameters.stored["PILOT_SPEED_UP"] = 120.0
    east, north, height = pilot.state.position_m
    assert peer.result(*order) == 0
    peer.wait(4.0)
    assert pilot.state.velocity_m_s[2] == pytest.approx(-1.2, abs=0.05)
    assert pilot.state.position_m[:2] == pytest.approx((east, north), abs=0.5)
    peer.wait(height / 1.2)
    assert pilot.armed
    assert pilot.state.position_m[2] == pytest.approx(0.0, abs=0.05)
    peer.wait(15.0)
    assert not pilot.armed
    assert "Disarming motors" in peer.texts()


def test_arducopter_holds_in_brake_and_with_the_throttle_in_the_middle():
    peer = Peer("ardupilot")
    peer.fly()
    pilot = peer.vehicle.pilot
    height = pilot.state.position_m[2]
    assert peer.result(176, 1.0, 17.0) == 0
    peer.wait(10.0)
    assert pilot.state.position_m[2] == pytest.approx(height, abs=0.1)
    push(peer, 1.0, sticks())
    assert peer.result(176, 1.0, 5.0) == 0
    push(peer, 10.0, sticks())
    assert pilot.state.position_m[2] == pytest.approx(height, abs=0.2)


def test_a_failsafe_that_holds_arducopter_does_so_in_brake():
    peer = flown_by_hand("ardupilot", 5.0)
    pilot = peer.vehicle.pilot
    pilot.parameters.stored["FS_THR_ENABLE"] = 7.0
    push(peer, 1.0, sticks())
    peer.wait(10.0)
    assert peer.of("HEARTBEAT")[-1].custom_mode == 17
    assert pilot.state.velocity_m_s[2] == pytest.approx(0.0, abs=0.05)


def test_sticks_take_arducopter_off_and_land_it():
    peer = Peer("ardupilot")
    assert peer.result(176, 1.0, 5.0) == 0
    assert peer.result(400, 1.0) == 0
    pilot = peer.vehicle.pilot
    push(peer, 3.0, sticks(z=500))
    assert pilot.state.position_m[2] == 0.0
    push(peer, 8.0, sticks(z=1000))
    assert pilot.state.position_m[2] > 3.0
    push(peer, 60.0, sticks(z=0))
    assert pilot.state.position_m[2] == 0.0
    assert not pilot.armed


@pytest.mark.parametrize("mode", [4.0, 17.0], ids=["GUIDED", "BRAKE"])
def test_sticks_do_nothing_in_arducopters_guided_and_brake_modes(mode):
    peer = flown_by_hand("ardupilot", mode)
    before = peer.vehicle.pilot.state.position_m
    push(peer, 3.0, sticks(x=1000, z=1000))
    assert peer.vehicle.pilot.state.position_m == pytest.approx(before, abs=0.3)


def test_overridden_channels_are_sticks_to_arducopter_only():
    peer = flown_by_hand("ardupilot", 5.0)
    push(peer, 4.0, override(pitch=1250))
    assert ground_speed(peer) > 2.0
    push(peer, 1.0, override(pitch=65535, roll=1500))
    assert ground_speed(peer) > 2.0, "the pitch is kept"
    peer = Peer("px4")
    peer.fly()
    push(peer, 1.0, override(pitch=1250))
    assert peer.result(176, 1.0, 3.0) == 1, "PX4 hears none"


def test_arducopter_listens_to_its_own_ground_station_only():
    peer = flown_by_hand("ardupilot", 5.0)
    peer.vehicle.pilot.parameters.stored["MAV_GCS_SYSID"] = 7.0
    push(peer, 2.0, sticks(x=1000))
    assert ground_speed(peer) < 0.1


def test_arducopter_returns_when_its_sticks_fall_silent():
    peer = flown_by_hand("ardupilot", 5.0)
    push(peer, 2.0, override(throttle=1500))
    peer.wait(0.7)
    assert peer.vehicle.pilot.mode is Mode.HOLD
    peer.wait(0.5)
    assert peer.vehicle.pilot.mode is Mode.RTL
    assert peer.texts()[-1] == "Radio Failsafe"
    peer.tell(override(throttle=1500))
    peer.wait(0.1)
    assert peer.texts()[-1] == "Radio Failsafe Cleared"
    assert peer.vehicle.pilot.mode is Mode.RTL


def test_arducopter_goes_on_where_its_options_say_so():
    peer = Peer("ardupilot")
    peer.fly()
    peer.vehicle.pilot.parameters.failsafe_options = 4
    push(peer, 1.0, sticks())
    peer.wait(3.0)
    assert peer.vehicle.pilot.mode is Mode.GUIDED
    assert peer.texts()[-1] == "Radio Failsafe - Continuing Guided Mode"


def test_without_the_failsafe_the_last_sticks_hold_for_the_time_of_an_override():
    peer = flown_by_hand("ardupilot", 5.0)
    peer.vehicle.pilot.parameters.stored["FS_THR_ENABLE"] = 0.0
    push(peer, 3.0, sticks(x=500))
    peer.wait(2.5)
    assert ground_speed(peer) > 2.0
    peer.wait(6.0)
    assert ground_speed(peer) < 0.1
    assert peer.vehicle.pilot.mode is Mode.HOLD


def test_arducopter_disarms_on_the_ground_when_its_sticks_fall_silent():
    peer = Peer("ardupilot")
    assert peer.result(400, 1.0) == 0
    push(peer, 1.0, sticks(z=0))
    peer.wait(2.0)
    assert not peer.vehicle.pilot.armed
    assert "Radio Failsafe - Disarming" in peer.texts()


def test_a_rover_is_driven_by_hand():
    peer = flown_by_hand("ardupilot", 0.0, "rover")
    yaw = peer.vehicle.pilot.state.yaw_rad
    push(peer, 4.0, sticks(z=500))
    assert 0.3 < ground_speed(peer) <= 0.55 * peer.vehicle.pilot.spec.top_speed_m_s
    push(peer, 2.0, sticks(z=500, y=500))
    turned = math.remainder(peer.vehicle.pilot.state.yaw_rad - yaw, 2.0 * math.pi)
    assert turned > 0.2, "to the right"
    peer.wait(6.0)
    assert ground_speed(peer) < 0.05
    assert peer.vehicle.pilot.mode is Mode.HOLD
    assert "Radio Failsafe" in peer.texts()


@pytest.mark.parametrize(
    ("autopilot", "kind"),
    [(autopilot, kind) for autopilot in ("px4", "ardupilot") for kind in ("quad", "rover", "fixed-wing")],
)
def test_the_parameters_of_the_sticks_are_the_firmwares_own(autopilot, kind):
    vehicle = Peer(autopilot, kind).vehicle
    firmware = vehicle.firmware
    table = {p.name: p for p in firmware.parameters(vehicle.pilot.spec, 1)}
    rules = firmware.sticks
    loss = rules.loss
    named = [*rules.speeds.values(), rules.turn_rate, rules.climb, rules.descent]
    named += [loss.timeout, loss.action, loss.release, loss.delay, loss.arming]
    if firmware.rules.idle is not None:
        named.append(firmware.rules.idle.delay)
    if rules.tilt is not None:
        named += [getattr(rules.tilt, f.name) for f in fields(rules.tilt) if f.type == "Setting"]
    for wing in rules.wings.values():
        named += [wing.bank, wing.up, wing.down]
    for setting in filter(None, named):
        assert setting.default in (0.0, table[setting.name].value), setting.name


def lean(mode, seconds, message, wind=None, **stored):
    """Fly a PX4 multirotor by hand in a mode that leans it."""
    peer = Peer("px4", wind=wind)
    peer.vehicle.pilot.parameters.stored.update(stored)
    peer.fly()
    peer.tell(sticks())
    assert peer.result(176, 1.0, mode) == 0
    push(peer, seconds, message)
    return peer


def test_px4_leans_with_the_sticks_and_holds_its_height_in_altitude_control():
    peer = lean(2.0, 12.0, sticks(x=500))
    pilot = peer.vehicle.pilot
    height = pilot.state.position_m[2]
    # Drag over mass is 1/s: the speed at which it balances half of g tan(MPC_MAN_TILT_MAX).
    assert ground_speed(peer) == pytest.approx(0.5 * 9.81 * math.tan(math.radians(35.0)), rel=0.03)
    push(peer, 4.0, sticks(x=500))
    assert pilot.state.position_m[2] == pytest.approx(height, abs=0.3)
    push(peer, 10.0, sticks())
    assert ground_speed(peer) < 0.1, "in calm air drag stops it"
    push(peer, 4.0, sticks(z=1000))
    assert pilot.state.velocity_m_s[2] == pytest.approx(pilot.spec.climb_speed_m_s, abs=0.1)
    pilot.parameters.settings.update(MPC_Z_VEL_MAX_UP=1.0, MPC_Z_VEL_MAX_DN=0.5)
    push(peer, 4.0, sticks(z=1000))
    assert pilot.state.velocity_m_s[2] == pytest.approx(1.0, abs=0.1)
    push(peer, 4.0, sticks(z=0))
    assert pilot.state.velocity_m_s[2] == pytest.approx(-0.5, abs=0.1)
    peer = lean(2.0, 12.0, sticks(x=1000), MPC_MAN_TILT_MAX=10.0)
    assert ground_speed(peer) == pytest.approx(9.81 * math.tan(math.radians(10.0)), rel=0.05)


@pytest.mark.parametrize(("mode", "drifts"), [(2.0, True), (3.0, False)], ids=["ALTCTL", "POSCTL"])
def test_px4_drifts_with_the_wind_where_no_position_is_held(mode, drifts):
    peer = lean(mode, 12.0, sticks(), wind=Wind(4.0, 0.0))
    east, north, _ = peer.vehicle.pilot.state.velocity_m_s
    wind_m_s = peer.vehicle.pilot.state.wind_m_s[0]
    assert wind_m_s > 2.0
    assert east == pytest.approx(wind_m_s if drifts else 0.0, abs=0.3)
    assert abs(north) < 0.3


@pytest.mark.parametrize("mode", [1.0, 7.0], ids=["MANUAL", "STABILIZED"])
def test_px4s_throttle_is_thrust_without_height_control(mode):
    peer = lean(mode, 2.0, sticks())
    pilot = peer.vehicle.pilot
    assert abs(pilot.state.velocity_m_s[2]) < 0.3, "MPC_THR_HOVER in the middle"
    push(peer, 4.0, sticks(x=1000))
    assert ground_speed(peer) > 2.0
    assert pilot.state.velocity_m_s[2] < -0.5, "it sinks as it leans"
    peer = lean(mode, 2.0, sticks(z=800))
    assert peer.vehicle.pilot.state.velocity_m_s[2] > 1.0
    before = peer.vehicle.pilot.state.position_m[2]
    push(peer, 3.0, sticks(z=200))
    assert peer.vehicle.pilot.state.velocity_m_s[2] < -1.0
    assert peer.vehicle.pilot.state.position_m[2] < before + 3.0


def test_px4_keeps_its_lean_in_acro():
    peer = lean(5.0, 0.3, sticks(x=500))
    assert peer.of("HEARTBEAT")[-1].custom_mode == 5 << 16
    push(peer, 5.0, sticks())
    speed = ground_speed(peer)
    assert speed > 1.0
    peer = lean(7.0, 0.3, sticks(x=500))
    push(peer, 5.0, sticks())
    assert ground_speed(peer) < 0.3 * speed, "STABILIZED levels itself"


def test_px4_takes_off_by_sticks_in_altitude_control():
    peer = Peer("px4")
    assert peer.result(176, 1.0, 2.0) == 0
    peer.tell(sticks(z=0))
    assert peer.result(400, 1.0) == 0
    push(peer, 3.0, sticks(z=600))
    assert peer.vehicle.pilot.state.position_m[2] == 0.0, "not before 65 % of the stick"
    push(peer, 5.0, sticks(z=900))
    assert peer.vehicle.pilot.state.position_m[2] > 3.0


def test_px4_returns_when_sticks_that_lean_it_fall_silent():
    peer = lean(2.0, 3.0, sticks(x=500))
    peer.wait(1.0)
    assert peer.vehicle.pilot.mode is Mode.HOLD
    peer.wait(6.0)
    assert peer.vehicle.pilot.mode is Mode.RTL


def test_a_rover_is_driven_by_hand_under_px4():
    peer = Peer("px4", "rover")
    assert peer.result(176, 1.0, 1.0) == 0
    assert peer.result(400, 1.0) == 1
    peer.tell(sticks())
    assert peer.result(400, 1.0) == 0
    push(peer, 2.0, sticks())
    assert ground_speed(peer) == 0.0, "the middle of the throttle is no speed"
    yaw = peer.vehicle.pilot.state.yaw_rad
    push(peer, 4.0, sticks(z=800))
    assert ground_speed(peer) > 0.3
    push(peer, 2.0, sticks(z=800, y=500))
    assert math.remainder(peer.vehicle.pilot.state.yaw_rad - yaw, 2.0 * math.pi) > 0.1, "to the right"
    assert peer.result(176, 1.0, 2.0) == 1, "a rover has no altitude control"
    assert peer.texts()[-1] == "Switching to Altitude is currently not available"
    peer.wait(1.0)
    assert peer.vehicle.pilot.mode is Mode.HOLD
    peer.wait(6.0)
    assert peer.vehicle.pilot.mode is Mode.RTL


@pytest.mark.parametrize("order", [m.MAV_CMD_NAV_LAND, m.MAV_CMD_NAV_RETURN_TO_LAUNCH])
def test_px4_goes_back_to_the_mode_before_its_way_down_when_it_is_disarmed(order):
    """``UserModeIntention.cpp``: to the last mode that was asked for and does not prevent arming."""
    peer = flown_by_hand("px4", 3.0)
    assert peer.result(order) == 0
    push(peer, 1.0, sticks())
    down = peer.vehicle.pilot.mode
    assert down in (Mode.LAND, Mode.RTL)
    push(peer, 60.0, sticks())
    assert landed(peer) == 3 << 16


def test_drift_turns_with_the_stick_to_the_right_and_zigzag_flies_by_sticks():
    rig = Copter().guided(HERE)
    assert rig.mode(DRIFT) == 0
    rig.run(1.0, stream=rig.sticks())
    start = rig.yaw
    rig.run(1.0, stream=rig.sticks(right=400))
    assert 10.0 < (rig.yaw - start) % 360.0 < 180.0
    assert rig.number == DRIFT
    assert rig.mode(ZIGZAG) == 0
    start = rig.yaw
    rig.run(3.0, stream=rig.sticks(forward=500))
    assert math.hypot(*rig.velocity[:2]) > 1.0
    assert rig.yaw == pytest.approx(start, abs=40.0)
    assert rig.number == ZIGZAG
