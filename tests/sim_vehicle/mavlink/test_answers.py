"""Words and answers of the two autopilots where users read them."""

import math

import pytest

from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.errors import VehicleError
from tests.support.mission_items import RTL, takeoff, wp
from tests.support.peer import Peer as GroundPeer

HOME = GeoPoint(28.05, -82.15, 10.0)
NAN = math.nan


class Peer(GroundPeer):
    """A vehicle and what it told."""

    def __init__(self, autopilot, kind="quad", **options):
        super().__init__(autopilot, kind, home=HOME, **options)

    def fly(self):
        """Take off and hover in the autopilot's guided mode."""
        if self.vehicle.firmware.title == "ArduCopter":
            self.result(176, 1.0, 4.0)
        assert self.result(400, 1.0) == 0
        altitude = 10.0 if self.vehicle.firmware.title == "ArduCopter" else 20.0
        assert self.result(22, 0, 0, 0, NAN, NAN, NAN, altitude) == 0
        self.wait(20.0)
        assert self.vehicle.pilot.state.position_m[2] > 8.0


def setpoint(mask, place=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), *, frame=1, north_m_s2=0.0):
    """A setpoint in a local frame, north, east, down."""
    return m.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *place, *velocity, north_m_s2, 0, 0, 0, 0
    )


def push(peer, seconds, message):
    """Send a message ten times a second."""
    for _ in range(round(10 * seconds)):
        peer.tell(message)
        peer.wait(0.1)


@pytest.mark.parametrize(
    ("autopilot", "kind", "texts"),
    [
        ("px4", "quad", ["Armed by external command", "Disarmed by external command"]),
        ("ardupilot", "quad", ["Arming motors", "Disarming motors"]),
        ("ardupilot", "rover", ["Throttle armed", "Throttle disarmed"]),
    ],
)
def test_words_at_arming_and_disarming(autopilot, kind, texts):
    peer = Peer(autopilot, kind)
    assert (peer.result(400, 1.0), peer.result(400, 0.0)) == (0, 0)
    assert peer.texts()[-2:] == texts


def test_ardupilot_takes_auto_without_a_mission_and_does_not_arm():
    peer = Peer("ardupilot")
    assert peer.result(176, 1.0, 3.0) == 0
    assert peer.vehicle.pilot.mode is Mode.MISSION
    assert peer.texts()[-1] == "PreArm: Mode requires mission"
    assert peer.result(400, 1.0) == 4
    assert "Mode requires mission" in peer.texts()[-1]
    assert not peer.vehicle.pilot.armed
    assert peer.result(300) == 4


# A real ArduCopter 4.7 on the ground with a mission: answers to DO_SET_MODE and to arming, and the text.
ARMS = {
    **dict.fromkeys((0, 1, 2, 4, 5, 11, 16, 20, 24), (0, 0, "Arming motors")),
    18: (0, 0, "waiting for throw"),
    3: (0, 4, "Arm: AUTO mode not armable"),
    6: (0, 4, "Arm: RTL mode not armable"),
    7: (0, 4, "Arm: CIRCLE mode not armable"),
    9: (0, 4, "Arm: LAND mode not armable"),
    17: (0, 4, "Arm: BRAKE mode not armable"),
    21: (0, 4, "Arm: SMARTRTL mode not armable"),
    13: (4, None, "No such mode 13"),
    14: (4, None, "Mode change to FLIP failed: init failed"),
    15: (4, None, "Mode change to AUTOTUNE failed: init failed"),
    22: (4, None, "Mode change to FLOWHOLD failed: init failed"),
    23: (4, None, "Mode change to FOLLOW failed: init failed"),
}


@pytest.mark.parametrize(("number", "answers"), ARMS.items())
def test_arducopter_arms_in_the_modes_of_the_real_one(number, answers):
    peer = Peer("ardupilot")
    entered, armed, text = answers
    peer.vehicle.pilot.load((takeoff(), RTL))
    assert peer.result(176, 1.0, float(number)) == entered
    assert (peer.result(400, 1.0) if entered == 0 else None) == armed
    peer.wait(0.1)
    assert peer.texts()[-1] == text
    assert peer.vehicle.pilot.armed is (armed == 0)


def test_arducopter_arms_in_auto_where_auto_options_allow_it():
    peer = Peer("ardupilot")
    peer.vehicle.pilot.load((takeoff(), RTL))
    peer.vehicle.pilot.parameters.stored.update(AUTO_OPTIONS=1.0)
    assert peer.result(176, 1.0, 3.0) == 0
    assert peer.result(400, 1.0) == 0
    assert peer.vehicle.pilot.armed


def test_arducopter_stores_a_mission_without_a_take_off_and_flies_it_in_the_air():
    peer = Peer("ardupilot")
    pilot = peer.vehicle.pilot
    pilot.load((wp(30, 0), wp(30, 30)))
    peer.wait(0.2)
    assert not peer.texts()
    assert peer.result(176, 1.0, 3.0) == 0
    assert peer.result(400, 1.0) == 4
    assert peer.result(176, 1.0, 4.0) == 0
    assert peer.result(400, 1.0) == 0
    assert peer.result(176, 1.0, 3.0) == 4
    assert peer.texts()[-2:] == ["Auto: Missing Takeoff Cmd", "Mode change to AUTO failed: init failed"]
    assert peer.result(22, 0, 0, 0, NAN, NAN, NAN, 10.0) == 0
    peer.wait(10.0)
    assert peer.result(176, 1.0, 3.0) == 0
    peer.wait(30.0)
    assert pilot.mission.complete
    assert pilot.mode is Mode.MISSION


def test_auto_without_a_mission_is_refused_in_flight():
    peer = Peer("ardupilot")
    peer.fly()
    assert peer.result(176, 1.0, 3.0) == 4
    assert peer.vehicle.pilot.mode is Mode.GUIDED
    assert peer.texts()[-1] == "Mode change to AUTO failed: init failed"
    peer.vehicle.pilot.position_ok = False
    assert peer.result(176, 1.0, 5.0) == 4
    assert peer.texts()[-1] == "Mode change to LOITER failed: requires position"
    peer = Peer("px4")
    peer.fly()
    assert peer.result(176, 1.0, 4.0, 4.0) == 1
    assert peer.texts()[-1] == "Switching to Mission is currently not available"


def test_px4_takes_any_mode_on_the_ground_and_does_not_arm_in_it():
    for main, sub, reason in (
        (4.0, 4.0, "no mission"),
        (6.0, 0.0, "No offboard signal"),
        (4.0, 5.0, "mode return"),
    ):
        peer = Peer("px4")
        assert peer.result(176, 1.0, main, sub) == 0
        assert peer.result(400, 1.0) == 1
        assert f"Preflight Fail: {reason}" in peer.texts()[0]
        assert "".join(peer.texts()[-2:]) == "Arming denied: Resolve system health failures first"
        assert not peer.vehicle.pilot.armed


@pytest.mark.parametrize(
    ("autopilot", "kind", "name", "value", "text"),
    [
        ("ardupilot", "quad", "DISARM_DELAY", None, "Disarming motors"),
        ("px4", "quad", "COM_DISARM_PRFLT", None, "Disarmed by auto preflight disarming"),
        ("ardupilot", "quad", "DISARM_DELAY", 0.0, None),
        ("px4", "quad", "COM_DISARM_PRFLT", 30.0, None),
        ("px4", "rover", "COM_DISARM_PRFLT", None, None),
        ("ardupilot", "rover", "DISARM_DELAY", None, None),
        ("ardupilot", "fixed-wing", "DISARM_DELAY", None, None),
    ],
)
def test_a_vehicle_that_never_takes_off_is_disarmed(autopilot, kind, name, value, text):
    """After ten seconds, which are a parameter; rovers and ArduPlane stay armed."""
    peer = Peer(autopilot, kind)
    if value is not None:
        peer.vehicle.pilot.parameters.stored[name] = value
    assert peer.result(400, 1.0) == 0
    peer.wait(9.5)
    assert peer.vehicle.pilot.armed
    peer.wait(1.0 if text else 15.0)
    assert peer.vehicle.pilot.armed is (text is None)
    if text:
        assert not peer.of("HEARTBEAT")[-1].base_mode & 128
        assert peer.texts()[-1] == text


def test_brake_is_told_as_brake():
    peer = Peer("ardupilot")
    peer.fly()
    assert peer.result(176, 1.0, 17.0) == 0
    assert peer.of("HEARTBEAT")[-1].custom_mode == 17
    assert peer.vehicle.pilot.mode is Mode.HOLD


@pytest.mark.parametrize("mask", [0x0FC7, 0x0DC7])
def test_a_velocity_with_the_force_bit_and_no_force_is_flown(mask):
    peer = Peer("ardupilot")
    peer.fly()
    push(peer, 3.0, setpoint(mask, velocity=(2.0, 0.0, 0.0), frame=8))
    speed = math.hypot(*peer.vehicle.pilot.state.velocity_m_s[:2])
    assert speed == pytest.approx(2.0, abs=0.1)
    assert not any("refused" in text for text in peer.texts())


def test_a_force_is_refused():
    peer = Peer("ardupilot")
    peer.fly()
    peer.tell(setpoint(0x0E3F, north_m_s2=1.0))
    assert "Setpoint refused: forces are not flown" in peer.texts()


@pytest.mark.parametrize(
    ("autopilot", "command", "result"), [("px4", 420, None), ("px4", 211, None), ("ardupilot", 420, 3)]
)
def test_px4_does_not_answer_an_injected_failure_a_gripper_or_a_winch(autopilot, command, result):
    assert Peer(autopilot).result(command, 0.0, 1.0) is result


def test_ardupilot_sends_its_banner_when_asked():
    peer = Peer("ardupilot")
    assert peer.result(42428) == 0
    assert peer.texts()[-1].startswith("ArduCopter V4.")
    assert Peer("px4").result(42428) == 3


@pytest.mark.parametrize("down_m", [0.0, 2.0])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_setpoint_at_or_below_the_ground_is_flown_to_the_ground(autopilot, down_m):
    peer = Peer(autopilot)
    peer.fly()
    there = setpoint(0b100111111000, (8.0, 0.0, down_m))
    peer.tell(there)
    if autopilot == "px4":
        assert peer.result(176, 1.0, 6.0) == 0
    push(peer, 20.0, there)
    east, north, up = peer.vehicle.pilot.state.position_m
    assert (east, north) == pytest.approx((0.0, 8.0), abs=0.5)
    assert 0.0 <= up < 0.3
    assert not any("refused" in text for text in peer.texts())


@pytest.mark.parametrize(("autopilot", "headings"), [("ardupilot", (180, 270, 270, 270)), ("px4", (0,) * 4)])
def test_arducopter_looks_along_velocities_without_a_heading(autopilot, headings):
    peer = Peer(autopilot)
    peer.fly()
    seen = []
    for velocity in ((-2.0, 0.0, 0.0), (0.0, -2.0, 0.5), (0.0, 0.0, -0.5), (0.2, 0.0, 0.0)):
        order = setpoint(0b111111000111, velocity=velocity)
        push(peer, 0.2, order)
        if autopilot == "px4" and peer.vehicle.pilot.mode is not Mode.GUIDED:
            assert peer.result(176, 1.0, 6.0) == 0
        push(peer, 8.0, order)
        seen.append(round(math.degrees(peer.vehicle.pilot.state.yaw_rad)) % 360)
    assert seen == pytest.approx(headings, abs=5)


def test_the_origin_is_told_when_another_is_asked_for():
    peer = Peer("px4")
    answers = peer.tell(m.MAVLink_set_gps_global_origin_message(1, 471234567, 81234567, 400_000))
    (origin,) = [answer for answer in answers if answer.get_type() == "GPS_GLOBAL_ORIGIN"]
    assert origin.latitude == 280500000


def test_odometry_is_the_position_and_the_attitude_of_the_body():
    peer = Peer("px4")
    peer.fly()
    peer.result(192, 5.0, 1.0, 0.0, NAN, 28.0510, -82.15, 30.0)
    peer.wait(6.0)
    state = peer.vehicle.pilot.state
    odometry, ned = peer.of("ODOMETRY")[-1], peer.of("LOCAL_POSITION_NED")[-1]
    assert (odometry.x, odometry.y, odometry.z) == pytest.approx((ned.x, ned.y, ned.z), abs=0.5)
    w, x, y, z = odometry.q
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
    speed = math.sqrt(sum(v * v for v in state.velocity_m_s))
    assert speed > 1.0
    assert math.sqrt(odometry.vx**2 + odometry.vy**2 + odometry.vz**2) == pytest.approx(speed, rel=0.15)
    assert (odometry.frame_id, odometry.child_frame_id) == (1, 12)


def test_what_is_refused_while_the_vehicle_flies_has_the_autopilots_words():
    peer = Peer("ardupilot")
    peer.fly()
    assert (peer.result(241, 1.0), peer.texts()[-1]) == (4, "Disarm to allow calibration")
    before = len(peer.texts())
    assert peer.result(400, 0.0) == 4
    assert len(peer.texts()) == before, "ArduPilot says nothing"
    peer = Peer("px4")
    peer.fly()
    before = len(peer.texts())
    assert peer.result(241, 1.0) == 1
    assert len(peer.texts()) == before
    assert (peer.result(400, 0.0), peer.texts()[-1]) == (1, "Disarming denied: not landed")


@pytest.mark.parametrize("command", [20, 21])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_rover_that_is_home_stays_armed_when_it_is_sent_there(autopilot, command):
    peer = Peer(autopilot, "rover")
    assert peer.result(400, 1.0) == 0
    assert peer.result(command) == 0
    peer.wait(5.0)
    assert peer.vehicle.pilot.armed


def count(items, plan=m.MAV_MISSION_TYPE_MISSION):
    return m.MAVLink_mission_count_message(1, 1, items, plan)


def answers_to_count(peer, items, plan=m.MAV_MISSION_TYPE_MISSION):
    """What the vehicle answers to a COUNT: types of messages, results, texts; it gives the upload up then."""
    told = []
    for answer in peer.tell(count(items, plan)):
        kind = answer.get_type()
        told.append((kind, answer.type if kind == "MISSION_ACK" else getattr(answer, "text", None)))
    peer.wait(10.0)
    return told


@pytest.mark.parametrize(
    ("kind", "rooms"), [("quad", (650, 70, 46)), ("wing", (655, 84, 50)), ("rover", (655, 84, 50))]
)
def test_ardupilot_has_room_for_so_many_items_without_a_card(kind, rooms):
    """Items of mission, fence and rally points; home counts (StorageManager.cpp)."""
    peer = Peer("ardupilot", kind)
    for plan, room in enumerate(rooms):
        assert answers_to_count(peer, room, plan) == [("MISSION_REQUEST", None)]
        refused = answers_to_count(peer, room + 1, plan)
        assert ("MISSION_ACK", m.MAV_MISSION_NO_SPACE) in refused
        assert ("STATUSTEXT", f"Only {room} items are supported") in refused


def test_ardupilots_fence_may_be_on_the_card():
    spec = with_autopilot(get_vehicle("quad"), "ardupilot", {"BRD_SD_FENCE": 1.0})
    peer = Peer("ardupilot", spec=spec)
    assert answers_to_count(peer, 128, m.MAV_MISSION_TYPE_FENCE) == [("MISSION_REQUEST", None)]
    refused = answers_to_count(peer, 129, m.MAV_MISSION_TYPE_FENCE)
    assert ("STATUSTEXT", "Only 128 items are supported") in refused


def test_ardupilots_card_is_read_when_it_starts():
    peer = Peer("ardupilot")
    peer.tell(m.MAVLink_param_set_message(1, 1, b"BRD_SD_MISSION", 20.0, m.MAV_PARAM_TYPE_INT16))
    assert ("MISSION_ACK", m.MAV_MISSION_NO_SPACE) in answers_to_count(peer, 1365)
    assert peer.result(m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0) == 0
    assert answers_to_count(peer, 1365) == [("MISSION_REQUEST", None)]
    assert ("STATUSTEXT", "Only 1365 items are supported") in answers_to_count(peer, 1366)
    peer.tell(m.MAVLink_param_set_message(1, 1, b"BRD_SD_MISSION", 64.0, m.MAV_PARAM_TYPE_INT16))
    peer.result(m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0)
    assert ("STATUSTEXT", "Only 4368 items are supported") in answers_to_count(peer, 60_000)


@pytest.mark.parametrize(
    ("autopilot", "name", "kib", "reason"),
    [
        ("px4", "BRD_SD_MISSION", 64.0, "no parameter BRD_SD_MISSION"),
        ("ardupilot", "BRD_SD_MISSION", 65.0, "give 0 to 64 KiB"),
    ],
)
def test_a_card_that_an_autopilot_has_not_is_refused(autopilot, name, kib, reason):
    with pytest.raises(VehicleError, match=reason):
        with_autopilot(get_vehicle("quad"), autopilot, {name: kib})


def test_px4_refuses_a_long_mission_without_a_word():
    peer = Peer("px4")
    assert answers_to_count(peer, 65_535) == [("MISSION_ACK", m.MAV_MISSION_NO_SPACE)]


def landed(peer):
    peer.wait(90.0)
    assert not peer.vehicle.pilot.armed
    peer.wait(2.0)
    return peer.of("HEARTBEAT")[-1].custom_mode


@pytest.mark.parametrize(("autopilot", "mode"), [("px4", 4 << 16 | 3 << 24), ("ardupilot", 9)])
def test_px4_holds_after_a_landing_and_ardupilot_stays_in_its_mode(autopilot, mode):
    peer = Peer(autopilot)
    peer.fly()
    assert peer.result(m.MAV_CMD_NAV_LAND) == 0
    assert landed(peer) == mode


def test_px4_goes_back_to_offboard_after_a_failsafe_and_does_not_arm_there_without_a_stream():
    peer = Peer("px4")
    peer.fly()
    hold = setpoint(0x0FC7)
    push(peer, 2.0, hold)
    assert peer.result(176, 1.0, 6.0) == 0
    push(peer, 1.0, hold)
    peer.wait(5.0)
    assert peer.vehicle.pilot.mode is Mode.RTL
    assert landed(peer) == 6 << 16
    assert peer.result(400, 1.0) == m.MAV_RESULT_TEMPORARILY_REJECTED
    assert any("No offboard signal" in text for text in peer.texts())


def test_a_fence_that_holds_arducopter_does_so_from_the_first_moment():
    peer = Peer("ardupilot")
    peer.fly()
    pilot = peer.vehicle.pilot
    pilot.parameters.fence_action, pilot.parameters.fence_enable = 4, 1
    pilot.parameters.fence_radius_m = 30.0
    pilot.apply_parameters()
    height = pilot.state.position_m[2]
    pilot.executor.steer((6.0, 0.0, 0.0))
    peer.wait(20.0)
    assert peer.of("HEARTBEAT")[-1].custom_mode == 17
    assert pilot.state.position_m[2] == pytest.approx(height, abs=0.1)


# What is refused, and what the real one says of it: PX4's Commander.cpp, navigator_main.cpp and
# mavlink_receiver.cpp; ArduPilot's GCS_Common.cpp, GCS_MAVLink_Copter.cpp and AP_Mission.cpp.
REFUSED = [
    ("px4", (400, 2.0), m.MAV_RESULT_UNSUPPORTED, ["Unsupported ARM_DISARM param: 2.000"]),
    ("px4", (300,), m.MAV_RESULT_TEMPORARILY_REJECTED, ["Switching to Mission is currently not available"]),
    ("px4", (511, 9999.0, 1e6), m.MAV_RESULT_DENIED, []),
    ("px4", (510, -1.0), m.MAV_RESULT_DENIED, []),
    ("px4", (189,), m.MAV_RESULT_TEMPORARILY_REJECTED, []),
    ("px4", (179, 0, 0, 0, 0, NAN, NAN, NAN), m.MAV_RESULT_DENIED, []),
    ("px4", (246, 1.0), m.MAV_RESULT_DENIED, []),
    ("px4", (195, 0, 0, 0, 0, 95.0, -82.15, 5.0), m.MAV_RESULT_DENIED, []),
    ("ardupilot", (195, 0, 0, 0, 0, NAN, NAN, 5.0), m.MAV_RESULT_DENIED, []),
    ("ardupilot", (176, 1.0, NAN), m.MAV_RESULT_DENIED, []),
    ("ardupilot", (400, 2.0), m.MAV_RESULT_UNSUPPORTED, []),
    ("ardupilot", (300,), m.MAV_RESULT_FAILED, ["Mode change to AUTO failed: init failed"]),
    ("ardupilot", (511, 9999.0, 1e6), m.MAV_RESULT_DENIED, ["No ap_message for mavlink id (9999)"]),
    ("ardupilot", (189,), m.MAV_RESULT_FAILED, ["Unable to start landing sequence"]),
    ("ardupilot", (224, 9.0), m.MAV_RESULT_DENIED, []),
    ("ardupilot", (193, 5.0), m.MAV_RESULT_DENIED, []),
    ("ardupilot", (207, 7.0), m.MAV_RESULT_DENIED, []),
    ("ardupilot", (246, 1.0), m.MAV_RESULT_FAILED, []),
    ("ardupilot", (115, NAN), m.MAV_RESULT_FAILED, []),
]


@pytest.mark.parametrize(("autopilot", "order", "result", "texts"), REFUSED)
def test_refused_commands_have_the_words_of_the_autopilot_or_none(autopilot, order, result, texts):
    peer = Peer(autopilot)
    peer.fly()
    before = len(peer.texts())
    assert peer.result(*order) == result
    peer.wait(0.5)
    assert peer.texts()[before:] == texts


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_an_item_that_there_is_not_is_not_chosen_and_only_px4_says_so(autopilot):
    peer = Peer(autopilot)
    peer.tell(m.MAVLink_mission_set_current_message(1, 1, 7))
    assert peer.texts() == (["WPM: WP CURR CMD: Not in list"] if autopilot == "px4" else [])
