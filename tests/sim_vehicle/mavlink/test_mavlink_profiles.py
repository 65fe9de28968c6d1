"""What tells a PX4 from an ArduPilot, as peers see it: transfers, acknowledgements, streams, signing."""

import math
import struct
import time

import pytest
from processes import wait_until

from mission.link import FrameReader, FrameWriter
from mission.link.address import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.signing import Signing
from mission.link.opening import open_link
from mission.model import Command, Frame, Mission, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot.ardupilot import ARDUPILOT
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from tests.support.peer import HOME, Peer, running

BOTH = pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
TAKEOFF = MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, x=28.05, y=-82.15, z=5.0)
THERE = MissionItem.waypoint(28.0502, -82.15, 5.0)
BACK = MissionItem(Command.NAV_RETURN_TO_LAUNCH)
SURVEY = (TAKEOFF, THERE, BACK)
KEY = b"k" * 32


def start(peer):
    peer.upload(tuple(map(_plain, SURVEY)))
    assert peer.result(400, 1.0) == 0
    assert peer.result(300) == 0


def _plain(item):
    """NaN as ArduPilot wants it."""
    return MissionItem(item.command, item.frame, 0.0, 0.0, 0.0, 0.0, item.x, item.y, item.z)


def test_plans_have_ids_on_px4():
    peer = Peer(PX4)
    assert peer.asked(42).mission_id == 0
    ack = peer.upload(SURVEY)
    rally = peer.upload((MissionItem(Command.NAV_RALLY_POINT, 3, x=28.05, y=-82.15, z=9.0),), kind=2)
    current = peer.asked(42)
    assert ack.opaque_id == current.mission_id != 0
    assert rally.opaque_id == current.rally_points_id != ack.opaque_id
    assert current.fence_id == 0
    changed = peer.upload((TAKEOFF, BACK))
    assert peer.asked(42).mission_id == changed.opaque_id != ack.opaque_id
    peer.tell(m.MAVLink_mission_clear_all_message(1, 1, 255))
    current = peer.asked(42)
    assert (current.mission_id, current.rally_points_id, current.total) == (0, 0, 65535)


def test_plans_have_no_ids_on_ardupilot():
    peer = Peer(ARDUPILOT)
    assert peer.upload(tuple(map(_plain, SURVEY))).opaque_id == 0
    current = peer.asked(42)
    assert (current.mission_id, current.total) == (0, 3)
    assert "Flight plan received" in peer.texts()
    peer.tell(m.MAVLink_mission_clear_all_message(1, 1, 0))
    assert peer.asked(42).total == 0


def test_mavsdk_notices_a_new_plan():
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.plugins.mission_raw import MissionRaw

    with running(Server([SimVehicle(get_vehicle("quad"), HOME)], ["tcpin:127.0.0.1:0"])) as server:
        port = server.urls[0].rsplit(":", 1)[1]
        sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        assert sdk.add_any_connection(f"tcpout://127.0.0.1:{port}") == 0
        changes = []
        mission = MissionRaw(sdk.first_autopilot(5.0))
        handle = mission.subscribe_mission_changed(lambda *_: changes.append(1))
        time.sleep(1.2)  # let it see the id of the plan before
        with TransferDriver(MavlinkEndpoint(open_link(f"tcp:127.0.0.1:{port}"), 245, 190)) as driver:
            driver.wait_for_vehicle(5.0)
            driver.upload(Mission(SURVEY), types=[MissionType.MISSION])
        wait_until(lambda: changes, "MAVSDK did not notice")
        # Before its owner: a callback that is under way then aborts the process.
        mission.unsubscribe_mission_changed(handle)
        mission.destroy()
        sdk.destroy()


def test_px4_repeats_what_was_reached_and_reports_the_return_instead_of_the_last_place():
    peer = Peer(PX4)
    start(peer)
    peer.wait(120.0)
    seqs = [message.seq for message in peer.of("MISSION_ITEM_REACHED")]
    assert sorted(set(seqs)) == [0, 2]
    assert seqs.count(2) == 11
    last = peer.of("MISSION_CURRENT")[-1]
    assert (last.seq, last.mission_state) == (2, 5), "the return, also when it has disarmed"


@BOTH
def test_the_next_item_is_told_a_moment_after_the_last_was_reached(autopilot):
    peer = Peer(autopilot)
    start(peer)
    peer.wait(12.0)
    shown = list(zip(peer.times, peer.told, strict=True))
    first = autopilot is ARDUPILOT
    reached_s = next(t for t, message in shown if message.get_type() == "MISSION_ITEM_REACHED")
    next_s = next(t for t, message in shown if message.get_type() == "MISSION_CURRENT" and
                  message.seq == 1 + first and t >= reached_s)  # fmt: skip
    assert 0.0 < next_s - reached_s <= 0.2


def test_ardupilot_streams_nothing_unasked():
    peer = Peer(ARDUPILOT)
    peer.wait(5.0)
    assert {message.get_type() for message in peer.told} <= {"HEARTBEAT", "STATUSTEXT"}
    peer.tell(m.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    before = len(peer.told)
    peer.wait(1.0)
    kinds = [message.get_type() for message in peer.told[before:]]
    for kind in (
        "GLOBAL_POSITION_INT",
        "ATTITUDE",
        "SYS_STATUS",
        "MISSION_CURRENT",
        "RC_CHANNELS",
        "VIBRATION",
    ):
        assert kinds.count(kind) in (4, 5), kind
    peer.tell(m.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
    before = len(peer.told)
    peer.wait(2.0)
    assert {message.get_type() for message in peer.told[before:]} == {"HEARTBEAT"}


def test_px4_stores_what_makes_no_sense_and_does_not_fly_it():
    peer = Peer(PX4)
    peer.tell(m.MAVLink_mission_count_message(1, 1, 2, 0))
    peer.tell(wire.item_to_message(TAKEOFF, 0, MissionType.MISSION, (1, 1)))
    message = wire.item_to_message(THERE, 1, MissionType.MISSION, (1, 1))
    message.x = 950_000_000
    assert [a.type for a in peer.tell(message) if a.get_type() == "MISSION_ACK"] == [0]
    assert "Mission rejected: item 2 is invalid" in peer.texts()
    assert peer.asked(42).mission_state == m.MISSION_STATE_NO_MISSION
    assert peer.result(300) == 1
    peer.tell(m.MAVLink_mission_request_list_message(1, 1, 0))
    peer.tell(m.MAVLink_mission_request_int_message(1, 1, 0, 0))
    assert peer.tell(m.MAVLink_mission_request_int_message(1, 1, 1, 0))[0].x == 950_000_000


@BOTH
def test_orders_to_a_vehicle_that_is_not_armed(autopilot):
    peer = Peer(autopilot)
    missing = peer.result(300)
    assert missing == (1 if autopilot is PX4 else 4)
    name = "Switching to Mission is" if autopilot is PX4 else "Mode change to AUTO failed"
    assert any(name in text for text in peer.texts())
    peer.upload(tuple(map(_plain, SURVEY)))
    assert peer.result(300) == 0
    assert peer.vehicle.pilot.mode is Mode.MISSION
    peer.wait(5.0)
    assert (peer.vehicle.pilot.state.position_m[2] > 1.0) is (autopilot is PX4)
    peer = Peer(autopilot)
    if autopilot is ARDUPILOT:
        peer.result(176, 1.0, 4.0)
    assert peer.result(22, 0, 0, 0, 0, 0, 0, 30.0) == (0 if autopilot is PX4 else 4)
    peer.wait(5.0)
    assert peer.vehicle.pilot.state.position_m[2] == 0.0


@BOTH
def test_refusals_have_the_autopilots_result_and_a_reason(autopilot):
    peer = Peer(autopilot)
    peer.vehicle.pilot.arming.block = "test"
    assert peer.result(400, 1.0) == (1 if autopilot is PX4 else 4)
    assert any("test" in text for text in peer.texts())
    assert peer.result(224, 9.0) == (3 if autopilot is PX4 else 2)
    assert peer.result(31010) == 3
    assert peer.result(521) == 3
    assert not any("USER_1" in text or "521" in text for text in peer.texts())


def test_ardupilot_takes_places_as_integers_only():
    peer = Peer(ARDUPILOT)
    assert peer.result(192, -1.0, 1.0, 0.0, 0.0, 28.05, -82.15, 10.0) == m.MAV_RESULT_COMMAND_INT_ONLY
    assert not peer.texts()


@BOTH
def test_the_protocol_version(autopilot):
    peer = Peer(autopilot)
    for answers in (peer.command(512, 300), peer.command(519, 1)):
        assert [a.get_type() for a in answers] == ["COMMAND_ACK", "PROTOCOL_VERSION"]
        assert (answers[1].version, answers[1].min_version, answers[1].max_version) == (200, 100, 200)
    assert peer.result(512, 397) == (0 if autopilot is PX4 else 4)


@BOTH
def test_modes_and_their_monitor(autopilot):
    peer = Peer(autopilot)
    modes = autopilot.for_vehicle("multirotor").mavlink.modes
    assert peer.asked(436).custom_mode == modes[modes.boot]
    assert peer.asked(437).get_type() == "AVAILABLE_MODES_MONITOR"
    assert peer.result(512, 435, 99) == 2
    assert peer.asked(244, 0).interval_us == 1_000_000


def test_sensors_at_rest_tell_what_they_would_at_rest():
    peer = Peer(PX4, yaw_deg=90.0)
    imu = peer.asked(105)
    assert (imu.xacc, imu.yacc, imu.zacc) == pytest.approx((0.0, 0.0, -9.80665), abs=1e-3)
    assert (imu.xmag, imu.ymag, imu.zmag) == pytest.approx((0.0, -0.25, 0.41), abs=1e-6)
    pressure = peer.asked(29).press_abs
    assert pressure == pytest.approx(1013.25 - 20.0 / 8.33, abs=0.2)
    assert imu.abs_pressure == pytest.approx(pressure)
    assert peer.asked(230).flags & 16
    assert peer.asked(193).flags == peer.asked(230).flags
    assert peer.asked(241).clipping_0 == 0
    assert peer.asked(65).chancount == 0
    assert peer.asked(49).latitude == 280500000
    peer.vehicle.pilot.position_ok = False
    assert not peer.asked(230).flags & 16


def test_px4_has_a_checksum_of_its_parameters():
    peer = Peer(PX4)

    def checksum():
        (value,) = peer.tell(m.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1))
        assert (value.param_id, value.param_type, value.param_index) == ("_HASH_CHECK", 5, 65535)
        return struct.pack("<f", value.param_value)

    before = checksum()
    assert checksum() == before
    peer.tell(m.MAVLink_param_set_message(1, 1, b"MPC_XY_CRUISE", 4.0, 9))
    assert checksum() != before
    peer.tell(m.MAVLink_param_request_list_message(1, 1))
    peer.wait(2.0)
    assert peer.of("PARAM_VALUE")[-1].param_id == "_HASH_CHECK", "it ends the list"
    peer.tell(m.MAVLink_param_request_list_message(1, 1))
    assert peer.tell(m.MAVLink_param_set_message(1, 1, b"_HASH_CHECK", 0.0, 5)) == []
    number = len(peer.of("PARAM_VALUE"))
    peer.wait(2.0)
    assert len(peer.of("PARAM_VALUE")) == number, "a client that has all values stops the list"


def test_ardupilot_says_why_a_parameter_is_neither_read_nor_set():
    peer = Peer(ARDUPILOT)
    read, put = m.MAVLink_param_request_read_message, m.MAVLink_param_set_message
    for message, index, error in (
        (read(1, 1, b"_HASH_CHECK", -1), -1, m.MAV_PARAM_ERROR_DOES_NOT_EXIST),
        (read(1, 1, b"", 9999), 9999, m.MAV_PARAM_ERROR_DOES_NOT_EXIST),
        (put(1, 1, b"XYZ", 1.0, 9), -1, m.MAV_PARAM_ERROR_DOES_NOT_EXIST),
        (put(1, 1, b"FENCE_RADIUS", math.nan, 9), -1, m.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
    ):
        (answer,) = peer.tell(message)
        assert (answer.param_id, answer.param_index, answer.error) == (str(message.param_id), index, error)
        assert (answer.target_system, answer.target_component) == (255, 190)
    assert Peer(PX4).tell(read(1, 1, b"XYZ", -1)) == []


def test_ardupilot_counts_its_plans_in_parameters():
    peer = Peer(ARDUPILOT)

    def total(name):
        return peer.tell(m.MAVLink_param_request_read_message(1, 1, name, -1))[0].param_value

    assert (total(b"MIS_TOTAL"), total(b"RALLY_TOTAL")) == (1, 0)
    peer.upload(tuple(map(_plain, SURVEY)))
    peer.upload((MissionItem(Command.NAV_RALLY_POINT, 3, x=28.05, y=-82.15, z=9.0),), kind=2)
    assert (total(b"MIS_TOTAL"), total(b"RALLY_TOTAL"), total(b"FENCE_TOTAL")) == (4, 1, 0)
    peer.tell(m.MAVLink_param_set_message(1, 1, b"MIS_TOTAL", 0.0, 6))
    assert total(b"MIS_TOTAL") == 4


def signed_hosts(signing):
    vehicle = SimVehicle(get_vehicle("quad"), HOME, signing=signing)
    taps = []
    simulation = Simulation([vehicle], signing=signing, tap=lambda frame, _: taps.append(frame))
    link = simulation.open_link()
    return vehicle, simulation, link, taps


ARM = m.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def test_a_host_with_a_key_hears_only_who_has_it():
    vehicle, simulation, link, _ = signed_hosts(Signing(KEY))
    simulation.run(limit_s=1.0)
    assert all(frame[2] == 1 for frame in link.receive())
    for signing, armed in ((None, False), (Signing(b"o" * 32), False), (Signing(KEY), True)):
        link.send(FrameWriter(255, 190, signing=signing).encode(ARM))
        simulation.run(limit_s=0.1)
        assert vehicle.pilot.armed is armed


def test_a_key_is_set_where_it_may_and_never_logged():
    setup = FrameWriter(255, 190).encode(m.MAVLink_setup_signing_message(1, 1, list(KEY), 0))
    for signing, taken in ((Signing(may_setup=True), True), (Signing(), False), (None, False)):
        vehicle, simulation, link, taps = signed_hosts(signing)
        other = simulation.open_link("other")
        simulation.run(limit_s=0.5)
        other.receive()
        link.send(setup)
        simulation.run(limit_s=0.5)
        assert (signing is not None and signing.active) is taken
        frames = [*taps, *other.receive()]
        assert frames
        assert not any(KEY in frame for frame in frames)
        texts = [t.text for f in frames for t in FrameReader(wanted=[253]).feed(f)]
        assert ("Signing setup refused: not over this link" in texts) is not taken
        assert not vehicle.pilot.armed


def test_a_key_is_not_changed_in_flight_nor_for_everybody():
    signing = Signing(may_setup=True)
    peer = Peer(PX4, signing=signing)
    peer.result(400, 1.0)
    peer.tell(m.MAVLink_setup_signing_message(1, 1, list(KEY), 0))
    assert not signing.active
    assert "Signing setup refused: armed" in peer.texts()
    peer.result(400, 0.0)
    peer.tell(m.MAVLink_setup_signing_message(0, 0, list(KEY), 0))
    assert not signing.active
    peer.tell(m.MAVLink_setup_signing_message(1, 1, list(KEY), 0))
    assert signing.active


def test_the_nan_of_a_yaw_is_kept_by_px4_only():
    for autopilot, kept in ((PX4, True), (ARDUPILOT, False)):
        peer = Peer(autopilot)
        peer.upload((TAKEOFF, THERE, BACK))
        peer.tell(m.MAVLink_mission_request_list_message(1, 1, 0))
        place = 1 + (autopilot is ARDUPILOT)
        for seq in range(place + 1):
            item = peer.tell(m.MAVLink_mission_request_int_message(1, 1, seq, 0))[0]
        assert math.isnan(item.param4) is kept
        assert item.frame == (6 if autopilot is PX4 else 3)


def rates_of(vehicle, link="", seconds=20):
    """How often a vehicle sends what it sends unasked, on a link."""
    counts = {}
    vehicle.open_links(frozenset({link} - {""}))
    while (now_s := vehicle.next_deadline()) < seconds:
        polled = vehicle.poll(now_s)
        streamed = dict(vehicle.streamed()) if link else {link: polled}
        for message in streamed.get(link, []):
            counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
    return {name: count / seconds for name, count in counts.items()}


@pytest.mark.parametrize(
    ("link", "expected", "absent"),
    [
        (
            "",
            {"ATTITUDE": 100, "GLOBAL_POSITION_INT": 50, "ODOMETRY": 30, "HIGHRES_IMU": 50, "TIMESYNC": 10},
            {"DISTANCE_SENSOR", "RC_CHANNELS"},
        ),
        (
            "ground",
            {
                "ATTITUDE": 50,
                "GLOBAL_POSITION_INT": 50,
                "SERVO_OUTPUT_RAW": 50,
                "VFR_HUD": 4,
                "VIBRATION": 0.1,
            },
            {"HIGHRES_IMU", "ODOMETRY", "TIMESYNC", "SYSTEM_TIME"},
        ),
        # 4000 bytes a second carry about a sixth of what an onboard link has.
        ("payload", {"HEARTBEAT": 1, "GPS_RAW_INT": 8, "ATTITUDE": 15.8, "ODOMETRY": 4.75}, set()),
        ("gimbal", {"HEARTBEAT": 1, "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE": 20}, {"ATTITUDE"}),
    ],
)
def test_px4_streams_what_its_simulator_does(link, expected, absent):
    rates = rates_of(SimVehicle(get_vehicle("quad"), HOME, sitl_rates=True), link)
    assert {name: rates.get(name) for name in expected} == pytest.approx(expected, rel=0.05, abs=0.06)
    assert not absent & rates.keys()
    size = {kind.msgname: kind.unpacker.size + 12 for kind in m.mavlink_map.values()}
    if link == "payload":
        assert sum(size[name] * rate for name, rate in rates.items()) == pytest.approx(4000, rel=0.15)


@pytest.mark.parametrize(("kind", "hz"), [("quad", None), ("fixed-wing", 1.0), ("rover", 1.0)])
def test_ardupilot_streams_what_its_simulator_does(kind, hz):
    vehicle = SimVehicle(get_vehicle(kind), HOME, autopilot=ARDUPILOT, sitl_rates=True)
    rates = rates_of(vehicle)
    told = ("ATTITUDE", "GLOBAL_POSITION_INT", "VFR_HUD", "SYS_STATUS", "RAW_IMU", "SERVO_OUTPUT_RAW")
    assert [rates.get(name) for name in told] == [hz] * len(told)
    assert rates["HEARTBEAT"] == 1.0


def home_at(peer, altitude, frame, x=28.0501, y=-82.1499):
    numbers = (round(x * 1e7), round(y * 1e7), altitude)
    message = m.MAVLink_command_int_message(1, 1, frame, 179, 0, 0, *[0.0] * 4, *numbers)
    return next(answer.result for answer in peer.tell(message) if answer.get_type() == "COMMAND_ACK")


@BOTH
@pytest.mark.parametrize(("frame", "expected"), [(0, 35_000), (3, 55_000)], ids=["sea", "home"])
def test_home_takes_its_own_altitude(autopilot, frame, expected):
    peer = Peer(autopilot)
    if autopilot is PX4:
        expected = 35_000  # whatever the frame says
    assert home_at(peer, 35.0, frame) == 0
    told = peer.of("HOME_POSITION")[-1]
    assert (told.latitude, told.longitude, told.altitude) == (280_501_000, -821_499_000, expected)
    up_mm = expected - 20_000
    assert peer.asked(33).relative_alt == -up_mm, "it stands below home"
    assert peer.asked(33).alt == 20_000
    altitude = peer.asked(141)
    assert (altitude.altitude_local, altitude.altitude_relative) == (0.0, -up_mm / 1000.0)
    assert peer.asked(49).altitude == 20_000, "the origin stays"


@BOTH
def test_altitudes_above_a_home_that_moved_count_from_there(autopilot):
    peer = Peer(autopilot)
    assert home_at(peer, 25.0, 0) == 0
    # 10 m above home are 15 m above the ground.
    items = (TAKEOFF, MissionItem.waypoint(28.0502, -82.15, 10.0), BACK)
    peer.upload(tuple(_plain(item) for item in items))
    assert peer.result(400, 1.0) == 0
    assert peer.result(300) == 0
    heights = []
    while peer.vehicle.pilot.mission.current_seq < 2 and peer.now_s < 90.0:
        peer.wait(1.0)
        heights.append(peer.vehicle.pilot.state.position_m[2])
    assert heights[-1] == pytest.approx(15.0, abs=0.7)
    top = 0.0
    while not peer.vehicle.finished and peer.now_s < 400.0:
        peer.wait(1.0)
        top = max(top, peer.vehicle.pilot.state.position_m[2])
    name, scale = ("RTL_RETURN_ALT", 1.0) if autopilot is PX4 else ("RTL_ALT", 0.01)
    return_m = peer.vehicle._parameters.value(name) * scale
    assert top == pytest.approx(max(return_m + 5.0, 15.0), abs=1.0)
    x, y, z = peer.vehicle.pilot.state.position_m
    assert math.hypot(x - 9.8, y - 11.1) < 2.5
    assert z == pytest.approx(0.0, abs=0.1)


@BOTH
def test_a_home_without_an_altitude_is_refused(autopilot):
    peer = Peer(autopilot)
    assert home_at(peer, math.nan, 0) == 2
    assert home_at(peer, 1e9, 0) == 2
    here = home_at(peer, 33.0, 0, 0.0, 0.0)
    assert here == (2 if autopilot is PX4 else 0), "ArduPilot takes zeros for here"
    assert peer.asked(242).altitude == 20_000
