"""The vehicle message by message: commands, parameters, rates, and whatever else may come."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import FrameWriter
from mission.model import Command, Frame, MissionItem
from mission.outcome import Outcome
from mission.transfer import wire
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.mavlink.commands import HANDLERS
from sim_vehicle.mavlink.reports import LONGEST_US, SHORTEST_US, Schedule
from sim_vehicle.mavlink.telemetry import BUILDERS
from tests.support.peer import Peer

NAN = math.nan
TOLD_IN_FLIGHT = {m.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT, m.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED}


SURVEY = (
    MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=28.05, y=-82.15, z=5.0),
    MissionItem.waypoint(28.0502, -82.15, 5.0),
    MissionItem(Command.NAV_RETURN_TO_LAUNCH),
)


@pytest.mark.parametrize("message_id", sorted(set(BUILDERS) - TOLD_IN_FLIGHT))
def test_every_message_can_be_requested_and_survives_the_wire(message_id):
    answers = Peer(PX4).command(m.MAV_CMD_REQUEST_MESSAGE, message_id)
    assert answers[0].get_type() == "COMMAND_ACK" and answers[0].result == 0
    assert answers[1].get_msgId() == message_id


def test_all_modes_are_listed():
    peer = Peer()
    modes = [a for a in peer.command(512, 435, 0) if a.get_type() == "AVAILABLE_MODES"]
    assert [a.mode_index for a in modes] == list(range(1, modes[0].number_modes + 1))
    assert {a.custom_mode for a in modes} == set(PX4.for_vehicle("multirotor").mavlink.modes.numbers.values())
    assert len(peer.command(512, 435, 2)) == 2
    assert peer.command(512, 435, 99)[0].result == 2


def test_capabilities_and_home_by_the_old_commands():
    peer = Peer()
    assert [a.get_type() for a in peer.command(520, 1)] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]
    home = peer.command(410)[1]
    assert (home.latitude, home.longitude, home.altitude) == (280500000, -821500000, 20000)


def test_ardupilot_claims_what_a_real_one_claims_and_does_it():
    found = Peer(ARDUPILOT).asked(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION).capabilities
    # ArduCopter 4.7 claims 64495; terrain and compass calibration are not there.
    assert found == 64495 & ~(512 | 4096)
    px4 = Peer(PX4).asked(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION).capabilities
    assert px4 & m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    assert Peer(PX4).asked(m.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type == 3
    assert Peer(ARDUPILOT).asked(m.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type == 6


@pytest.mark.parametrize(
    ("autopilot", "kind", "mode", "expected"),
    [
        (ARDUPILOT, "quad", Mode.MANUAL, 81),
        (ARDUPILOT, "quad", Mode.LAND, 81),
        (ARDUPILOT, "quad", Mode.POSITION, 89),
        (ARDUPILOT, "quad", Mode.MISSION, 89),
        (ARDUPILOT, "fixed-wing", None, 65),
        (PX4, "quad", None, 29),
    ],
)
def test_base_modes(autopilot, kind, mode, expected):
    peer = Peer(autopilot, kind)
    if mode is not None:
        peer.upload(SURVEY)
        assert peer.result(176, 1.0, ARDUPILOT.for_vehicle("multirotor").mavlink.modes[mode]) == 0
    assert peer.asked(m.MAVLINK_MSG_ID_HEARTBEAT).base_mode == expected


def test_ardupilots_fence_is_enabled_by_its_parameter():
    fence = m.MAV_SYS_STATUS_GEOFENCE

    def status(peer):
        found = peer.asked(m.MAVLINK_MSG_ID_SYS_STATUS)
        return tuple(
            bool(getattr(found, f"onboard_control_sensors_{name}") & fence)
            for name in ("present", "enabled", "health")
        )

    peer = Peer(ARDUPILOT)
    assert status(peer) == (True, False, True)
    peer.tell(m.MAVLink_param_set_message(1, 1, b"FENCE_ENABLE", 1.0, 9))
    assert status(peer) == (True, True, True)
    assert status(Peer(PX4)) == (True, True, True)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("mode", [Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.HOLD, Mode.RTL, Mode.LAND])
def test_modes_by_command_and_by_message(autopilot, mode):
    number = autopilot.for_vehicle("multirotor").mavlink.modes[mode]
    peer = Peer(autopilot)
    if autopilot is PX4:
        assert peer.result(176, 1.0, number >> 16 & 255, number >> 24) == 0
    else:
        assert peer.result(176, 1.0, number) == 0
    assert peer.vehicle.pilot.mode is mode
    peer = Peer(autopilot)
    peer.tell(m.MAVLink_set_mode_message(1, 1, number))
    assert peer.vehicle.pilot.mode is mode
    assert autopilot.for_vehicle("multirotor").mavlink.modes.mode_of(number) is mode
    beats = [t for t in peer.told if t.get_type() == "HEARTBEAT"]
    assert beats[-1].custom_mode == number


def test_modes_that_do_not_exist_or_are_not_possible():
    peer = Peer()
    assert peer.result(176, 1.0, 99.0) == 0, "PX4 passes over a main mode that it does not know"
    assert peer.result(176, 0.0, 4.0, 3.0) == 2
    assert peer.result(176, 1.0, 4.0, 40.0) == 1
    assert peer.result(176, NAN, NAN, NAN) == 2
    peer.tell(m.MAVLink_set_mode_message(1, 1, 12345))
    assert peer.texts() == ["Unsupported auto mode"]
    assert peer.vehicle.pilot.mode is Mode.HOLD


def test_standard_modes():
    peer = Peer()
    assert peer.result(262, 5) == 0 and peer.vehicle.pilot.mode is Mode.RTL
    assert peer.result(262, 1) == 0 and peer.vehicle.pilot.mode is Mode.HOLD
    assert peer.result(262, 77) == 3


def test_arming_again_is_fine_and_disarming_in_the_air_is_not():
    peer = Peer()
    assert peer.result(400, 1.0) == peer.result(400, 1.0) == 0
    assert peer.result(400, 2.0) == 3
    assert peer.result(22, 0, 0, 0, 0, 0, 0, NAN) == 0
    peer.wait(5.0)
    assert peer.result(400, 0.0) == 1
    assert "Disarming denied: not landed" in peer.texts()
    assert peer.result(400, 0.0, 21196.0) == 0
    assert not peer.vehicle.pilot.armed
    assert peer.vehicle.pilot.state.position_m[2] == 0.0


@pytest.mark.parametrize(("autopilot", "begins"), [(PX4, "Preflight Fail: "), (ARDUPILOT, "PreArm: ")])
def test_checks_before_arming_are_run_on_request(autopilot, begins):
    peer = Peer(autopilot)
    assert peer.result(401) == 0
    assert not [text for text in peer.texts() if text.startswith(begins)]
    peer.vehicle.pilot.arming.block = "test"
    assert peer.result(401) == 0
    assert f"{begins}test" in peer.texts()
    assert peer.result(400, 1.0) != 0
    assert peer.vehicle.outcome is Outcome.ARMING_REFUSED
    assert peer.result(400, 1.0, 21196.0) == 0, "by force"
    assert peer.vehicle.outcome is Outcome.RUNNING
    assert peer.result(401) == 1


def test_a_repeated_command_is_done_once():
    peer = Peer()
    assert peer.result(400, 1.0) == 0
    assert peer.result(400, 0.0) == 0
    assert peer.result(400, 1.0) == 0
    assert peer.result(400, 0.0) == 0
    peer.vehicle.pilot.arm()
    assert peer.result(400, 0.0, confirmation=1) == 0
    assert peer.vehicle.pilot.armed, "the retransmission got its answer, and nothing was done again"
    assert peer.result(178, NAN, NAN, confirmation=3) == 2


def test_takeoff_heights_of_the_two_autopilots():
    for autopilot, parameter, expected in ((PX4, 26.0, 6.0), (PX4, 0.0, 10.0), (ARDUPILOT, 6.0, 6.0)):
        peer = Peer(autopilot)
        assert autopilot is PX4 or peer.result(176, 1.0, 4.0) == 0
        assert peer.result(400, 1.0) == 0
        assert peer.result(22, 0, 0, 0, 0, 0, 0, parameter) == 0
        peer.wait(20.0)
        assert peer.vehicle.pilot.state.position_m[2] == pytest.approx(expected, abs=0.1)
        assert peer.vehicle.pilot.mode is autopilot.for_vehicle("multirotor").mavlink.modes.after_takeoff
    peer = Peer(ARDUPILOT)
    assert peer.result(22, 0, 0, 0, 0, 0, 0, 6.0) == 4
    peer = Peer(PX4)
    assert peer.result(22, 0, 0, 0, 0, 0, 0, 27.0) == 0
    assert not peer.vehicle.pilot.armed
    peer.result(400, 1.0)
    peer.wait(20.0)
    assert peer.vehicle.pilot.state.position_m[2] == pytest.approx(7.0, abs=0.1)
    assert peer.result(22, 0, 0, 0, 0, 0, 0, 1e6) == 2


def test_reposition_by_int_in_both_frames_and_its_refusals():
    peer = Peer()

    def goto(x, y, z, frame):
        message = m.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1.0, 1.0, 0.0, NAN, x, y, z)
        return next(a for a in peer.tell(message) if a.get_type() == "COMMAND_ACK").result

    assert goto(280501000, -821500000, 10.0, 6) == 1
    peer.result(400, 1.0)
    peer.result(22, 0, 0, 0, 0, 0, 0, NAN)
    peer.wait(10.0)
    assert goto(280501000, -821500000, 8.0, 6) == 0
    peer.wait(15.0)
    assert peer.vehicle.state.position_e7 == pytest.approx((280501000, -821500000, 28_000), abs=20)
    assert goto(280500000, -821500000, 35.0, 5) == 0
    peer.wait(15.0)
    assert peer.vehicle.state.position_e7 == pytest.approx((280500000, -821500000, 35_000), abs=20)
    assert goto(380500000, -821500000, 10.0, 6) == 2
    assert goto(280501000, -821500000, -10.0, 6) == 2
    assert goto(280501000, -821500000, 10.0, 2) == 2
    assert goto(0, 0, 10.0, 6) == 2
    assert goto(2**31 - 1, -(2**31), 10.0, 6) == 2


def test_mission_start_pause_and_current_item():
    peer = Peer()
    assert peer.result(300) == 1
    assert peer.upload(SURVEY).type == 0
    assert peer.result(300, 1.0) == 0
    assert peer.vehicle.pilot.mission.current_seq == 1
    answers = peer.tell(m.MAVLink_mission_set_current_message(1, 1, 0))
    assert [(a.get_type(), a.seq) for a in answers] == [("MISSION_CURRENT", 0)]
    assert peer.result(224, 1.0) == 3, "PX4 takes the message only"
    peer.tell(m.MAVLink_mission_set_current_message(1, 1, 2))
    assert peer.vehicle.pilot.mission.current_seq == 2
    assert peer.result(193, 0.0) == 3 and peer.vehicle.pilot.mode is Mode.MISSION, "PX4 pauses by its modes"


def test_ardupilot_counts_home_as_item_zero():
    peer = Peer(ARDUPILOT)
    peer.tell(m.MAVLink_mission_count_message(1, 1, 4, 0))
    assert peer.upload(SURVEY).type == 0
    assert peer.vehicle.pilot.mission.size == 3
    assert peer.command(224, 2.0)[-1].seq == 2
    assert peer.vehicle.pilot.mission.current_seq == 1
    assert peer.result(224, -1.0, 1.0) == 0
    assert peer.vehicle.pilot.mission.current_seq == 0
    assert peer.result(224, 4.0) == 2


@pytest.mark.parametrize(("autopilot", "command"), [(PX4, 260), (ARDUPILOT, 208)])  # survey, parachute
def test_items_that_the_simulator_cannot_fly_are_refused(autopilot, command):
    assert Peer(autopilot).upload([*SURVEY, MissionItem(command, 2)]).type == wire.UNSUPPORTED


def test_fence_and_rally_do_not_touch_the_mission():
    peer = Peer()
    peer.upload(SURVEY)
    rally = MissionItem(Command.NAV_RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, x=28.05, y=-82.15, z=10.0)
    assert peer.upload([rally], kind=2).type == 0
    assert peer.vehicle.pilot.mission.size == 3


def test_speed_home_reboot_and_calibration():
    peer = Peer()
    assert peer.result(178, 1.0, 5.0, -1.0) == 0
    assert peer.result(178, 1.0, -1.0) == 0
    assert peer.result(178, 1.0, 500.0) == 2
    assert peer.result(178, 3.0, 5.0) == 3
    assert peer.result(179, 1.0) == 0
    assert peer.result(179, 0, 0, 0, 0, 29.06, -82.15, 10.0) == 2
    assert peer.result(179, 0, 0, 0, 0, 28.06, -82.15, 10.0) == 0
    assert peer.vehicle.state.home_e7[0] == pytest.approx(280_600_000, abs=20), "a float32 came"
    assert peer.result(241) == 0
    peer.wait(5.0)
    assert (peer.result(246, 3.0), peer.result(246, 1.0)) == (3, 0), "there is no bootloader to stay in"
    peer.wait(1.0)
    assert peer.vehicle.state.boot_ms == 1000
    peer.result(400, 1.0)
    assert (peer.result(246, 1.0), peer.result(241)) == (2, 1)


def test_camera_commands_are_passed_on_when_there_is_a_camera():
    peer = Peer()
    assert peer.result(2000, 0, 1.0, 3) == 3
    camera = FrameWriter(1, 100)
    peer.tell(m.MAVLink_heartbeat_message(30, 8, 0, 0, 3, 3), camera)
    answers = peer.command(2000, 0, 1.0, 3)
    passed = next(a for a in answers if a.get_type() == "COMMAND_LONG")
    assert (passed.target_system, passed.target_component) == (1, 100)
    assert (passed.command, passed.param2) == (2000, 1.0)
    peer.tell(m.MAVLink_command_ack_message(2000, 2, 0, 0, 1, 1), camera)
    peer.wait(3.0)
    assert "Camera refused command 2000 (result 2)" in peer.texts()


def test_commands_for_others_are_ignored():
    peer = Peer()
    assert peer.command(400, 1.0, target=(2, 1)) == []
    assert peer.command(400, 1.0, target=(1, 100)) == []
    assert peer.command(400, 1.0, target=(0, 0))[0].result == 0


def test_ping_and_timesync():
    peer = Peer(epoch_unix_s=1000.0)
    peer.wait(2.0)
    answer = peer.tell(m.MAVLink_ping_message(77, 5, 0, 0))[0]
    assert (answer.time_usec, answer.seq, answer.target_system, answer.target_component) == (77, 5, 255, 190)
    assert peer.tell(m.MAVLink_ping_message(77, 5, 1, 1)) == []
    answer = peer.tell(m.MAVLink_timesync_message(0, 123))[0]
    assert (answer.tc1, answer.ts1) == (1_002_000_000_000, 123)
    assert peer.tell(m.MAVLink_timesync_message(5, 123)) == []


def test_long_texts_are_cut_into_chunks():
    peer = Peer()
    text = "x" * 50 + "y" * 50
    peer.vehicle.pilot.warn(text)
    peer.wait(0.1)
    pieces = [t for t in peer.told if t.get_type() == "STATUSTEXT"]
    assert [p.chunk_seq for p in pieces] == [0, 1, 2]
    assert len({p.id for p in pieces}) == 1 and pieces[0].id > 0
    assert "".join(p.text for p in pieces) == text


def read_parameter(message, autopilot):
    if autopilot is PX4 and message.param_type == 6:
        return struct.unpack("<i", struct.pack("<f", message.param_value))[0]
    return message.param_value


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_parameters_list_read_and_set(autopilot):
    peer = Peer(autopilot)
    table = peer.vehicle.firmware.parameters(peer.vehicle.pilot.spec, 1)
    peer.tell(m.MAVLink_param_request_list_message(1, 1))
    peer.wait(2.0)
    everything = peer.of("PARAM_VALUE")[: len(table)]
    assert [p.param_index for p in everything] == list(range(len(table)))
    assert {p.param_count for p in everything} == {len(table)}
    assert all(len(p.param_id) <= 16 for p in everything)
    by_name = {p.param_id: p for p in everything}
    name, value, scale = ("MPC_XY_CRUISE", 6.0, 1.0) if autopilot is PX4 else ("WPNAV_SPEED", 600.0, 100.0)
    answer = peer.tell(m.MAVLink_param_set_message(1, 1, name.encode(), value, 9))[0]
    assert (answer.param_id, answer.param_value) == (name, value)
    assert peer.vehicle.pilot.spec.cruise_speed_m_s == pytest.approx(value / scale)
    assert peer.tell(m.MAVLink_param_request_read_message(1, 1, name.encode(), -1))[0].param_value == value
    assert peer.tell(m.MAVLink_param_request_read_message(1, 1, b"", answer.param_index))[0].param_id == name
    system = by_name["MAV_SYS_ID" if autopilot is PX4 else "MAV_SYSID"]
    assert read_parameter(system, autopilot) == 1
    for refused in (NAN, math.inf):
        answer = peer.tell(m.MAVLink_param_set_message(1, 1, name.encode(), refused, 9))
        values = [a.param_value for a in answer if a.get_type() == "PARAM_VALUE"]
        assert values == ([value] if autopilot is PX4 else []), "ArduPilot answers PARAM_ERROR alone"
    assert sum(f"{name} must be" in text for text in peer.texts()) == (2 if autopilot is PX4 else 0)
    peer.tell(m.MAVLink_param_set_message(1, 1, system.param_id.encode(), 5.0, system.param_type))
    assert f"{system.param_id} cannot be changed" in peer.texts()


def test_ardupilot_answers_for_components_that_it_never_heard():
    """Rule 1e of ArduPilot's routing; PX4 answers only for itself and for all components."""
    peer, px4 = Peer(ARDUPILOT), Peer(PX4)
    beat = m.MAVLink_heartbeat_message(18, 8, 0, 0, 0, 3)
    peer.tell(beat, FrameWriter(1, 191))
    peer.tell(beat, FrameWriter(2, 99))
    for target, answered in (((1, 99), True), ((1, 190), True), ((1, 191), False), ((2, 99), False)):
        assert (peer.result(410, target=target) == 0) is answered
        count = peer.tell(m.MAVLink_mission_request_list_message(*target, 0))
        assert ([message.get_type() for message in count] == ["MISSION_COUNT"]) is answered
        assert px4.result(410, target=target) is None
    peer.tell(beat, FrameWriter(1, 99))
    assert peer.result(410, target=(1, 99)) is None


@pytest.mark.parametrize(("frame", "altitude_m"), [(0, 30.0), (3, 30.0), (10, 30.0), (11, 30.0)])
def test_ardupilot_flies_to_positions_in_every_global_frame(frame, altitude_m):
    peer = Peer(ARDUPILOT)
    peer.result(176, 1.0, 4.0)
    assert (peer.result(400, 1.0), peer.result(22, 0, 0, 0, 0, 0, 0, 10.0)) == (0, 0)
    peer.wait(15.0)
    altitude = altitude_m + 20.0 * (frame == 0)
    place = (280500000, -821500000, altitude)
    (ack,) = peer.tell(m.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, 0, 0, 0, *place))
    assert ack.result == 0
    peer.wait(20.0)
    assert peer.vehicle.pilot.state.position_m[2] == pytest.approx(altitude_m, abs=1.0)
    (ack,) = peer.tell(m.MAVLink_command_int_message(1, 1, 1, 192, 0, 0, -1, 0, 0, 0, *place))
    assert ack.result == 2
    (ack,) = Peer(PX4).tell(m.MAVLink_command_int_message(1, 1, frame, 192, 0, 0, -1, 0, 0, 0, *place))
    assert (ack.result == 2) is (frame > 3), "PX4 knows no terrain here"


@pytest.mark.parametrize(("autopilot", "text"), [(PX4, "WPM: IGN WP CURR CMD: Busy"), (ARDUPILOT, None)])
def test_px4_keeps_its_item_during_a_transfer(autopilot, text):
    peer = Peer(autopilot)
    peer.upload(SURVEY)
    peer.tell(m.MAVLink_mission_count_message(1, 1, 9, 0))
    peer.tell(m.MAVLink_mission_set_current_message(1, 1, 2))
    busy = [told for told in peer.texts() if "CURR" in told]
    assert busy == ([] if text is None else [text])
    assert (peer.vehicle.pilot.mission.current_seq == 0) is (text is not None)


def test_px4_takes_an_item_after_a_download_without_an_ack():
    """As MAVProxy's ``wp list`` and ``wp set``; the real one waits five seconds for the ACK."""
    peer = Peer(PX4)
    peer.upload(SURVEY)
    peer.tell(m.MAVLink_mission_request_list_message(1, 1, 0))
    for seq in range(len(SURVEY)):
        peer.tell(m.MAVLink_mission_request_int_message(1, 1, seq, 0))
    peer.tell(m.MAVLink_mission_set_current_message(1, 1, 1))
    assert peer.vehicle.pilot.mission.current_seq == 1


@pytest.mark.parametrize(
    ("name", "kind"),
    [("MPC_XY_CRUISE", 6), ("MPC_XY_CRUISE", 0), ("COM_DL_LOSS_T", 9), ("COM_DL_LOSS_T", 5)],
)
def test_px4_ignores_a_parameter_of_another_type(name, kind):
    peer = Peer(PX4)
    read = m.MAVLink_param_request_read_message(1, 1, name.encode(), -1)
    (before,) = peer.tell(read)
    assert peer.tell(m.MAVLink_param_set_message(1, 1, name.encode(), 8.0, kind)) == []
    assert bytes(peer.tell(read)[0].get_payload()) == bytes(before.get_payload())
    assert peer.tell(m.MAVLink_param_set_message(1, 1, name.encode(), 8.0, before.param_type)) != []


def test_arducopter_takes_off_only_from_the_ground_and_in_modes_with_a_take_off():
    for mode, result in ((0, 4), (1, 4), (2, 4), (4, 0), (5, 0), (16, 0)):
        peer = Peer(ARDUPILOT)
        assert (peer.result(176, 1.0, mode), peer.result(400, 1.0)) == (0, 0)
        assert peer.result(22, 0, 0, 0, 0, 0, 0, 10.0) == result
        peer.wait(15.0 if result == 0 else 3.0)
        assert peer.vehicle.pilot.state.position_m[2] == pytest.approx(0.0 if result else 10.0, abs=0.1)
        assert result or peer.result(22, 0, 0, 0, 0, 0, 0, 20.0) == 4


def test_the_return_altitude_parameter_acts():
    peer = Peer()
    peer.tell(m.MAVLink_param_set_message(1, 1, b"RTL_RETURN_ALT", 25.0, 9))
    peer.result(400, 1.0)
    peer.result(22, 0, 0, 0, 0, 0, 0, NAN)
    peer.wait(10.0)
    peer.result(192, 5.0, 1.0, 0.0, NAN, 28.0505, -82.15, NAN)
    peer.wait(20.0)
    peer.result(20)
    peer.wait(90.0)
    heights = [t.relative_alt for t in peer.told if t.get_type() == "GLOBAL_POSITION_INT"]
    assert max(heights) == pytest.approx(25_000, abs=100)
    assert not peer.vehicle.pilot.armed


def test_intervals_by_command():
    peer = Peer()
    assert peer.result(511, 31, 20_000) == 0
    assert peer.command(510, 31)[1].interval_us == 20_000
    before = len(peer.told)
    peer.wait(1.0)
    assert sum(t.get_type() == "ATTITUDE_QUATERNION" for t in peer.told[before:]) in (50, 51)
    assert peer.result(511, 31, -1) == 0
    assert peer.command(510, 31)[1].interval_us == -1
    assert peer.command(510, 397)[1].interval_us == 0
    assert peer.result(511, 397, 1000) == 2
    assert peer.result(511, 31, NAN) == 2
    assert peer.result(511, 30, 1) == 0
    assert peer.command(510, 30)[1].interval_us == SHORTEST_US
    assert peer.result(511, 30, 9e9) == 0
    assert peer.command(510, 30)[1].interval_us == LONGEST_US
    assert peer.result(511, 30, 0) == 0
    assert peer.command(510, 30)[1].interval_us == 100_000


def test_after_a_late_message_the_next_is_on_time():
    schedule = Schedule({30: 10.0})
    schedule.due(0)
    assert (schedule.due(130_000), schedule.next_us) == ([30], 200_000)


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_mode_numbers_are_those_of_pymavlink(autopilot):
    from pymavlink import mavutil

    names = {Mode.HOLD: "LOITER", Mode.MISSION: "MISSION", Mode.RTL: "RTL", Mode.LAND: "LAND"}
    if autopilot is ARDUPILOT:
        acm = mavutil.mode_mapping_byname(m.MAV_TYPE_QUADROTOR)
        expected = {mode: acm["AUTO" if name == "MISSION" else name] for mode, name in names.items()}
    else:
        expected = {mode: (sub << 24 | main << 16) for mode, (_, main, sub) in
                    ((mode, mavutil.px4_map[name]) for mode, name in names.items())}  # fmt: skip
    assert {mode: autopilot.for_vehicle("multirotor").mavlink.modes[mode] for mode in expected} == expected


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@given(st.sampled_from(sorted(HANDLERS)), st.lists(st.floats(width=32), min_size=7, max_size=7))
@sweep(few=80, many=400)
def test_any_parameters_of_any_command_are_answered(autopilot, number, params):
    peer = Peer(autopilot)
    answers = peer.command(number, *params)
    assert sum(a.get_type() == "COMMAND_ACK" for a in answers) == 1


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("interval_us", [-1.0, 1e9])
def test_no_interval_silences_the_heartbeat(autopilot, interval_us):
    peer = Peer(autopilot)
    assert peer.result(511, m.MAVLINK_MSG_ID_HEARTBEAT, interval_us) == m.MAV_RESULT_DENIED
    assert peer.result(511, m.MAVLINK_MSG_ID_HEARTBEAT, 500_000) == m.MAV_RESULT_ACCEPTED
    peer.result(511, m.MAVLINK_MSG_ID_HEARTBEAT, interval_us)
    peer.told.clear()
    peer.wait(5.0)
    assert sum(one.get_type() == "HEARTBEAT" for one in peer.told) >= 9
