"""Faults on demand: their text, what each of them does, when."""

from dataclasses import astuple

import numpy as np
import pytest
from bad_files import complaint
from hypothesis import given
from hypothesis import strategies as st

from mission.errors import LinkError
from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.link.faults import Faults, FaultyChannel
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem
from mission.transfer import RemoteTransferError
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.faults.fault import KINDS, Fault, FaultError, load_faults, parse_fault
from wbf_mission.addons.faults.session import FaultSession, FaultyComponent

HOME = GeoPoint(28.05, -82.15, 20.0)
RELATIVE = Frame.GLOBAL_RELATIVE_ALT
ITEMS = (
    MissionItem(Command.NAV_TAKEOFF, RELATIVE, x=28.05, y=-82.15, z=10.0),
    MissionItem.waypoint(28.0502, -82.15, 10.0),
    MissionItem.waypoint(28.0502, -82.1498, 10.0),
    MissionItem(Command.NAV_RETURN_TO_LAUNCH),
)


def simulate(*faults, seed=0, **options):
    """A vehicle with faults, a link to it on the virtual clock and a driver of transfers."""
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    simulation = Simulation([vehicle], faults=faults, seed=seed, **options)
    link = simulation.open_link("radio")
    driver = TransferDriver(MavlinkEndpoint(link, 255, 190), clock=link.clock, wait=link.wait)
    return vehicle, link, driver


def fly(vehicle, link, driver):
    """Upload, arm, start, and wait until it is over."""
    driver.upload(Mission(ITEMS, home=HOME))
    for command, first in ((m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0), (m.MAV_CMD_MISSION_START, 0.0)):
        driver.endpoint.send(m.MAVLink_command_long_message(1, 1, command, 0, first, *[0.0] * 6))
    for _ in range(300):
        link.sleep(1.0)
        if vehicle.finished:
            break


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("loss=0.25", Fault("loss", 0.25)),
        ("bandwidth", Fault("bandwidth", 57600.0)),
        ("link-loss,at=armed,from=5,for=10", Fault("link-loss", None, 5.0, 10.0, "armed")),
        ("drop=command_ack,direction=down,times=2", Fault("drop", 77.0, direction="down", times=2)),
        ("no-request,times=1", Fault("no-request", 0.0, times=1)),
        ("wrong-sequence=1,vehicle=3", Fault("wrong-sequence", 1.0, vehicle=3)),
        (" delay = 0.2 , link = 14550 ", Fault("delay", 0.2, link="14550")),
        ("gps-loss,at=item:2", Fault("gps-loss", trigger="item:2")),
        ("low-battery", Fault("low-battery", 0.1)),
        ("battery-change", Fault("battery-change", 20.0)),
        ("final-ack-error", Fault("final-ack-error", 1.0)),
    ],
)
def test_faults_are_read(text, fault):
    assert parse_fault(text) == fault
    assert parse_fault(str(fault)) == fault


@pytest.mark.parametrize(
    "text",
    [
        "", "meteor", "loss", "loss=two", "loss=1.5", "loss=nan", "loss=0.1,", "loss=0.1,0.2",
        "loss=0.1,from=-1", "loss=0.1,from=inf", "loss=0.1,for=0", "loss=0.1,at=noon",
        "loss=0.1,at=item:x", "loss=0.1,vehicle=0", "loss=0.1,vehicle=one", "loss=0.1,direction=left",
        "loss=0.1,times=2", "loss=0.1,start_s=2", "loss=0.1,kind=delay", "loss=0.1,for=2,for=3",
        "drop=NO_SUCH_MESSAGE", "no-request=0.5", "no-final-ack,times=0", "no-final-ack,link=1",
        "no-final-ack,direction=up", "gps-loss=1", "final-ack-error=0", "bandwidth=0",
    ],
)  # fmt: skip
def test_bad_faults_are_one_clear_line(text):
    with pytest.raises(FaultError) as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)
    assert "fault" in str(caught.value)


@given(st.text(max_size=60))
def test_any_text_is_a_fault_or_an_error(text):
    try:
        fault = parse_fault(text)
    except FaultError:
        return
    assert fault.kind in KINDS


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("[[fault]]\nkind = 'loss'", "fault 1"),
        ("[[fault]]\nkind = 'link-loss'\n[[fault]]\nkind = 'x'", "fault 2"),
        ("fault = 3", "[[fault]]"),
        ("fault = [1]", "[[fault]]"),
        ("[[fault]]\nkind = 'loss'\nvalue = true", "fault 1"),
        ("[[fault]]\nkind = 'loss'\nvalue = [1]", "fault 1"),
        ("[[fault]]\nkind = 'loss'\nvalue = 0.1\nfrom = 'x'", "fault 1"),
        ("[[fault", "not TOML"),
        (None, "no such file"),
    ],
)
def test_bad_files_name_the_file_and_the_fault(tmp_path, text, where):
    assert where in complaint(load_faults, tmp_path, text, FaultError)


def test_a_slow_line_takes_its_time_and_drops_what_does_not_fit():
    channel = FaultyChannel(Faults(baud=57600.0), np.random.default_rng(0))
    for _ in range(3):
        channel.send(bytes(576), 0.0)
    assert channel.next_arrival() == pytest.approx(0.1)
    assert len(channel.receive(0.2000001)) == 2
    for _ in range(100):
        channel.send(bytes(576), 1.0)
    arrived = channel.receive(100.0)
    assert 25 <= len(arrived) <= 31
    with pytest.raises(LinkError, match="baud"):
        Faults(baud=0.0)


def test_one_direction_only():
    vehicle, _, driver = simulate("link-loss,direction=up")
    driver.wait_for_vehicle(5.0)
    with pytest.raises(RemoteTransferError):
        driver.upload(Mission(ITEMS, home=HOME))
    assert vehicle.pilot.mission.size == 0


@pytest.mark.parametrize("link", ["radio", "1"])
def test_links_are_named_or_numbered(link):
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    simulation = Simulation([vehicle], faults=[f"link-loss,link={link}"])
    hit, other = simulation.open_link("radio"), simulation.open_link("cable")
    hit.sleep(3.0)
    assert hit.receive() == []
    assert other.receive()


def test_loss_delay_jitter_duplication_and_corruption_together_leave_a_plan_whole():
    for seed in range(3):
        vehicle, link, driver = simulate(
            "loss=0.1", "delay=0.05", "jitter=0.05", "duplicate=0.1", "corrupt=0.1", "bandwidth", seed=seed
        )
        driver.upload(Mission(ITEMS * 5, home=HOME))
        assert vehicle.pilot.mission.size == 20
        assert link.clock() > 1.0


@pytest.mark.parametrize("faults", [["bandwidth=9600"], ["bandwidth=9600", "bandwidth=57600"]])
def test_the_narrowest_bandwidth_counts(faults):
    _, link, _ = simulate(*faults)
    link.sleep(20.0)
    link.receive()
    link.sleep(20.0)
    got = sum(len(frame) for frame in link.receive())
    assert got <= 20.2 * 960


@pytest.mark.parametrize(
    "fault",
    [
        "no-list,times=1", "no-count,times=1", "no-request=0,times=1", "no-request=1,times=2",
        "no-final-ack,times=1", "wrong-sequence=0,times=1", "wrong-sequence=1,times=1",
        "drop=MISSION_ITEM_INT,times=3", "drop=51,times=2",
    ],
)  # fmt: skip
def test_what_happens_once_is_survived(fault):
    vehicle, _, driver = simulate(fault)
    driver.upload(Mission(ITEMS, home=HOME))
    assert driver.download()[0].items == driver.download()[0].items
    assert vehicle.pilot.mission.size == len(ITEMS)


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("no-count", "answer"),
        ("no-request=0", "answer"),
        ("no-request=1", "item|answer"),
        ("error-ack=0", "error"),
        ("error-ack=1", "error"),
        ("no-list", "not verified"),
        ("early-final-ack=1", "item|accepted|hold|answer"),
        ("silence", "no vehicle"),
    ],
)
def test_what_happens_always_is_a_clear_error(fault, text):
    _, _, driver = simulate(fault)
    with pytest.raises(RemoteTransferError, match=text):
        driver.upload(Mission(ITEMS, home=HOME))


@pytest.mark.parametrize("fault", ["no-final-ack", "final-ack-error=1"])
def test_a_wrong_final_ack_is_found_out_by_reading_back(fault):
    vehicle, _, driver = simulate(fault)
    driver.upload(Mission(ITEMS, home=HOME))
    assert vehicle.pilot.mission.size == len(ITEMS)


def test_triggers_start_windows():
    _, link, driver = simulate("silence,at=upload,from=5,for=10")
    driver.wait_for_vehicle()
    link.sleep(30.0)
    assert link.receive()
    driver.upload(Mission(ITEMS, home=HOME))
    link.sleep(6.0)
    link.receive()
    link.sleep(7.0)
    assert link.receive() == []
    link.sleep(5.0)
    assert link.receive()


def test_only_one_vehicle_of_two():
    pair = [SimVehicle(get_vehicle("quad"), HOME, system_id=system) for system in (1, 2)]
    simulation = Simulation(pair, faults=["silence,vehicle=2", "gps-loss,vehicle=1,from=2"])
    link = simulation.open_link()
    endpoint = MavlinkEndpoint(link, 255, 190)
    link.sleep(3.0)
    assert {message.get_srcSystem() for message in endpoint.receive()} == {1}
    assert [vehicle.pilot.position_ok for vehicle in pair] == [False, True]


def heard(endpoint, link, seconds):
    """What arrives in so many seconds."""
    link.sleep(seconds)
    return endpoint.receive()


def test_a_restarted_autopilot_begins_anew_and_flies_on():
    vehicle, link, driver = simulate("reboot,at=airborne,from=5")
    driver.endpoint.reader.wanted = None
    driver.upload(Mission(ITEMS, home=HOME))
    for command, first in ((m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0), (m.MAV_CMD_MISSION_START, 0.0)):
        driver.endpoint.send(m.MAVLink_command_long_message(1, 1, command, 0, first, *[0.0] * 6))
    told = heard(driver.endpoint, link, 20.0)
    times = [one.time_boot_ms for one in told if one.get_type() == "GLOBAL_POSITION_INT"]
    (jump,) = [k for k in range(1, len(times)) if times[k] < times[k - 1]]
    assert times[jump] < 500 < times[jump - 1]
    ids = [one.mission_id for one in told if one.get_type() == "MISSION_CURRENT"]
    assert ids[0] != 0 and ids[-1] == 0
    heard(driver.endpoint, link, 200.0)
    assert vehicle.outcome.value == "completed"


def test_a_restarted_autopilot_has_forgotten_the_transfer():
    _, link, driver = simulate("reboot,from=3")
    link.sleep(2.0)
    driver.endpoint.send(m.MAVLink_mission_count_message(1, 1, 3))
    assert heard(driver.endpoint, link, 0.9)
    driver.endpoint.reader.wanted = None
    heard(driver.endpoint, link, 0.2)
    told = {one.get_type() for one in heard(driver.endpoint, link, 4.0)}
    assert "HEARTBEAT" in told
    assert not told & {"MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"}


def test_commands_are_refused_while_the_fault_holds():
    _, link, driver = simulate("refuse=400,for=5")
    driver.endpoint.reader.wanted = None

    def result():
        driver.endpoint.receive()
        driver.endpoint.send(m.MAVLink_command_long_message(1, 1, 400, 0, 0.0, *[0.0] * 6))
        told = heard(driver.endpoint, link, 0.5)
        return [one.result for one in told if one.get_type() == "COMMAND_ACK"]

    assert result() == [m.MAV_RESULT_DENIED]
    link.sleep(6.0)
    assert result() == [m.MAV_RESULT_ACCEPTED]


def test_gps_loss_comes_and_goes():
    vehicle, link, driver = simulate("gps-loss,from=3,for=4")
    seen = []
    driver.endpoint.reader.wanted = None
    for _ in range(10):
        link.sleep(1.0)
        fixes = [x.fix_type for x in driver.endpoint.receive() if x.get_type() == "GPS_RAW_INT"]
        seen.append(min(fixes))
    assert seen[1] >= 3 and seen[4] <= 1 and seen[9] >= 3
    assert vehicle.pilot.position_ok


@pytest.mark.parametrize(
    ("fault", "outcome"),
    [
        ("motor-failure,at=airborne,from=5", "crashed"),
        ("dead-battery,at=item:1", "battery_depleted"),
    ],
)
def test_vehicles_break_in_flight(fault, outcome):
    vehicle, link, driver = simulate(fault)
    fly(vehicle, link, driver)
    assert vehicle.outcome.value == outcome


class Camera:
    """Takes a picture each second, and tells an old one again when it is polled for it."""

    system_id, component_id, wanted = 1, 100, None

    def __init__(self):
        self.due_s, self.index = 0.0, 0

    def picture(self, index):
        return [
            m.MAVLink_camera_image_captured_message(0, 0, 0, 0, 0, 0, 0, [1, 0, 0, 0], index, 1, b""),
            m.MAVLink_debug_float_array_message(index, b"LEAF", 0, [0.0] * 58),
        ]

    def receive(self, message, now_s):
        return self.picture(int(message.param2)) if message.get_type() == "COMMAND_LONG" else []

    def poll(self, now_s):
        self.due_s, self.index = now_s + 1.0, self.index + 1
        return self.picture(self.index - 1)

    def next_deadline(self):
        return self.due_s


def test_a_stuck_camera_takes_no_pictures_and_has_none_later():
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    simulation = Simulation([vehicle, Camera()], faults=["stuck-camera,from=2.5,for=3"])
    link = simulation.open_link()
    endpoint = MavlinkEndpoint(link, 255, 190, wanted={263, 350})
    link.sleep(9.5)
    heard = endpoint.receive()
    results = {x.image_index: x.capture_result for x in heard if x.get_type() == "CAMERA_IMAGE_CAPTURED"}
    assert results == {i: 0 if i in (3, 4, 5) else 1 for i in range(10)}
    assert [x.time_usec for x in heard if x.get_type() == "DEBUG_FLOAT_ARRAY"] == [0, 1, 2, 6, 7, 8, 9]
    for index in (4.0, 1.0):
        endpoint.send(m.MAVLink_command_long_message(1, 100, 512, 0, 263.0, index, 0, 0, 0, 0, 0))
    link.sleep(0.1)
    again = [(x.image_index, x.capture_result) for x in endpoint.receive() if type(x).id == 263]
    assert again == [(4, 0), (1, 1)]


def test_the_same_seed_gives_the_same_losses():
    def heard(seed):
        _, link, _ = simulate("loss=0.3", "jitter=0.2", "corrupt=0.1", seed=seed)
        link.sleep(20.0)
        return link.receive()

    assert heard(4) == heard(4)
    assert heard(4) != heard(5)


def test_a_session_combines_what_holds_at_once():
    session = FaultSession(["loss=0.5", "loss=0.5,from=10", "delay=0.1", "delay=0.2,from=10"])
    radio = session.radio("x", 1)
    assert radio is not None
    assert radio.faults_of("up", 1, 0.0) == Faults(loss=0.5, delay_s=0.1)
    later = radio.faults_of("up", 1, 10.0)
    assert (later.loss, later.delay_s) == (0.75, pytest.approx(0.3))
    poor = session.radio("x", 1, always=Faults(loss=0.5, duplicate=0.1, delay_s=0.2, jitter_s=0.3, baud=9.0))
    assert astuple(poor.faults_of("up", 1, 0.0)) == pytest.approx((0.75, 0.1, 0.0, 0.3, 0.3, 9.0))
    assert FaultSession(["loss=0.5,link=2"]).radio("x", 1) is None
    assert FaultSession(["loss=0.5,link=14550"]).radio("udpout:127.0.0.1:14550", 1) is not None
    assert FaultSession(["loss=0.5,link=14540"]).radio("udpout:127.0.0.1:14550", 14540) is None


@pytest.mark.parametrize("fault", ["loss=0.1,vehicle=9", "gps-loss,vehicle=2", "drop=HEARTBEAT,vehicle=3"])
def test_a_fault_of_a_vehicle_that_is_not_there_is_refused(fault):
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    with pytest.raises(FaultError, match=r"no vehicle \d; the systems are 1$"):
        Simulation([vehicle], faults=[fault])
    with pytest.raises(FaultError, match="no vehicle"):
        Server([vehicle], ["tcpin:127.0.0.1:0"], faults=[fault])


@pytest.mark.parametrize(
    ("fault", "states"),
    [
        ("gps-loss,from=2", [m.MAV_STATE_POWEROFF]),
        ("drop=HEARTBEAT,direction=down,from=2", []),
        ("silence,from=2", []),
        ("silence,from=0,for=1", [m.MAV_STATE_POWEROFF]),
    ],
)
def test_a_vehicle_with_faults_says_goodbye_unless_it_is_not_heard(fault, states):
    (faulty,) = FaultSession([fault]).wrap([SimVehicle(get_vehicle("quad"), HOME)])
    assert isinstance(faulty, FaultyComponent)
    for now_s in np.arange(0.0, 4.0, 0.5):
        faulty.poll(float(now_s))
    assert [message.system_status for message in faulty.goodbye()] == states


def test_a_battery_is_changed_after_a_landing_not_before():
    vehicle, link, driver = simulate("battery-change=10", "low-battery=0.6,from=1")
    assert vehicle.pilot.state.battery.fraction > 0.9
    link.sleep(3.0)
    assert vehicle.pilot.state.battery.fraction < 0.61
    vehicle.pilot.change_battery()
    assert vehicle.pilot.state.battery.fraction > 0.99
    vehicle.pilot.drain_battery(0.5)
    driver.endpoint.send(m.MAVLink_command_long_message(1, 1, 400, 0, 1.0, *[0.0] * 6))
    heard(driver.endpoint, link, 2.0)
    assert vehicle.pilot.armed
    vehicle.pilot.change_battery()
    assert vehicle.pilot.state.battery.fraction < 0.5, "nobody changes it while the motors run"
    link.sleep(15.0)  # PX4 stops motors that idle
    assert not vehicle.pilot.armed and vehicle.pilot.state.battery.fraction < 0.5
    link.sleep(10.0)
    assert vehicle.pilot.state.battery.fraction > 0.98
