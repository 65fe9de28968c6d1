"""Fixed wings and rovers over MAVLink: type, modes, telemetry, parameters, refusals."""

import math
import struct

import pytest

from geo.frame import LocalFrame
from mission.ground.station import GroundStation
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.model import GeoPoint, Mission, MissionItem
from mission.outcome import Outcome
from mission.transfer import wire
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
HOME = LocalFrame(28.05, -82.15)
BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])


def item(command, x, y, z=0.0, *params):
    latitude, longitude = HOME.to_wgs84(x, y)
    return MissionItem(command, 3, *params, *[0.0] * (4 - len(params)), latitude, longitude, z)


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
def test_a_mission_that_only_returns_ends_over_home_or_on_the_ground(autopilot):
    items = (item(22, 0.0, 150.0, 40.0, 10.0), item(16, 0.0, 600.0, 50.0), MissionItem(20, 2))
    vehicle, ground, _ = flight("fixed-wing", items, autopilot)
    assert ground.outcome is Outcome.COMPLETED, ground.reason
    # The file of the vehicle makes PX4 land; ArduPlane circles.
    assert (vehicle.pilot.state.position_m[2] == 0.0) is (autopilot is PX4)


@BOTH
def test_a_fixed_wing_without_a_take_off_does_not_arm(autopilot):
    _, ground, _ = flight("fixed-wing", (item(16, 0.0, 600.0, 50.0), MissionItem(20, 2)), autopilot)
    assert ground.outcome in (Outcome.MISSION_REJECTED, Outcome.ARMING_REFUSED)
    assert "no take-off before it" in ground.reason


def uploaded(vehicle, items):
    """Send a mission and return the result of the transfer."""
    if vehicle.firmware.title == "ArduPlane":
        items = (MissionItem.waypoint(POINT.latitude_deg, POINT.longitude_deg, 12.0), *items)
    sent = [m.MAVLink_mission_count_message(1, 1, len(items), 0)]
    sent += [wire.item_to_message(one, seq, 0, (1, 1)) for seq, one in enumerate(items)]
    answers = []
    for message in sent:
        (crossed,) = FrameReader().feed(FrameWriter(255, 190).encode(message))
        answers += vehicle.receive(crossed, 0.0)
    results = [message.type for message in answers if message.get_type() == "MISSION_ACK"]
    return results, [message.text for message in answers if message.get_type() == "STATUSTEXT"]


TAKEOFF = item(22, 0.0, 150.0, 40.0, 10.0)
RETURNS = (TAKEOFF, item(16, 0.0, 600.0, 50.0), MissionItem(20, 2))
LANDS = (TAKEOFF, item(16, 0.0, 600.0, 50.0), item(16, 0.0, -600.0, 30.0), item(21, 0.0, 0.0))


def test_px4_refuses_a_fixed_wings_mission_without_a_landing_unless_told():
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=PX4)
    results, texts = uploaded(vehicle, RETURNS)
    assert results == [0]  # it is stored all the same
    assert "Mission rejected: Landing waypoint/pattern required." in "".join(texts)
    assert vehicle.pilot.mission.state is MissionState.NO_MISSION
    vehicle.pilot.set_mode(Mode.MISSION)
    with pytest.raises(RefusedError, match="Landing waypoint"):
        vehicle.pilot.arm()
    uploaded(vehicle, LANDS)
    assert vehicle.pilot.mission.state is MissionState.NOT_STARTED
    uploaded(vehicle, RETURNS)
    packed = struct.unpack("<f", struct.pack("<i", 0))[0]
    vehicle.receive(m.MAVLink_param_set_message(1, 1, b"MIS_TKO_LAND_REQ", packed, 6), 0.0)
    assert vehicle.pilot.mission.state is MissionState.NOT_STARTED


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
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=ARDUPILOT)
    results, _ = uploaded(vehicle, (TAKEOFF, LANDS[1], MissionItem(189, 2), *LANDS[2:]))
    assert results[-1] == 0, "DO_LAND_START in frame 2 is taken"
    vehicle.receive(m.MAVLink_param_set_message(1, 1, b"RTL_AUTOLAND", 0.0, 9), 0.0)
    with pytest.raises(RefusedError, match="DO_LAND_START set and RTL_AUTOLAND disabled"):
        vehicle.pilot.arm()
    vehicle.receive(m.MAVLink_param_set_message(1, 1, b"RTL_AUTOLAND", 1.0, 9), 0.0)
    vehicle.pilot.arm()
    assert vehicle.pilot.armed


def test_the_time_constant_of_plane_parm_is_taken():
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=ARDUPILOT)
    answers = vehicle.receive(m.MAVLink_param_set_message(1, 1, b"RLL2SRV_TCONST", 0.25, 9), 0.0)
    assert [a.param_value for a in answers if a.get_type() == "PARAM_VALUE"] == [0.25]
    assert dict(vehicle.pilot.spec.parameters)["RLL2SRV_TCONST"] == 0.25


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
    ("name", "table", "banner"),
    [("fixed-wing", "apm", "ArduPlane V4.7.0 (1511f271)"), ("rover", "rover", "ArduRover V4.7.0 (1511f271)")],
)
def test_modes_and_parameters_are_those_of_the_autopilot(name, table, banner):
    from pymavlink import mavutil

    numbers = {text: number for number, text in getattr(mavutil, f"mode_mapping_{table}").items()}
    vehicle = SimVehicle(get_vehicle(name), POINT, autopilot=ARDUPILOT)
    modes = vehicle.firmware.mavlink.modes
    hold = "LOITER" if name == "fixed-wing" else "HOLD"
    for mode, text in ((Mode.MISSION, "AUTO"), (Mode.RTL, "RTL"), (Mode.GUIDED, "GUIDED"), (Mode.HOLD, hold)):
        assert modes[mode] == numbers[text]
        assert vehicle.firmware.mavlink.modes.mode_of(numbers[text]) is mode
    ask = m.MAVLink_param_request_list_message(1, 1)
    ask._header.srcSystem = 255
    answers = vehicle.receive(ask, 0.0)
    for tick in range(1, 100):
        answers += vehicle.poll(0.02 * tick)
    texts = [message.text for message in answers if message.get_type() == "STATUSTEXT"]
    assert banner.encode() in [bytes(text) if isinstance(text, bytes) else text.encode() for text in texts]
    names = {
        message.param_id if isinstance(message.param_id, str) else message.param_id.decode()
        for message in answers
        if message.get_type() == "PARAM_VALUE"
    }
    names = {text.rstrip("\0") for text in names}
    wanted = {
        "fixed-wing": {"AIRSPEED_CRUISE", "NAVL1_PERIOD", "RTL_ALTITUDE"},
        "rover": {"WP_SPEED", "TURN_RADIUS"},
    }
    assert wanted[name] <= names
    assert not any(text.startswith(("WPNAV_", "MPC_")) or text == "RTL_ALT" for text in names)


def test_px4_tells_its_kind_by_a_parameter_and_has_its_own_modes():
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=PX4)
    rows = PX4.for_vehicle("multirotor").mavlink.modes.rows
    own = tuple(row for row in rows if row[1] is not Mode.FOLLOW)
    assert vehicle.firmware.mavlink.modes.rows == own, "only multirotors follow"
    answers = vehicle.receive(m.MAVLink_param_request_read_message(1, 1, b"MAV_TYPE", -1), 0.0)
    assert answers[0].get_type() == "PARAM_VALUE"
    answers = vehicle.receive(m.MAVLink_param_request_read_message(1, 1, b"MPC_XY_CRUISE", -1), 0.0)
    assert not [message for message in answers if message.get_type() == "PARAM_VALUE"]


def test_a_parameter_set_in_flight_changes_the_circle():
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=PX4)
    pilot = vehicle.pilot
    pilot.takeoff(50.0)
    pilot.arm()
    vehicle.poll(60.0)
    pilot.set_mode(Mode.HOLD)
    message = m.MAVLink_param_set_message(1, 1, b"NAV_LOITER_RAD", 120.0, m.MAV_PARAM_TYPE_REAL32)
    vehicle.receive(message, 60.0)
    x, y, _ = pilot.executor.motion.stopping_point()
    pilot.set_mode(Mode.HOLD)
    vehicle.poll(160.0)
    east, north, _ = pilot.state.position_m
    assert math.hypot(east - x, north - y) == pytest.approx(120.0, rel=0.05)


@BOTH
def test_a_rover_that_rolls_out_without_power_still_tells_its_throttle(autopilot):
    vehicle = SimVehicle(get_vehicle("rover"), POINT, autopilot=autopilot)
    vehicle.pilot.load([item(16, 100.0, 0.0)])
    vehicle.pilot.arm()
    vehicle.pilot.set_mode(Mode.MISSION)
    writer = FrameWriter(1, 1)
    told = []
    for k in range(1, 400):
        if k == 150:
            vehicle.pilot.drain_battery(0.0)
        for message in vehicle.poll(k / 10.0):
            writer.encode(message)
        (hud,) = vehicle.built(m.MAVLINK_MSG_ID_VFR_HUD)
        writer.encode(hud)
        told.append(hud.throttle)
    assert max(told) > 10
    assert all(0 <= throttle <= 100 for throttle in told)


class Airborne:
    """A fixed wing in the air by a mission."""

    def __init__(self, autopilot=ARDUPILOT):
        items = [item(22, 0.0, 200.0, 60.0), item(16, 0.0, 900.0, 60.0), item(16, 0.0, 2500.0, 60.0)]
        self.vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=autopilot)
        self.pilot = pilot = self.vehicle.pilot
        pilot.parameters.mission_requirement = 0
        self.now_s = 0.0
        self.told = self.vehicle.poll(0.0)
        pilot.load(items)
        pilot.arm()
        pilot.start_mission()
        while pilot.state.position_m[2] < 55.0:
            self.wait(1.0)
            assert self.now_s < 120.0

    def wait(self, seconds, message=None):
        for _ in range(round(10 * seconds)):
            self.now_s += 0.1
            if message is not None:
                (crossed,) = FrameReader().feed(FrameWriter(255, 190).encode(message))
                self.told += self.vehicle.receive(crossed, self.now_s)
            self.told += self.vehicle.poll(self.now_s)

    def fbwa(self):
        change = m.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 5.0, 0, 0, 0, 0, 0)
        self.wait(0.1, change)
        assert self.pilot.mode is Mode.MANUAL

    @property
    def course(self):
        return math.atan2(*self.pilot.state.velocity_m_s[:2])

    @property
    def texts(self):
        told = [t.text for t in self.told if t.get_type() == "STATUSTEXT"]
        return [t if isinstance(t, str) else t.decode() for t in told]


def test_a_fixed_wing_banks_climbs_and_flies_straight_by_sticks():
    plane = Airborne()
    plane.fbwa()
    before, height = plane.course, plane.pilot.state.position_m[2]
    plane.wait(4.0, m.MAVLink_manual_control_message(1, 0, 500, 500, 0, 0))
    assert 0.15 < math.remainder(plane.course - before, 2.0 * math.pi) < 2.5, "to the right"
    plane.wait(6.0, m.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    straight = plane.course
    plane.wait(4.0, m.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    assert math.remainder(plane.course - straight, 2.0 * math.pi) == pytest.approx(0.0, abs=0.1)
    assert plane.pilot.state.position_m[2] == pytest.approx(height, abs=15.0)
    height = plane.pilot.state.position_m[2]
    plane.wait(8.0, m.MAVLink_manual_control_message(1, -600, 0, 500, 0, 0))
    assert plane.pilot.state.position_m[2] > height + 5.0, "pulled"
    before = plane.course
    plane.wait(4.0, m.MAVLink_manual_control_message(1, 0, -500, 500, 0, 0))
    assert -2.5 < math.remainder(plane.course - before, 2.0 * math.pi) < -0.15, "to the left"


def test_a_fixed_wing_circles_and_returns_when_its_sticks_fall_silent():
    plane = Airborne()
    plane.fbwa()
    plane.wait(2.0, m.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    plane.wait(2.0)
    assert plane.pilot.mode is Mode.HOLD
    assert plane.texts[-1] == "RC Short Failsafe: switched to CIRCLE"
    plane.wait(5.0)
    assert plane.pilot.mode is Mode.RTL
    assert plane.texts[-1] == "RC Long Failsafe: switched to RTL"


def test_a_rover_turns_on_between_two_stick_messages():
    rover = Peer("ardupilot", "rover")
    rover.vehicle.pilot.set_mode(Mode.MANUAL)
    rover.vehicle.pilot.arm(force=True)
    rover.tell(m.MAVLink_manual_control_message(1, 0, 500, 1000, 0, 0))
    rover.wait(1.2)
    assert 30.0 < math.degrees(rover.vehicle.pilot.state.yaw_rad) < 40.0


def test_sticks_in_a_mission_do_not_move_a_fixed_wing():
    plane = Airborne()
    before = plane.course
    plane.wait(4.0, m.MAVLink_manual_control_message(1, 0, 1000, 500, 0, 0))
    assert math.remainder(plane.course - before, 2.0 * math.pi) == pytest.approx(0.0, abs=0.15)
    plane.wait(10.0)
    assert plane.pilot.mode is Mode.MISSION, "FS_LONG_ACTN 0 goes on"


@pytest.mark.parametrize("main_mode", [2.0, 3.0, 7.0], ids=["ALTCTL", "POSCTL", "STABILIZED"])
def test_px4_banks_and_climbs_a_fixed_wing_by_sticks(main_mode):
    plane = Airborne(PX4)
    plane.wait(0.1, m.MAVLink_command_long_message(1, 1, 176, 0, 1.0, main_mode, 0, 0, 0, 0, 0))
    assert plane.pilot.mode is Mode.MISSION, "not without sticks"
    plane.wait(0.1, m.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    plane.wait(0.1, m.MAVLink_command_long_message(1, 1, 176, 0, 1.0, main_mode, 0, 0, 0, 0, 0))
    assert plane.pilot.mode in (Mode.ALTITUDE, Mode.POSITION, Mode.MANUAL)
    before = plane.course
    plane.wait(4.0, m.MAVLink_manual_control_message(1, 0, 500, 500, 0, 0))
    assert 0.15 < math.remainder(plane.course - before, 2.0 * math.pi) < 2.8, "to the right"
    height = plane.pilot.state.position_m[2]
    plane.wait(8.0, m.MAVLink_manual_control_message(1, -800, 0, 500, 0, 0))
    assert plane.pilot.state.position_m[2] > height + 5.0, "pulled"
    plane.wait(2.0)
    assert plane.pilot.mode is Mode.HOLD


GO_AROUND = 191


def landing_plane():
    """Return an ArduPlane that lands, 20 m above the ground."""
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=ARDUPILOT)
    items = item(22, 0.0, 150.0, 40.0, 10.0), item(16, 0.0, -700.0, 40.0), item(21, 0.0, 0.0)
    assert uploaded(vehicle, items)[0] == [m.MAV_MISSION_ACCEPTED]
    vehicle.pilot.arm(force=True)
    vehicle.pilot.start_mission()
    fly_on(vehicle, lambda: vehicle.pilot.executor.mission.lands and height(vehicle) < 20.0)
    return vehicle


def height(vehicle):
    return vehicle.pilot.state.position_m[2]


def fly_on(vehicle, until, limit_s=400.0):
    """Fly until something is so; return the texts on the way."""
    told, end_s = [], vehicle.pilot.state.time_s + limit_s
    while not until():
        now_s = vehicle.pilot.state.time_s + 0.1
        told += vehicle.poll(now_s)
        assert now_s < end_s
    return texts_of(told)


def texts_of(told):
    texts = [message.text for message in told if message.get_type() == "STATUSTEXT"]
    return [text if isinstance(text, str) else text.decode() for text in texts]


def answered(vehicle, message):
    """Send a message; return the results and the texts that answer it."""
    (crossed,) = FrameReader().feed(FrameWriter(255, 190).encode(message))
    told = vehicle.receive(crossed, vehicle.pilot.state.time_s)
    return [answer.result for answer in told if answer.get_type() == "COMMAND_ACK"], texts_of(told)


def go_around(height_m=0.0):
    return m.MAVLink_command_long_message(1, 1, GO_AROUND, 0, height_m, *[0.0] * 6)


def test_arduplane_goes_around_by_command():
    vehicle = landing_plane()
    results, texts = answered(vehicle, go_around(55.0))
    assert results == [m.MAV_RESULT_ACCEPTED]
    texts += fly_on(vehicle, lambda: not vehicle.pilot.executor.mission.goes_around)
    assert height(vehicle) == pytest.approx(55.0, abs=1.0)
    assert "Landing aborted, climbing to 55m" in texts
    texts += fly_on(vehicle, lambda: vehicle.pilot.executor.mission.lands)
    assert "Restarted landing sequence at waypoint 2" in texts
    # 0 is the height of the landing or the take-off.
    texts = answered(vehicle, go_around(0.0))[1]
    texts += fly_on(vehicle, lambda: not vehicle.pilot.executor.mission.goes_around)
    assert "Landing aborted, climbing to 40m" in texts


def test_only_arduplane_on_its_landing_goes_around():
    vehicle = SimVehicle(get_vehicle("fixed-wing"), POINT, autopilot=ARDUPILOT)
    assert answered(vehicle, go_around())[0] == [m.MAV_RESULT_FAILED]
    for name, autopilot in (("quad", ARDUPILOT), ("rover", ARDUPILOT), ("fixed-wing", PX4)):
        vehicle = SimVehicle(get_vehicle(name), POINT, autopilot=autopilot)
        assert answered(vehicle, go_around())[0] == [m.MAV_RESULT_UNSUPPORTED]


@pytest.mark.parametrize(
    ("enabled", "throttle", "breaks_off"), [(1, 960, True), (1, 850, False), (0, 960, False)]
)
def test_full_throttle_breaks_off_a_landing_if_that_is_enabled(enabled, throttle, breaks_off):
    vehicle = landing_plane()
    vehicle.pilot.parameters.stored["LAND_ABORT_THR"] = float(enabled)
    _, texts = answered(vehicle, m.MAVLink_manual_control_message(1, 0, 0, throttle, 0, 0))
    assert vehicle.pilot.executor.mission.goes_around is breaks_off
    texts += fly_on(vehicle, lambda: not vehicle.pilot.executor.mission.goes_around)
    assert ("Landing aborted via throttle" in texts) is breaks_off
