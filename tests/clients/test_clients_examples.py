"""The examples of MAVLink libraries before the simulator: what each of them is there for is achieved.

They are written after the libraries' own (`examples/`): the same calls in the same order. The table of
docs/client-examples.csv says which there are and why others cannot run.
"""

import contextlib
import math
import os
import re
import shutil
import signal
import socketserver
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest
from live_changes import LANDS_SOON
from page_tables import rows_of

HERE = Path(__file__).parent / "examples"
ORBIT = 3 << 16 | 1 << 24  # PX4's number of the mode
# A process may be so many times slower than on a quiet machine.
BUSY = 6.0
ZURICH, CANBERRA = "47.397742,8.545594,488", "-35.363261,149.16523,584"


class Sample(NamedTuple):
    time_s: float
    east_m: float
    north_m: float
    up_m: float
    heading_deg: float
    roll_deg: float
    pitch_deg: float
    mode: str
    armed: bool
    told: int  # the custom mode that stations hear


class Clock(socketserver.ThreadingTCPServer):
    """The vehicle's clock, for the example's process: it answers when some seconds have passed."""

    daemon_threads = True

    def __init__(self, server):
        self.vehicle_server, self.ended = server, False
        super().__init__(("127.0.0.1", 0), Waiter)
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def port(self):
        return str(self.server_address[1])

    def stop(self):
        self.ended = True
        self.shutdown()
        self.server_close()


class Waiter(socketserver.StreamRequestHandler):
    def handle(self):
        clock = self.server
        end_s = clock.vehicle_server.now_s + float(self.rfile.readline())
        while clock.vehicle_server.now_s < end_s and not clock.ended:
            time.sleep(0.002)
        self.wfile.write(f"{clock.vehicle_server.now_s}\n".encode())


class Run:
    """An example that was run: what it printed, and what the vehicle did meanwhile."""

    def __init__(self, flying, directory):
        self.flying, self.vehicle, self.directory = flying, flying.vehicle, directory
        self.out, self.answers_to = "", 0
        self.track = []
        self.clock = Clock(flying.server)
        self._advance = self.vehicle.pilot.advance
        self.vehicle.pilot.advance = self._advance_and_watch

    def _advance_and_watch(self, now_s, **options):
        """Watch the vehicle by its own clock: nothing is missed on a busy machine."""
        events = self._advance(now_s, **options)
        pilot, state = self.vehicle.pilot, self.vehicle.pilot.state
        if not self.track or abs(state.time_s - self.track[-1].time_s) > 0.05 or events:
            angles = map(math.degrees, (state.yaw_rad, state.roll_rad, state.pitch_rad))
            modes = pilot.mode.value, state.armed, self.vehicle.state.custom_mode
            self.track.append(Sample(state.time_s, *state.position_m, *angles, *modes))
        return events

    def stop(self):
        self.clock.stop()

    def wait_until(self, condition, limit_s, what):
        end_s = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < end_s, f"not within {limit_s} s: {what}\n{self.tail}"
            time.sleep(0.02)

    @property
    def tail(self):
        track = list(self.track)
        some = track[:: max(len(track) // 10, 1)]
        rows = (f"{s.mode} {s.armed} " + " ".join(f"{value:.1f}" for value in s[:7]) for s in some)
        return "\n".join((*rows, self.out[-3000:]))

    def said(self, pattern):
        match = re.search(pattern, self.out)
        assert match, f"it did not say {pattern!r}\n{self.tail}"
        return match

    def was_at(self, east_m, north_m, up_m, within_m=1.0):
        """The vehicle was there, at any time; return the first such time."""
        place = (east_m, north_m, up_m)
        reached = [s for s in self.track if math.dist(place, (s.east_m, s.north_m, s.up_m)) < within_m]
        nearest = min(math.dist(place, (s.east_m, s.north_m, s.up_m)) for s in self.track)
        assert reached, f"{nearest:.1f} m from {place} at the nearest\n{self.tail}"
        return reached[0].time_s

    def was_over(self, latitude, longitude, up_m, within_m=1.0):
        return self.was_at(*self.metres(latitude, longitude), up_m, within_m)

    def metres(self, latitude, longitude):
        return self.vehicle.pilot.frame.from_wgs84(latitude, longitude)

    def was_in(self, *modes):
        seen = [s.mode for s in self.track]
        order = [mode for n, mode in enumerate(seen) if n == 0 or seen[n - 1] != mode]
        rest = iter(order)
        assert all(mode in rest for mode in modes), f"{modes} are not in this order in {order}\n{self.tail}"

    def climbed_to(self, low_m, high_m):
        top = max(s.up_m for s in self.track)
        assert low_m <= top <= high_m, f"it climbed to {top:.1f} m\n{self.tail}"

    def climbed_at(self, speed_m_s, least_m):
        """It climbed so fast; how long, and so how high, depends on when the next order came."""
        top = max(s.up_m for s in self.track)
        assert top > least_m, f"it climbed to {top:.1f} m\n{self.tail}"
        low, high = (next(s for s in self.track if s.up_m > share * top) for share in (0.3, 0.7))
        rate = (high.up_m - low.up_m) / (high.time_s - low.time_s)
        assert rate == pytest.approx(speed_m_s, rel=0.15), self.tail

    def lands(self, limit_s=200.0):
        self.wait_until(lambda: not self.vehicle.pilot.armed, limit_s, "landed and disarmed")
        assert any(s.armed for s in self.track), f"it never armed\n{self.tail}"
        assert self.vehicle.pilot.state.position_m[2] < 0.3, self.tail

    def has_parameter(self, name, value):
        have = self.vehicle._parameters.value
        self.wait_until(lambda: have(name) == pytest.approx(value), 5.0, f"{name} = {value}")

    def has_plan(self, kind, commands):
        from mission.model import MissionType

        items = self.vehicle._plans.server.plan(MissionType[kind]).items
        assert [int(item.command) for item in items] == list(commands), self.tail
        return items


class Example(NamedTuple):
    achieved: Callable[[Run], object]
    speed: float = 4.0
    autopilot: str = "px4"
    home: str | None = None
    camera: bool | None = None  # as by default
    before: Callable[[Run], object] | None = None


def said(*patterns):
    return lambda run: [run.said(pattern) for pattern in patterns]


def landed(*modes, low_m=2.0, high_m=3.5):
    def achieved(run):
        run.lands()
        run.climbed_to(low_m, high_m)
        run.was_in(*modes)

    return achieved


def circled(run):
    centre = run.metres(47.398036222362471, 8.5450146439425509)
    about = [
        (math.atan2(centre[0] - s.east_m, centre[1] - s.north_m), s)
        for s in run.track
        if s.told == ORBIT and abs(math.dist(centre, (s.east_m, s.north_m)) - 10.0) < 2.0
    ]
    turned = sum(math.remainder(b[0] - a[0], math.tau) for a, b in pairwise(about))
    assert turned > math.pi, f"{math.degrees(turned):.0f} degrees of the circle\n{run.tail}"
    for bearing, s in about[len(about) // 2 :]:
        assert abs(s.up_m - 10.0) < 2.0
        assert abs(math.remainder(s.heading_deg - math.degrees(bearing), 360.0)) < 20.0, run.tail
    run.was_in("hold", "return")
    run.lands()


def followed(run):
    run.was_in("takeoff", "follow me", "hold", "land")
    centre = run.metres(47.39782562, 8.54500928)
    near = [math.dist(centre, (s.east_m, s.north_m)) for s in run.track if s.mode == "follow me"]
    assert near[0] > 40.0 and near[-1] < near[0] - 15.0, run.tail
    run.lands()


def took_off_to(height_m):
    """The example's 10 s end while the vehicle is on its way there, as on a real one."""

    def achieved(run):
        run.has_parameter("MIS_TAKEOFF_ALT", height_m)
        landed("takeoff", "land", low_m=0.8 * height_m, high_m=1.1 * height_m)(run)

    return achieved


def flew_mission(run):
    run.said("progress 3/3")
    for place in ((47.39803986, 8.54557254), (47.39803622, 8.54501464), (47.39782562, 8.54500928)):
        run.was_over(*place, 25.0, 2.5)
    run.lands()
    assert run.vehicle.outcome.value == "completed"
    assert math.hypot(*run.vehicle.pilot.state.position_m[:2]) < 2.0


def arm_and_wait(run):
    """Leave a log."""
    vehicle = run.vehicle
    run.wait_until(lambda: vehicle.pilot.now_s > 5.0, 20.0, "some seconds")
    vehicle.pilot.arm()
    run.wait_until(lambda: vehicle.pilot.armed, 5.0, "arming")
    run.wait_until(lambda: vehicle.pilot.now_s > 8.0, 20.0, "a log of some seconds")
    vehicle.pilot.disarm()
    ended_s = vehicle.pilot.now_s
    run.wait_until(lambda: vehicle.pilot.now_s > ended_s + 5.0, 20.0, "the end of the log")


def leaned(run):
    rolls = [s.roll_deg for s in run.track if s.armed]
    assert max(rolls) > 25.0 and min(rolls) < -25.0, run.tail
    run.was_in("guided", "land")
    run.lands()


def has_fence(run):
    items = run.has_plan("FENCE", [5001] * 4 + [5003])
    north, east = (round(1e7 * (getattr(items[2], axis) - getattr(items[0], axis))) for axis in ("x", "y"))
    assert (north, east) == (2000, 2000)


MAVSDK_3 = {
    "all_params": Example(said("MPC_XY_CRUISE: 5.0", "NAV_RCL_ACT: 2")),
    "calibration": Example(said("gyro calibrated")),
    "camera": Example(
        lambda run: run.wait_until(lambda: run.flying.camera.image_count == 1, 5.0, "an image")
    ),
    "do_orbit": Example(circled),
    "follow_me_example": Example(followed, camera=False),
    "firmware_version": Example(said("flight_sw_major: 1, flight_sw_minor: 17")),
    "ftp_download_file": Example(said(r"got (\d+) of \1\n")),
    "ftp_list_dir": Example(said("fs")),
    "geofence": Example(has_fence),
    "goto": Example(lambda run: run.was_over(47.397606, 8.543060, 20.0)),
    "highres_imu": Example(said(r"down_m_s2: -9\.[78]")),
    "logfile_download": Example(said(r"log 0 20\S+ (\d+)\ndownloaded \1\n"), before=arm_and_wait),
    "manual_control": Example(lambda run: run.was_in("takeoff", "position"), 2.0),
    "mavlink_direct_receive": Example(said("ATTITUDE 1 .*yawspeed")),
    "mavlink_direct_send": Example(said("done")),
    "mission": Example(flew_mission),
    "mission_import": Example(
        lambda run: (run.has_plan("MISSION", [22, 16, 16, 16, 20]), run.has_plan("RALLY", [5100]))
    ),
    "mission_raw": Example(lambda run: run.has_plan("MISSION", [16, 16])),
    "offboard_attitude": Example(leaned),
    "offboard_from_csv": Example(
        lambda run: (run.was_at(0, 0, 10, 2.0), run.was_at(10, 0, 10, 2.0), run.lands())
    ),
    "offboard_position_ned": Example(
        lambda run: (
            run.was_at(0, 0, 5, 1.5),
            run.was_at(0, 5, 5, 1.5),
            run.was_at(10, 5, 5, 1.5),
            run.was_at(10, 0, 0, 1.5),
        )
    ),
    "offboard_position_velocity_ned": Example(
        lambda run: (run.was_at(0, 0, 10, 2.0), run.was_at(0, 50, 10, 3.0), run.was_in("guided", "hold"))
    ),
    "offboard_velocity_body": Example(lambda run: (run.climbed_at(1, 4), run.was_in("guided", "hold"))),
    "offboard_velocity_ned": Example(lambda run: (run.climbed_at(2, 6), run.was_in("guided", "hold"))),
    "rtcm": Example(said("done")),
    "send_status_message": Example(said("done")),
    "takeoff_and_land": Example(landed("takeoff", "land")),
    "telemetry": Example(said("remaining_percent: 100", "fix_type: ", "False", "latitude_deg: 47.39")),
    "telemetry_flight_mode": Example(said("HOLD")),
    "telemetry_is_armed_is_in_air": Example(said("False\nFalse")),
    "telemetry_status_text": Example(said("(?i)armed")),
    "telemetry_takeoff_and_land": Example(took_off_to(10.0)),
    "tune": Example(said("done")),
    "upload_params": Example(
        lambda run: (
            run.has_parameter("COM_DISARM_PRFLT", 20),
            run.has_parameter("MPC_XY_CRUISE", 6),
            run.has_parameter("NAV_RCL_ACT", 1),
        )
    ),
}


def paused_mission(run):
    run.said("(?s)progress 2/6.*paused.*progress 6/6")
    run.was_in("mission", "hold", "mission", "return")
    run.was_over(47.398170327, 8.545649022, 10.0, 2.0)
    run.lands()
    assert run.flying.camera.image_count > 1


def read_and_set(run):
    run.said("as integer 2\n")
    run.has_parameter("MPC_XY_CRUISE", 7.0)


MAVSDK_4 = {
    "mavlink_direct": Example(said(r"latitude 47397\d{4}")),
    "mission": Example(paused_mission),
    "params": Example(read_and_set),
    "takeoff_and_land": Example(landed("takeoff", "land", low_m=0.2)),
    "telemetry": Example(landed("takeoff", "land")),
    "asyncio_mission": Example(paused_mission),
    "asyncio_params": Example(read_and_set),
    "asyncio_takeoff_and_land": Example(landed("takeoff", "land", low_m=0.2)),
    "asyncio_telemetry": Example(landed("takeoff", "land")),
}


def went(*places, modes=("guided",), within_m=2.0):
    """It was at those places about home, in those modes, and landed at last."""

    def achieved(run):
        for place in places:
            run.was_at(*place, within_m)
        run.was_in(*modes)
        run.lands()

    return achieved


def drove_by_orders(run):
    run.said("reached 80 -50")
    run.said("reached 100 -130")
    for heading in (180, 270, 0, 90):
        told = int(run.said(rf"heading {heading} (\d+)").group(1))
        assert abs(math.remainder(told - heading, 360.0)) < 10.0
    run.was_in("guided", "land")
    run.lands()


def rebooted(run):
    run.said("done")
    run.wait_until(lambda: run.vehicle.state._boot_us > 0, 1.0, "a reboot")


def flew_without_gps(run):
    run.was_in("attitude", "land")
    run.climbed_to(2.2, 5.0)
    run.lands()


def has_state(run):
    run.said("version APM:Copter-4")
    run.said(r"home 222")
    run.said("attitudes True")
    run.said("speed 1000.0 True")
    run.has_parameter("WPNAV_SPEED", 600)
    run.has_parameter("PILOT_SPEED_UP", 200)


COPTER = Example(lambda run: None, 4.0, "ardupilot")
DRONEKIT = {
    "channel_overrides": COPTER._replace(achieved=said("overrides {'3': 500}", "overrides {}")),
    "create_attribute": COPTER._replace(achieved=said(r"raw_imu \(\d+, 0, 0, -1000\)")),
    "flight_replay": COPTER._replace(
        achieved=went((0, 10, 30), (5, 45, 30), modes=("guided", "mission", "return"), within_m=4.0)
    ),
    "guided_set_speed_yaw": COPTER._replace(achieved=drove_by_orders, speed=8.0),
    "mission_basic": COPTER._replace(
        achieved=went((-50, 50, 11), (50, 50, 12), modes=("guided", "mission", "return"), within_m=5.0)
    ),
    "mission_import_export": COPTER._replace(achieved=lambda run: run.has_plan("MISSION", [22, 16, 16, 16])),
    "performance_test": COPTER._replace(achieved=said(r"acknowledged True \{0\}")),
    "reboot": COPTER._replace(achieved=rebooted),
    "set_attitude_target": COPTER._replace(achieved=flew_without_gps, speed=1.0),
    "simple_goto": COPTER._replace(
        achieved=lambda run: (run.was_over(-35.361354, 149.165218, 20.0, 150.0), run.lands()),
        home=CANBERRA,
        speed=8.0,
    ),
    "vehicle_state": COPTER._replace(achieved=has_state),
}
PYMAVLINK = {
    "apmsetrate": COPTER._replace(
        achieved=said("ATTITUDE\n", "VFR_HUD\n", "GLOBAL_POSITION_INT\n"), speed=1.0
    ),
    "mavftp_example": COPTER._replace(achieved=said("done")),
    "mavtester": COPTER._replace(achieved=said("still there")),
    "status_msg": COPTER._replace(achieved=said(r"banner ArduCopter V4", r"version 4 \d"), speed=1.0),
}


NODE = {
    "pool-param-udp": Example(said("MC_ROLLRATE_P 0.1", "MC_PITCHRATE_P 0.1"), 1.0),
    "send-receive-param-list-sitl": COPTER._replace(achieved=said("done"), speed=1.0),
    "send-receive-signed-udp": Example(said("not signed"), 1.0),
    "send-receive-tcp": COPTER._replace(achieved=said("acknowledged 519"), speed=1.0),
    "send-receive-udp": Example(said("acknowledged 519"), 1.0),
}


def run_example(run, command, environment=None, limit_s=300.0):
    """Run it in a session of its own, all of which ends with it."""
    log = run.directory / "out.log"
    variables = {**os.environ, "PYTHONUNBUFFERED": "1", "CLOCK": run.clock.port, **(environment or {})}
    with log.open("w") as output:
        process = subprocess.Popen(
            command, env=variables, cwd=run.directory,
            stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            status = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            status = "no end"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(5.0)
    run.out = log.read_text(errors="replace")
    assert status == 0, f"{status}\n{run.tail}"


@pytest.fixture
def begin(fly, tools, tmp_path):
    """A vehicle with the settings of ``wbf-mission sim``, but that it lands soon, and its address."""
    runs = []

    def start(example, home=None):
        home, answers_to = example.home or home, 0
        if example.autopilot == "ardupilot":
            flying = fly("ardupilot", speed=example.speed, camera=example.camera, home=home)
            address = f"tcp:127.0.0.1:{tools.port_of(flying.urls[0])}"
        else:
            port, answers_to = tools.free_port(), tools.free_port()
            flying = fly(
                "px4",
                (f"udpout:127.0.0.1:{port},{answers_to}",),
                speed=example.speed,
                camera=example.camera,
                home=home,
            )
            address = f"udpin:127.0.0.1:{port}"
            for name, seconds in (("COM_OF_LOSS_T", 1.0), ("COM_RC_LOSS_T", 0.5)):
                # The library's clock is slower by the speed, and stands where the machine is busy.
                flying.vehicle._parameters.change(name, seconds * example.speed * BUSY)
        for name, value in LANDS_SOON[flying.autopilot].items():
            flying.vehicle._parameters.change(name, value)
        runs.append(Run(flying, tmp_path))
        runs[-1].answers_to = answers_to
        if example.before is not None:
            example.before(runs[-1])
        return runs[-1], address

    yield start
    for run in runs:
        run.stop()


@pytest.fixture(scope="session")
def mavsdk3_path(installed):
    return installed("mavsdk<4")


@pytest.fixture(scope="session")
def dronekit_path(installed):
    # It imports `past`, of the package `future`, which it does not name.
    return installed("--no-deps", "dronekit==2.9.2", "monotonic", "future")


@pytest.mark.slow
@pytest.mark.parametrize("name", MAVSDK_3)
def test_mavsdk_3(name, begin, tools, mavsdk3_path):
    example = MAVSDK_3[name]
    run, address = begin(example, ZURICH)
    words = (name, address.replace(":", "://", 1), str(tools.free_port()))
    run_example(run, [sys.executable, HERE / "mavsdk3.py", *words], {"PYTHONPATH": mavsdk3_path})
    example.achieved(run)


@pytest.mark.slow
@pytest.mark.parametrize("name", MAVSDK_4)
def test_mavsdk_4(name, begin):
    example = MAVSDK_4[name]
    run, address = begin(example, ZURICH)
    run_example(run, [sys.executable, HERE / "mavsdk4.py", name, address.replace(":", "://", 1)])
    example.achieved(run)


@pytest.mark.slow
@pytest.mark.parametrize("name", DRONEKIT)
def test_dronekit(name, begin, dronekit_path):
    example = DRONEKIT[name]
    run, address = begin(example)
    run_example(run, [sys.executable, HERE / "dronekit_2.py", name, address], {"PYTHONPATH": dronekit_path})
    example.achieved(run)


@pytest.mark.slow
@pytest.mark.parametrize("name", PYMAVLINK)
def test_pymavlink(name, begin):
    example = PYMAVLINK[name]
    run, address = begin(example)
    run_example(run, [sys.executable, HERE / "pymavlink_2.py", name, address], {"MAVLINK20": "1"})
    example.achieved(run)


@pytest.fixture(scope="session")
def node(tmp_path_factory):
    """Node, and NODE_PATH of the library."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("node and npm are not installed")
    target = tmp_path_factory.mktemp("node")
    words = [npm, "install", "--silent", "--no-fund", "--no-audit", "--prefix", target, "node-mavlink@2.3.0"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=200)
    if done.returncode != 0:
        pytest.skip(f"npm cannot install node-mavlink (no network?): {done.stderr[-200:]}")
    return node, str(target / "node_modules")


@pytest.mark.slow
@pytest.mark.parametrize("name", NODE)
def test_node_mavlink(name, begin, tools, node):
    example = NODE[name]
    program, path = node
    run, address = begin(example)
    words = (name, address.rsplit(":", 1)[1], str(run.answers_to))
    run_example(run, [program, HERE / "node_mavlink.cjs", *words], {"NODE_PATH": path})
    example.achieved(run)


CLIENTS = {
    "MAVSDK 3.17": MAVSDK_3,
    "MAVSDK 4.1": MAVSDK_4,
    "DroneKit 2.9.2": DRONEKIT,
    "pymavlink 2.4.50": PYMAVLINK,
    "node-mavlink 2.3": NODE,
}


def test_the_table_of_the_page_names_every_example_that_is_run_and_no_other():
    passing = {client: set() for client in CLIENTS}
    failing = {client: set() for client in CLIENTS}
    for row in rows_of("client-examples.csv"):
        kind = passing if row["result"].startswith("passes") else failing
        kind[row["client"]] |= set(re.findall(r"`([^`]+)`", row["example"]))
    assert passing == {client: set(examples) for client, examples in CLIENTS.items()}
    both = {client: passing[client] & failing[client] for client in CLIENTS}
    assert not any(both.values()), "an example passes and does not"
