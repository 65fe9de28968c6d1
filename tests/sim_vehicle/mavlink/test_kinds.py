"""Fixed wings and rovers over MAVLink: type, modes, telemetry, parameters, refusals."""

import math
import struct

import pytest
from mission_items import item

from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem
from mission.outcome import Outcome
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.autopilot.px4.firmware import px4_takeoff_and_landing
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from sim_vehicle.pilot.controls import MissionState, RefusedError
from tests.support.peer import Peer

POINT = GeoPoint(28.05, -82.15, 12.0)
BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])


def land_start(autopilot):
    return MissionItem(189, 2) if autopilot is PX4 else item(189, 0.0, -350.0, 30.0)


def flight(name, items, autopilot, limit_s=3000.0):
    """Fly a mission as a ground station does it; return vehicle, ground station and all messages."""
    vehicle = SimVehicle(get_vehicle(name), POINT, autopilot=autopilot)
    # PX4 flies no mission of a fixed wing that does not land, unless it is told to.
    vehicle.pilot.parameters.mission_requirement = 0
    ground = GroundStation(Mission(items, POINT), force=True)
    heard = []
    codec = m.MAVLink(None)

    def tap(frame, now_s):
        message = codec.parse_char(frame)
        if message is not None and message.get_srcSystem() == 1:
            heard.append((now_s, message))

    simulation = Simulation([vehicle, ground], tap=tap)
    simulation.run(lambda _now: ground.done, limit_s=limit_s)
    return vehicle, ground, heard


def of(heard, kind):
    return [message for _, message in heard if message.get_type() == kind]


@BOTH
def test_a_fixed_wing_flies_a_mission_and_tells_what_it_does(autopilot):
    items = (
        item(22, 0.0, 150.0, 40.0, 10.0),
        item(16, 0.0, 600.0, 50.0),
        # PX4 takes no circles by number.
        item(19, 400.0, 600.0, 50.0, 60.0, 0.0, 80.0)
        if autopilot is PX4
        else item(18, 400.0, 600.0, 50.0, 2.0, 0.0, 80.0),
        land_start(autopilot),
        item(31, 80.0, -380.0, 30.0, 1.0, 80.0),
        item(21, 0.0, 0.0),
    )
    vehicle, ground, heard = flight("fixed-wing", items, autopilot)
    assert ground.outcome is Outcome.COMPLETED, ground.reason
    assert vehicle.outcome in (Outcome.COMPLETED, Outcome.RUNNING)
    beats = of(heard, "HEARTBEAT")
    assert {beat.type for beat in beats} == {m.MAV_TYPE_FIXED_WING}
    mission_mode = 4 << 24 | 4 << 16 if autopilot is PX4 else 10
    assert any(beat.custom_mode == mission_mode for beat in beats)
    huds = of(heard, "VFR_HUD")
    cruise = vehicle.pilot.spec.cruise_speed_m_s
    flying = [hud for hud in huds if hud.alt > 45.0]
    assert sum(hud.airspeed for hud in flying) / len(flying) == pytest.approx(cruise, rel=0.1)
    assert max(hud.throttle for hud in huds) >= 90
    assert max(hud.climb for hud in huds) > 3.0
    rolls = [math.degrees(message.roll) for message in of(heard, "ATTITUDE")]
    banked = math.degrees(math.atan(cruise**2 / (80.0 * 9.80665)))
    assert sum(abs(roll - banked) < 2.0 for roll in rolls) > 20
    assert max(math.degrees(message.pitch) for message in of(heard, "ATTITUDE")) > 8.0
    states = {message.landed_state for message in of(heard, "EXTENDED_SYS_STATE")}
    assert {1, 2, 3, 4} <= states


@BOTH
def test_a_fixed_wing_without_a_take_off_does_not_arm(autopilot):
    _, ground, _ = flight("fixed-wing", (item(16, 0.0, 600.0, 50.0), MissionItem(20, 2)), autopilot)
    assert ground.outcome in (Outcome.MISSION_REJECTED, Outcome.ARMING_REFUSED)
    assert "no take-off before it" in ground.reason


def plane(autopilot=ARDUPILOT):
    return Peer(autopilot, "fixed-wing", home=POINT)


TAKEOFF = item(22, 0.0, 150.0, 40.0, 10.0)
RETURNS = (TAKEOFF, item(16, 0.0, 600.0, 50.0), MissionItem(20, 2))
LANDS = (TAKEOFF, item(16, 0.0, 600.0, 50.0), item(16, 0.0, -600.0, 30.0), item(21, 0.0, 0.0))


def test_px4_refuses_a_fixed_wings_mission_without_a_landing_unless_told():
    peer = plane(PX4)
    pilot = peer.vehicle.pilot
    assert peer.upload(RETURNS).type == 0, "it is stored all the same"
    assert "Mission rejected: Landing waypoint/pattern required." in "".join(peer.texts())
    assert pilot.mission.state is MissionState.NO_MISSION
    pilot.set_mode(Mode.MISSION)
    with pytest.raises(RefusedError, match="Landing waypoint"):
        pilot.arm()
    peer.upload(LANDS)
    assert pilot.mission.state is MissionState.NOT_STARTED
    peer.upload(RETURNS)
    packed = struct.unpack("<f", struct.pack("<i", 0))[0]
    peer.tell(m.MAVLink_param_set_message(1, 1, b"MIS_TKO_LAND_REQ", packed, 6))
    assert pilot.mission.state is MissionState.NOT_STARTED


@pytest.mark.parametrize(
    ("rule", "items", "reason"),
    [
        (1, RETURNS[1:], "Takeoff waypoint required."),
        (3, RETURNS, "Landing waypoint/pattern required."),
        (4, RETURNS, "Add Landing item or remove Takeoff."),
        (5, LANDS[1:], "Add Takeoff item or remove Landing."),
        (0, RETURNS, None),
        (4, LANDS, None),
        (3, LANDS, None),
    ],
)
def test_what_px4_wants_of_a_mission(rule, items, reason):
    parameters = SimVehicle(get_vehicle("quad"), POINT, autopilot=PX4).pilot.parameters
    assert parameters.mission_requirement == 0, "a multirotor's default"
    parameters.mission_requirement = rule
    assert px4_takeoff_and_landing(items, parameters) == reason


def test_arduplane_does_not_arm_with_a_landing_that_a_return_would_not_fly():
    peer = plane()
    taken = peer.upload((TAKEOFF, LANDS[1], MissionItem(189, 2), *LANDS[2:])).type
    assert taken == 0, "DO_LAND_START in frame 2 is taken"
    peer.tell(m.MAVLink_param_set_message(1, 1, b"RTL_AUTOLAND", 0.0, 9))
    with pytest.raises(RefusedError, match="DO_LAND_START set and RTL_AUTOLAND disabled"):
        peer.vehicle.pilot.arm()
    peer.tell(m.MAVLink_param_set_message(1, 1, b"RTL_AUTOLAND", 1.0, 9))
    peer.vehicle.pilot.arm()
    assert peer.vehicle.pilot.armed


def test_the_time_constant_of_plane_parm_is_taken():
    peer = plane()
    peer.tell(m.MAVLink_param_set_message(1, 1, b"RLL2SRV_TCONST", 0.25, 9))
    assert peer.of("PARAM_VALUE")[-1].param_value == 0.25
    assert dict(peer.vehicle.pilot.spec.parameters)["RLL2SRV_TCONST"] == 0.25


@BOTH
def test_a_rover_drives_a_mission(autopilot):
    items = (item(22, 0.0, 0.0, 10.0), item(16, 0.0, 30.0), item(16, 30.0, 30.0, 50.0), MissionItem(20, 2))
    vehicle, ground, heard = flight("rover", items, autopilot)
    assert ground.outcome is Outcome.COMPLETED, ground.reason
    assert {beat.type for beat in of(heard, "HEARTBEAT")} == {m.MAV_TYPE_GROUND_ROVER}
    assert any("Take-off items have no effect" in text for _, _, text in ground.texts)
    assert {message.relative_alt for message in of(heard, "GLOBAL_POSITION_INT")} == {0}
    assert max(hud.groundspeed for hud in of(heard, "VFR_HUD")) == pytest.approx(1.5, abs=0.1)
    assert ground.flight_time_s > 60.0
    assert vehicle.pilot.state.position_m[2] == 0.0


@pytest.mark.parametrize(
    ("name", "table", "banner", "own"),
    [
        ("fixed-wing", "apm", "ArduPlane V4.7.0", {"AIRSPEED_CRUISE", "NAVL1_PERIOD", "RTL_ALTITUDE"}),
        ("rover", "rover", "ArduRover V4.7.0", {"WP_SPEED", "TURN_RADIUS"}),
    ],
)
def test_modes_and_parameters_are_those_of_the_autopilot(name, table, banner, own):
    from pymavlink import mavutil

    numbers = {text: number for number, text in getattr(mavutil, f"mode_mapping_{table}").items()}
    peer = Peer(ARDUPILOT, name)
    modes = peer.vehicle.firmware.mavlink.modes
    hold = "LOITER" if name == "fixed-wing" else "HOLD"
    for mode, text in ((Mode.MISSION, "AUTO"), (Mode.RTL, "RTL"), (Mode.GUIDED, "GUIDED"), (Mode.HOLD, hold)):
        assert modes[mode] == numbers[text]
        assert modes.mode_of(numbers[text]) is mode
    peer.tell(m.MAVLink_param_request_list_message(1, 1))
    peer.wait(2.0)
    assert f"{banner} (1511f271)" in peer.texts()
    names = {message.param_id for message in peer.of("PARAM_VALUE")}
    assert own <= names
    assert not any(text.startswith(("WPNAV_", "MPC_")) or text == "RTL_ALT" for text in names)


@BOTH
def test_a_rover_that_rolls_out_without_power_still_tells_its_throttle(autopilot):
    peer = Peer(autopilot, "rover", home=POINT)
    pilot = peer.vehicle.pilot
    pilot.load([item(16, 100.0, 0.0)])
    pilot.arm()
    pilot.set_mode(Mode.MISSION)
    told = []
    for tenth in range(400):
        if tenth == 150:
            pilot.drain_battery(0.0)
        peer.wait(0.1)
        told.append(peer.asked(m.MAVLINK_MSG_ID_VFR_HUD).throttle)
    assert max(told) > 10
    assert all(0 <= throttle <= 100 for throttle in told)


def airborne(autopilot=ARDUPILOT):
    """Return a fixed wing in the air by a mission."""
    peer = plane(autopilot)
    pilot = peer.vehicle.pilot
    pilot.parameters.mission_requirement = 0
    pilot.load([item(22, 0.0, 200.0, 60.0), item(16, 0.0, 900.0, 60.0), item(16, 0.0, 2500.0, 60.0)])
    pilot.arm()
    pilot.start_mission()
    fly_on(peer, lambda: height(peer) >= 55.0, 120.0)
    return peer


def push(peer, seconds, *, pitch=0, roll=0):
    """Hold the sticks for a time; return how far the course turned meanwhile."""
    before = course(peer)
    for _ in range(round(10 * seconds)):
        peer.tell(m.MAVLink_manual_control_message(1, pitch, roll, 500, 0, 0))
        peer.wait(0.1)
    return math.remainder(course(peer) - before, 2.0 * math.pi)


def course(peer):
    return math.atan2(*peer.vehicle.pilot.state.velocity_m_s[:2])


def height(peer):
    return peer.vehicle.pilot.state.position_m[2]


def fly_on(peer, until, limit_s=400.0):
    """Fly until something is so."""
    end_s = peer.now_s + limit_s
    while not until():
        peer.wait(0.1)
        assert peer.now_s < end_s


def test_a_fixed_wing_banks_climbs_and_flies_straight_by_sticks():
    peer = airborne()
    assert peer.result(176, 1.0, 5.0) == 0
    assert peer.vehicle.pilot.mode is Mode.MANUAL
    before = height(peer)
    assert 0.15 < push(peer, 4.0, roll=500) < 2.5, "to the right"
    push(peer, 6.0)
    assert push(peer, 4.0) == pytest.approx(0.0, abs=0.1)
    assert height(peer) == pytest.approx(before, abs=15.0)
    before = height(peer)
    push(peer, 8.0, pitch=-600)
    assert height(peer) > before + 5.0, "pulled"
    assert -2.5 < push(peer, 4.0, roll=-500) < -0.15, "to the left"


def test_a_fixed_wing_circles_and_returns_when_its_sticks_fall_silent():
    peer = airborne()
    peer.result(176, 1.0, 5.0)
    push(peer, 2.0)
    peer.wait(2.0)
    assert peer.vehicle.pilot.mode is Mode.HOLD
    assert peer.texts()[-1] == "RC Short Failsafe: switched to CIRCLE"
    peer.wait(5.0)
    assert peer.vehicle.pilot.mode is Mode.RTL
    assert peer.texts()[-1] == "RC Long Failsafe: switched to RTL"


def test_a_rover_turns_on_between_two_stick_messages():
    rover = Peer("ardupilot", "rover")
    rover.vehicle.pilot.set_mode(Mode.MANUAL)
    rover.vehicle.pilot.arm(force=True)
    rover.tell(m.MAVLink_manual_control_message(1, 0, 500, 1000, 0, 0))
    rover.wait(1.2)
    assert 30.0 < math.degrees(rover.vehicle.pilot.state.yaw_rad) < 40.0


def test_sticks_in_a_mission_do_not_move_a_fixed_wing():
    peer = airborne()
    assert push(peer, 4.0, roll=1000) == pytest.approx(0.0, abs=0.15)
    peer.wait(10.0)
    assert peer.vehicle.pilot.mode is Mode.MISSION, "FS_LONG_ACTN 0 goes on"


@pytest.mark.parametrize("main_mode", [2.0, 3.0, 7.0], ids=["ALTCTL", "POSCTL", "STABILIZED"])
def test_px4_banks_and_climbs_a_fixed_wing_by_sticks(main_mode):
    peer = airborne(PX4)
    pilot = peer.vehicle.pilot
    peer.result(176, 1.0, main_mode)
    assert pilot.mode is Mode.MISSION, "not without sticks"
    push(peer, 0.1)
    peer.result(176, 1.0, main_mode)
    assert pilot.mode in (Mode.ALTITUDE, Mode.POSITION, Mode.MANUAL)
    assert 0.15 < push(peer, 4.0, roll=500) < 2.8, "to the right"
    before = height(peer)
    push(peer, 8.0, pitch=-800)
    assert height(peer) > before + 5.0, "pulled"
    peer.wait(2.0)
    assert pilot.mode is Mode.HOLD


GO_AROUND = 191


def landing_plane():
    """Return an ArduPlane that lands, 20 m above the ground."""
    peer = plane()
    items = item(22, 0.0, 150.0, 40.0, 10.0), item(16, 0.0, -700.0, 40.0), item(21, 0.0, 0.0)
    assert peer.upload(items).type == m.MAV_MISSION_ACCEPTED
    pilot = peer.vehicle.pilot
    pilot.arm(force=True)
    pilot.start_mission()
    fly_on(peer, lambda: pilot.executor.mission.lands and height(peer) < 20.0)
    return peer, pilot.executor.mission


def test_arduplane_goes_around_by_command():
    peer, mission = landing_plane()
    # 0 is the height of the landing or the take-off.
    for asked_m, height_m, within_m in ((55.0, 55, 1.0), (0.0, 40, 3.0)):
        assert peer.result(GO_AROUND, asked_m) == m.MAV_RESULT_ACCEPTED
        fly_on(peer, lambda: not mission.goes_around)
        assert height(peer) == pytest.approx(height_m, abs=within_m)
        assert f"Landing aborted, climbing to {height_m}m" in peer.texts()
        fly_on(peer, lambda: mission.lands)
        assert peer.texts().count("Restarted landing sequence at waypoint 2") > 0


@pytest.mark.parametrize(
    ("name", "autopilot", "result"),
    [
        ("fixed-wing", ARDUPILOT, m.MAV_RESULT_FAILED),
        ("quad", ARDUPILOT, m.MAV_RESULT_UNSUPPORTED),
        ("fixed-wing", PX4, m.MAV_RESULT_UNSUPPORTED),
    ],
)
def test_only_arduplane_on_its_landing_goes_around(name, autopilot, result):
    assert Peer(autopilot, name).result(GO_AROUND) == result


@pytest.mark.parametrize(
    ("enabled", "throttle", "breaks_off"), [(1, 960, True), (1, 850, False), (0, 960, False)]
)
def test_full_throttle_breaks_off_a_landing_if_that_is_enabled(enabled, throttle, breaks_off):
    peer, mission = landing_plane()
    peer.vehicle.pilot.parameters.stored["LAND_ABORT_THR"] = float(enabled)
    peer.tell(m.MAVLink_manual_control_message(1, 0, 0, throttle, 0, 0))
    assert mission.goes_around is breaks_off
    fly_on(peer, lambda: not mission.goes_around)
    assert ("Landing aborted via throttle" in peer.texts()) is breaks_off
