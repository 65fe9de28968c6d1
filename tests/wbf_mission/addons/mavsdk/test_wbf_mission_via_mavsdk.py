"""MAVSDK as a second way to a vehicle: the same plans, the same flights, the same results as our own way."""

import contextlib
import os
import pty
import subprocess
import sys
import time
import tty
from dataclasses import replace

import numpy as np
import pytest
import shapely
from processes import environment
from stand_in import LONG_S, Watcher, scenario, stand_in

from mission.errors import LinkError
from mission.ground.link import download, find_vehicles, upload
from mission.ground.modes import Maneuver, VehicleModes, mode_name
from mission.link.address import parse_link_url
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, Frame, Mission, MissionItem
from mission.outcome import Outcome
from mission.transfer.events import NoVehicleError, RemoteTransferError
from wbf_mission.addons.base.links import LiveFlightError, via_named
from wbf_mission.addons.operate.link import LiveLink
from wbf_mission.exit_codes import ExitCode, exit_code_of
from wbf_mission.flight import fly
from wbf_mission.results.writing import ResultFolder

AUTOPILOTS = ("px4", "ardupilot")
WAYS = ("own", "mavsdk")
BASE_MODE = {"px4": 29, "ardupilot": 81}
# Faster, and the vehicle would give up a transfer while MAVSDK waits for its turn on a busy machine: then a
# timeout is what MAVSDK tells, in place of a refusal.
PATIENT = 1.0


def driver(way):
    return via_named(way).driver


def plans_about(home):
    """A mission with a jump and a landing, a fence of both kinds, and rally points."""
    latitude, longitude = home.latitude_deg, home.longitude_deg

    def place(command, north, east, z, frame=Frame.GLOBAL_RELATIVE_ALT, **parameters):
        return MissionItem(
            command, frame, x=latitude + north * 1e-4, y=longitude + east * 1e-4, z=z, **parameters
        )

    corners = ((-9, -9), (-9, 9), (9, 9), (9, -9))
    inclusion, circle = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION
    return Mission(
        (
            place(Command.NAV_TAKEOFF, 0, 0, 10.0, param4=None),
            MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 4.0, -1.0),
            place(Command.NAV_WAYPOINT, 2, 0, 10.0, param2=2.0),
            place(Command.NAV_WAYPOINT, 2, 3, 12.0, param1=2.0),
            MissionItem(Command.DO_JUMP, Frame.MISSION, 2.0, 1.0),
            MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION),
        ),
        home=home,
        fence=(
            *(place(inclusion, *corner, 0.0, Frame.GLOBAL, param1=4.0) for corner in corners),
            place(circle, 6, 6, 0.0, Frame.GLOBAL, param1=5.0),
        ),
        rally=(place(Command.NAV_RALLY_POINT, 1, 1, 12.0), place(Command.NAV_RALLY_POINT, -1, 1, 12.0)),
    )


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("udpin:127.0.0.1:14550", "udpin://127.0.0.1:14550"),
        ("udpout:127.0.0.1:14550", "udpout://127.0.0.1:14550"),
        ("tcp::5760", "tcpout://127.0.0.1:5760"),
        ("tcpin:127.0.0.1:5760", "tcpin://127.0.0.1:5760"),
        ("serial:/dev/ttyUSB0:115200", "serial:///dev/ttyUSB0:115200"),
    ],
)
def test_addresses_as_mavsdk_writes_them(url, expected):
    from wbf_mission.addons.mavsdk.link import mavsdk_url

    assert mavsdk_url(parse_link_url(url)) == expected


@pytest.mark.parametrize("url", ["udpin:127.0.0.1:0", "serial:/dev/no-such-line:57600"])
def test_an_address_that_mavsdk_cannot_open(url):
    with pytest.raises(LinkError, match=f"^{url}: MAVSDK cannot open it: .*; check the address$"):
        driver("mavsdk")(url, lambda _: None)


def test_mavsdk_is_loaded_only_when_it_is_asked_for():
    code = (
        "import sys; from wbf_mission.addons.base.links import via_named; via_named('own');"
        "assert 'mavsdk' not in sys.modules; via_named('mavsdk'); assert 'mavsdk' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_the_extra_it_says_what_to_install(tmp_path):
    code = "import sys; sys.modules['mavsdk'] = None; from wbf_mission.__main__ import main; sys.exit(main())"
    words = ["download", "--connect", "udpin:127.0.0.1:0", "--out", "a.plan", "--via", "mavsdk"]
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert 'mavsdk needs mavsdk; install it with: pip install "wbf-mission[mavsdk]"' in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_plans_that_go_up_one_way_come_down_the_other(autopilot):
    held = {}
    with stand_in(autopilot) as (url, made):
        plans = plans_about(made.vehicle.home)
        for way, other in (WAYS, WAYS[::-1]):
            report = upload(plans, url, open_driver=driver(way))
            assert report.items == {"fence": 5, "rally": 2, "mission": 6}
            assert report.verified
            held[way], _ = download(url, open_driver=driver(other))
    assert held["own"] == held["mavsdk"]
    assert [one.command for one in held["own"].items] == [one.command for one in plans.items]
    assert held["own"].items[4].param1 == 2.0, "the jump's target counts as ours does"
    assert (len(held["own"].fence), len(held["own"].rally)) == (5, 2)


def test_an_empty_mission_empties_the_vehicle_and_an_empty_vehicle_has_empty_plans():
    with stand_in() as (url, made):
        upload(plans_about(made.vehicle.home), url)
        assert upload(Mission(()), url, open_driver=driver("mavsdk")).items == {"mission": 0}
        held, _ = download(url, open_driver=driver("mavsdk"))
    assert held.items == ()
    assert len(held.fence) == 5


def test_over_a_serial_line():
    ours, theirs = pty.openpty()
    for end in (ours, theirs):
        tty.setraw(end)
    far, near = pty.openpty()
    for end in (far, near):
        tty.setraw(end)
    pump = subprocess.Popen(
        [sys.executable, "-c", PUMP, str(ours), str(far)], pass_fds=(ours, far), stdin=subprocess.DEVNULL
    )
    try:
        with stand_in(listen=f"serial:{os.ttyname(theirs)}:57600", speed=PATIENT) as (_, made):
            url = f"serial:{os.ttyname(near)}:57600"
            plans = plans_about(made.vehicle.home)
            assert upload(plans, url, open_driver=driver("mavsdk")).verified
    finally:
        pump.kill()
        pump.wait(10.0)
        for end in (ours, theirs, far, near):
            os.close(end)


PUMP = """
import os, select, sys
ends = [int(one) for one in sys.argv[1:]]
while True:
    for end in select.select(ends, [], [])[0]:
        os.write(ends[1 - ends.index(end)], os.read(end, 4096))
"""


def free_udp_port():
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_a_refusal_is_told_in_the_words_of_both():
    given = {"system_faults": ("final-ack-error=5",), "speed": PATIENT}
    with stand_in(**given) as (url, made), pytest.raises(RemoteTransferError) as error:
        upload(plans_about(made.vehicle.home), url, open_driver=driver("mavsdk"))
    assert str(error.value).startswith("upload of the fence failed: MAVSDK says ")
    assert exit_code_of(error.value) is ExitCode.REFUSED


def test_a_refused_list_says_what_a_vehicle_that_overwrites_in_place_holds_now():
    with stand_in("ardupilot", system_faults=("final-ack-error=5",), speed=PATIENT) as (url, made):
        with pytest.raises(RemoteTransferError) as error:
            upload(
                replace(plans_about(made.vehicle.home), fence=(), rally=()), url, open_driver=driver("mavsdk")
            )
        held = len(made.vehicle.pilot.mission.items)
    assert f"the vehicle now holds {held} items, all as sent: upload again before flying" in str(error.value)
    assert held > 1


def test_a_vehicle_that_does_not_answer_an_upload():
    with stand_in(system_faults=("no-count",)) as (url, made), pytest.raises(RemoteTransferError) as error:
        upload(plans_about(made.vehicle.home), url, open_driver=driver("mavsdk"))
    assert "MAVSDK says TIMEOUT; the vehicle did not answer" in str(error.value)
    assert exit_code_of(error.value) is ExitCode.LINK_LOST


def test_an_upload_whose_confirmation_is_lost_is_found_on_the_vehicle():
    with stand_in(system_faults=("no-final-ack",)) as (url, made):
        assert upload(plans_about(made.vehicle.home), url, open_driver=driver("mavsdk")).verified


def test_nobody_is_heard():
    with pytest.raises(NoVehicleError) as error:
        url = f"udpin:127.0.0.1:{free_udp_port()}"
        find_vehicles(url, (None,), wait_s=0.3, open_driver=driver("mavsdk"))
    assert exit_code_of(error.value) is ExitCode.NO_VEHICLE


def test_ctrl_c_ends_it_at_once_and_without_a_traceback(tmp_path):
    command = [sys.executable, "-m", "wbf_mission", "download", "--out", str(tmp_path / "held.plan")]
    command += ["--via", "mavsdk", "--connect", f"udpin:127.0.0.1:{free_udp_port()}", "--wait", "60"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environment()) as process:
        assert "waiting for a vehicle" in process.stderr.readline()
        process.send_signal(2)
        out, error = process.communicate(timeout=LONG_S)
    assert process.returncode == ExitCode.INTERRUPTED
    assert out == ""
    assert "Traceback" not in error


class Orders:
    """MAVSDK's orders to a vehicle, asked until they are answered."""

    def __init__(self, stack, url):
        from wbf_mission.addons.mavsdk.adapter import MavsdkOrders
        from wbf_mission.addons.mavsdk.link import MavsdkLink

        (heard,) = find_vehicles(url, (None,))
        self.notes = []
        link = stack.enter_context(contextlib.closing(MavsdkLink(url)))
        self.kind = (heard.autopilot, heard.vehicle_type)
        self.orders = MavsdkOrders(link, heard, self.notes.append)

    def give(self, command, *params):
        values = [*params, *[0.0] * (7 - len(params))]
        message = m.MAVLink_command_long_message(1, 1, int(command), 0, *values)
        assert self.orders.takes(message)
        began_s = time.monotonic()
        answers = list(self.orders.carry_out(message))
        while not answers:
            now_s = time.monotonic()
            assert now_s < began_s + LONG_S
            time.sleep(0.01)
            answers = self.orders.answers(now_s)
        (answer,) = answers
        assert (answer.get_srcSystem(), answer.get_srcComponent(), answer.command) == (1, 1, command)
        return answer.result


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_orders_and_their_answers(autopilot):
    with contextlib.ExitStack() as stack:
        # A vehicle that is armed and does not take off disarms after ten seconds of its own.
        url, made = stack.enter_context(stand_in(autopilot, speed=1.0))
        orders, pilot = Orders(stack, url), made.vehicle.pilot
        kind = orders.kind
        modes = VehicleModes(*kind)
        assert orders.give(m.MAV_CMD_DO_SET_MODE, *modes.numbers(modes.arming)) == m.MAV_RESULT_ACCEPTED
        pilot.arming.block = "compass not calibrated"
        refused = orders.give(m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        assert refused in (m.MAV_RESULT_DENIED, m.MAV_RESULT_FAILED)
        assert orders.notes[-1].startswith("MAVSDK: arm: ")
        pilot.arming.block = None
        assert orders.give(m.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == m.MAV_RESULT_ACCEPTED
        assert pilot.armed
        for order, name in (
            (Maneuver.HOLD, "LOITER" if autopilot == "px4" else "BRAKE"),
            (Maneuver.RETURN, "RTL"),
            (Maneuver.LAND, "LAND"),
        ):
            command, params = modes.maneuver(order)
            assert orders.give(command, *params) == m.MAV_RESULT_ACCEPTED
            told = (kind[1], kind[0], BASE_MODE[autopilot], made.vehicle.state.custom_mode, 4, 3)
            assert mode_name(m.MAVLink_heartbeat_message(*told)) == name
        assert orders.give(60_000) == m.MAV_RESULT_UNSUPPORTED


def path_of(result):
    track = result.flights[0].track
    return track.x_m, track.y_m


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_same_flight_both_ways(autopilot, tmp_path):
    flown, held, files = {}, {}, {}
    for way in WAYS:
        commands = []
        with stand_in(autopilot) as (url, made), ResultFolder(tmp_path / way) as folder:
            receive = made.vehicle.receive

            def heard(message, now_s, receive=receive, commands=commands):
                if message.get_srcSystem() == 255 and message.get_type().startswith("COMMAND_"):
                    commands.append(message.command)
                return receive(message, now_s)

            made.vehicle.receive = heard
            flown[way] = fly(scenario(), by=LiveLink(url, Watcher(), via=via_named(way), tlog=folder.tlog))
            folder.write(flown[way])
            held[way], _ = download(url)
        files[way] = {one.name for one in (tmp_path / way).iterdir()}
        # MAVSDK starts the mission of a PX4 by its mode alone: it is MAVSDK that speaks.
        by_mode = way == "mavsdk" and autopilot == "px4"
        assert (m.MAV_CMD_MISSION_START in commands) is not by_mode
    own, other = flown["own"], flown["mavsdk"]
    assert own.outcome is other.outcome is Outcome.COMPLETED
    assert held["own"] == held["mavsdk"]
    assert len(held["own"].items) > 5
    assert files["own"] == files["mavsdk"]
    assert other.flights[0].flight_time_s == pytest.approx(own.flights[0].flight_time_s, rel=0.05, abs=1.0)
    assert other.flights[0].transfers[-1].verified
    flights = [shapely.LineString(np.column_stack(path_of(one))) for one in (own, other)]
    assert shapely.hausdorff_distance(*flights) < 1.0
    seen = {
        way: set(zip(r.observations.x.tolist(), r.observations.y.tolist(), strict=True))
        for way, r in flown.items()
    }
    assert len(seen["own"]) > 20
    # A camera that is triggered a moment later sees some of its images in the next cell.
    unlike = seen["own"] ^ seen["mavsdk"]
    assert len(unlike) <= 0.2 * len(seen["own"])
    for result in flown.values():
        truth = result.truth[:, result.observations.x, result.observations.y]
        assert (result.observations.values == truth.T).all()
    # Half of the 100 cells are tomatoes, and a sick one that only one of the two has seen costs 10.
    assert other.final_score == pytest.approx(own.final_score, abs=1e-9 + len(unlike) * 10 / 50)
    assert np.array_equal(own.truth, other.truth)


@pytest.mark.slow
def test_a_policy_changes_the_mission_of_a_px4_by_mavsdk():
    with stand_in() as (url, _):
        link = LiveLink(url, Watcher(), via=via_named("mavsdk"))
        result = fly(scenario(policy="greedy"), by=link)
    assert result.outcome is Outcome.COMPLETED
    changes = [one for record in result.decisions for one in record.changes if one.outcome == "flown"]
    assert changes


@pytest.mark.slow
def test_an_item_that_a_px4_goes_on_from_at_once_is_chosen_once_by_mavsdk():
    chosen = []

    def choose(flight):
        (sortie,) = flight.sorties
        items = [int(one.command) for one in sortie.plan.mission.items]
        distance = items.index(int(Command.DO_SET_CAM_TRIGG_DIST))
        sortie.send([m.MAVLink_mission_set_current_message(1, 1, distance)])

    with stand_in() as (url, made):
        receive = made.vehicle.receive

        def heard(message, now_s):
            if message.get_type() == "MISSION_SET_CURRENT":
                chosen.append(message.seq)
            return receive(message, now_s)

        made.vehicle.receive = heard
        result = fly(scenario(), by=LiveLink(url, Watcher(images=8, act=choose), via=via_named("mavsdk")))
    assert result.outcome is Outcome.COMPLETED
    assert len(chosen) == 1


def test_a_policy_is_not_offered_for_an_arducopter_by_mavsdk():
    with stand_in("ardupilot") as (url, made):
        with pytest.raises(LiveFlightError, match="leave out --via mavsdk") as error:
            fly(scenario(policy="greedy"), by=LiveLink(url, Watcher(), via=via_named("mavsdk")))
        assert not made.vehicle.pilot.armed
    assert exit_code_of(error.value) is ExitCode.BAD_INPUT
