"""The conformance kit: our autopilots pass, broken ones fail where they are broken."""

import json
import socket
import threading

import pytest

from mission.errors import LinkError
from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint, Mission, MissionItem
from mission.transfer import RemoteTransferError, compare_plans
from mission.transfer.driver import TransferDriver
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import Simulation
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.check import Verdict, all_checks, check_vehicle
from wbf_mission.addons.check.peer import CheckError
from wbf_mission.cli.app import main

HOME = GeoPoint(28.05, -82.15, 20.0)


def run(*faults, autopilot="px4", vehicle=None, **options):
    """Check a vehicle on the virtual clock."""
    vehicle = vehicle or SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot(autopilot))
    link = Simulation([vehicle], faults=faults).open_link()
    return check_vehicle(link, clock=link.clock, wait=link.wait, **options)


def failed(report, *, required=True):
    return {
        result.check.id
        for result in report.results
        if result.verdict is Verdict.FAILED and (result.required or not required)
    }


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_our_autopilots_hold_everything_that_is_required(autopilot):
    report = run(autopilot=autopilot, fly=True)
    assert failed(report) == set(), [r.detail for r in report.results if r.bad]
    assert report.passed
    assert len(report.results) == len(all_checks())
    assert report.result("fly.mission").verdict is Verdict.PASSED


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_nothing_is_armed_and_the_plans_come_back(autopilot):
    vehicle = SimVehicle(get_vehicle("quad"), HOME, autopilot=get_autopilot(autopilot))
    simulation = Simulation([vehicle])
    link = simulation.open_link()
    items = tuple(MissionItem.waypoint(28.05 + 1e-5 * k, -82.15, 9.0) for k in range(6))
    driver = TransferDriver(MavlinkEndpoint(link, 255, 190), clock=link.clock, wait=link.wait)
    driver.upload(Mission(items, home=HOME))
    report = check_vehicle(link, clock=link.clock, wait=link.wait)
    assert report.passed
    assert not any(result.check.flies for result in report.results)
    assert not vehicle.pilot.armed
    assert (
        compare_plans(
            items, driver.download()[0].items, get_autopilot(autopilot).for_vehicle("multirotor").profile
        )
        == ()
    )


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("drop=COMMAND_ACK,direction=down", {"command.unknown-long", "command.unknown-int"}),
        ("drop=TIMESYNC", {"telemetry.timesync"}),
        ("drop=AUTOPILOT_VERSION", {"identity.version", "identity.capabilities"}),
        ("drop=PARAM_SET,direction=up", {"param.set"}),
        ("drop=PARAM_REQUEST_LIST,direction=up", {"param.list"}),
        ("drop=HOME_POSITION", {"telemetry.home"}),
        ("drop=MISSION_CURRENT", {"telemetry.mission-current", "mission.set-current"}),
        ("no-final-ack", {"mission.clear", "transfer.final-ack"}),
        ("no-count", {"mission.one-item", "transfer.asks-first", "transfer.cancel"}),
        ("no-list", {"mission.one-item", "mission.clear"}),
        ("wrong-sequence=2", {"mission.ten-items", "transfer.final-ack"}),
        ("early-final-ack=2", {"mission.ten-items"}),
    ],
)
def test_a_broken_vehicle_fails_where_it_is_broken(fault, expected):
    report = run(fault, only=sorted({"identity.heartbeat", *expected}))
    assert not report.passed
    assert failed(report) == expected


def test_a_vehicle_that_falls_silent_fails_in_all_that_comes_after():
    expected = {"identity.version", "mission.one-item", "param.list"}
    report = run("silence,from=8", only=("identity", "command", "telemetry", "param", "mission", "transfer"))
    assert not report.passed
    assert expected <= failed(report)


class Careless(SimVehicle):
    """Arms whatever it is asked, says hello too seldom, takes any command."""

    def receive(self, message, now_s):
        if type(message).id == m.MAVLINK_MSG_ID_COMMAND_LONG:
            if message.command == 400:
                message.param1 = 1.0
            if message.command == 31999:
                return [m.MAVLink_command_ack_message(31999, 0, 0, 0, 255, 190)]
        return super().receive(message, now_s)

    def poll(self, now_s):
        return [x for x in super().poll(now_s) if type(x).id != 0 or int(now_s) % 3 == 0]


def test_a_careless_vehicle_is_found_out():
    report = run(vehicle=Careless(get_vehicle("quad"), HOME), only=("identity", "command"))
    assert {
        "identity.heartbeat",
        "command.unknown-long",
        "command.bad-arming",
        "command.foreign-system",
    } - failed(report) <= {"command.foreign-system"}


def test_an_armed_vehicle_is_left_alone():
    vehicle = SimVehicle(get_vehicle("quad"), HOME)
    vehicle.pilot.arm()
    with pytest.raises(CheckError, match="armed"):
        run(vehicle=vehicle)


def test_only_some_checks():
    report = run(only=("identity", "param.list"))
    assert {r.check.group for r in report.results} == {"identity", "param"}
    with pytest.raises(CheckError, match="unknown check 'nonsense'"):
        run(only=("nonsense",))
    with pytest.raises(CheckError, match="was not run"):
        report.result("mission.clear")


def test_a_silent_link_is_an_error():
    with pytest.raises(RemoteTransferError, match="no vehicle"):
        run("silence", wait_s=3.0)
    with pytest.raises(LinkError):
        check_vehicle("carrier-pigeon:1")


class Serving:
    """A vehicle on a TCP port."""

    def __init__(self, *faults, speed):
        vehicle = SimVehicle(get_vehicle("quad"), HOME)
        self.server = Server([vehicle], ["tcpin:127.0.0.1:0"], speed=speed, faults=faults)
        self.thread = threading.Thread(target=self.server.run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self.server.urls[0].replace("tcpin", "tcp")

    def __exit__(self, *_):
        self.server.stop()
        self.thread.join(30.0)
        self.server.close()


def test_the_command_over_a_socket(pace, capsys):
    with Serving(speed=4.0 * pace) as url:
        assert main(["check", url, "--only", "param.set", "--only", "transfer.cancel", "--json", "-q"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["passed"] and values["autopilot"] == "PX4"
    assert {check["result"] for check in values["checks"]} == {"passed"}


def test_the_command_fails_with_code_1_and_a_table(pace, capsys):
    with Serving("drop=TIMESYNC", speed=4.0 * pace) as url:
        assert main(["check", url, "--only", "telemetry.timesync"]) == 1
    captured = capsys.readouterr()
    assert "FAILS" in captured.out and "telemetry.timesync" in captured.out
    assert "failed  telemetry.timesync: no answer" in captured.err


def test_the_list(capsys):
    assert main(["check", "--list", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == len(all_checks())


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["check"], 2, "udpin:127.0.0.1:14550"),
        (["check", "nonsense"], 2, "not a link address"),
        (["check", "tcp:127.0.0.1:1"], 3, "refused"),
        (["check", "udpin:127.0.0.1:0", "--only", "everything"], 2, "unknown check"),
        (["check", "udpin:127.0.0.1:0", "--wait", "0.2"], 3, "no vehicle"),
        (["check", "udpin:127.0.0.1:0", "--wait", "x"], 2, "--wait"),
        (["check", "serial:/dev/none:57600"], 2, "cannot be opened"),
    ],
)
def test_bad_input_and_no_vehicle_are_one_line_and_a_code_each(arguments, code, text, capsys):
    assert main(arguments) == code
    error = capsys.readouterr().err.strip()
    assert text in error
    assert error.splitlines()[-1].startswith("error: ")


@pytest.mark.slow
def test_mavsdks_server_plugins_hold_what_they_have():
    from mavsdk import ComponentType, Configuration, Mavsdk
    from mavsdk.plugins.mission_raw_server import MissionRawServer
    from mavsdk.plugins.param_server import ParamServer

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    autopilot = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
    component = autopilot.server_component()
    missions, parameters = MissionRawServer(component), ParamServer(component)
    missions.subscribe_incoming_mission(lambda *_: None)
    missions.subscribe_clear_all(lambda *_: None)
    parameters.provide_param_float("MIS_TAKEOFF_ALT", 5.0)
    autopilot.add_any_connection(f"udpout://127.0.0.1:{port}")
    groups = ("identity", "param", "mission.ten-items", "mission.clear", "transfer.final-ack")
    report = check_vehicle(f"udpin:127.0.0.1:{port}", only=groups)
    autopilot.destroy()
    assert failed(report) == {"identity.heartbeat-fields", "identity.capabilities"}
