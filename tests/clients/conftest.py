"""Real MAVLink software before the simulator: what its tests share.

``fly`` runs the vehicle of ``wbf-mission sim`` behind a server in a thread (a fresh one in milliseconds),
``sim`` the command itself as a process of its own.
"""

import contextlib
import math
import os
import re
import secrets
import shutil
import socket
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from filelock import FileLock
from processes import wait_until

from geo.frame import LocalFrame
from mission.model import Command, Frame, MissionItem
from sim_vehicle.host.server import Server

# Faster, and the timers of a transfer run out while a busy machine lets a client wait.
SPEED = 10.0


def free_port():
    """A port that nobody has, below those that systems hand out: another process could get one of these."""
    while True:
        port = secrets.choice(range(20_000, 32_000))
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_INET, socket.SOCK_STREAM) as stream,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagrams,
        ):
            stream.bind(("127.0.0.1", port))
            datagrams.bind(("127.0.0.1", port))
            return port


def port_of(url):
    return int(url.rsplit(":", 1)[1].split(",")[0])


def mission_about(home):
    """A short flight: take off, two places at another speed, return."""
    to_wgs84 = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m).to_wgs84
    relative = Frame.GLOBAL_RELATIVE_ALT
    return (
        MissionItem(Command.NAV_TAKEOFF, relative, 0.0, 0.0, 0.0, None, *to_wgs84(0.0, 0.0), 8.0),
        MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, 1.0, 5.0, -1.0),
        MissionItem.waypoint(*to_wgs84(15.0, 0.0), 8.0),
        MissionItem.waypoint(*to_wgs84(15.0, 12.0), 10.0, hold_s=1.0),
        MissionItem.waypoint(*to_wgs84(0.0, 12.0), 10.0),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH),
    )


def fence_about(home):
    """An inclusion square and an exclusion circle."""
    to_wgs84 = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m).to_wgs84
    corners = ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0))
    inclusion, circle = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION
    return (
        *(MissionItem(inclusion, Frame.GLOBAL, 4.0, 0.0, 0.0, 0.0, *to_wgs84(x, y), 0.0) for x, y in corners),
        MissionItem(circle, Frame.GLOBAL, 5.0, 0.0, 0.0, 0.0, *to_wgs84(45.0, -45.0), 0.0),
    )


def rally_about(home):
    to_wgs84 = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m).to_wgs84
    return tuple(
        MissionItem(
            Command.NAV_RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, 0.0, 0.0, 0.0, 0.0, *to_wgs84(x, 5.0), 12.0
        )
        for x in (10.0, -10.0)
    )


def with_home(items, home):
    """The items as they are sent to an ArduPilot, home first."""
    return (MissionItem.waypoint(home.latitude_deg, home.longitude_deg, home.altitude_m), *items)


def request_streams(flying):
    """Ask an ArduPilot for its telemetry, as a MAVProxy would that runs beside a client."""
    from mission.link.codec.dialect import mavlink

    codec = mavlink.MAVLink(None, 254, 230)
    with socket.create_connection(("127.0.0.1", port_of(flying.urls[0]))) as connection:
        connection.settimeout(5.0)
        connection.sendall(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 10, 1).pack(codec))
        wait_until(lambda: b"\x21" in connection.recv(4096), what="the telemetry")


class Flying:
    """A vehicle behind a server in a thread."""

    def __init__(self, autopilot, urls, speed, camera, home):
        from wbf_mission.addons.base.simulator import make_components, parse_home
        from wbf_mission.scenario import Scenario, scenario_with

        scenario = scenario_with(Scenario(), {"farm": "miniberry-10", "autopilot": autopilot})
        homes = () if home is None else (parse_home(home),)
        simulated = make_components(scenario, homes=homes, with_camera=camera)
        self.autopilot, self.vehicle, self.home = autopilot, simulated.vehicle, simulated.vehicle.home
        self.camera = next((c for c in simulated.components if c.component_id == 100), None)
        self.server = Server(simulated.components, urls, speed=speed)
        self.urls = self.server.urls
        self._thread = threading.Thread(target=self.server.run, daemon=True)
        self._thread.start()

    @property
    def is_ardupilot(self):
        return self.autopilot == "ardupilot"

    def stop(self):
        self.server.stop()
        self._thread.join(30.0)
        alive = self._thread.is_alive()
        self.server.close()
        assert not alive, "the server did not stop"

    def place(self, x_m, y_m):
        """Degrees of a place about home."""
        frame = LocalFrame(self.home.latitude_deg, self.home.longitude_deg, self.home.altitude_m)
        return frame.to_wgs84(float(x_m), float(y_m))

    @property
    def mission(self):
        """A mission as it is sent to this autopilot."""
        items = mission_about(self.home)
        return with_home(items, self.home) if self.is_ardupilot else items


@pytest.fixture
def fly():
    """Start a vehicle: ``fly(autopilot, urls, speed=, camera=, home=)``."""
    running = []

    def start(autopilot, urls=("tcpin:127.0.0.1:0",), *, speed=SPEED, camera=False, home=None):
        running.append(Flying(autopilot, urls, speed, camera, home))
        return running[-1]

    yield start
    for flying in running:
        flying.stop()


@pytest.fixture
def sim(tmp_path):
    """Start ``wbf-mission sim`` with options and wait until it serves."""
    running = []

    def start(*options):
        log = (tmp_path / f"sim-{len(running)}.log").open("w+")
        command = [sys.executable, "-u", "-m", "wbf_mission", "sim", *options]
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        running.append((process, log))
        path = Path(log.name)

        def serving():
            assert process.poll() is None, path.read_text()
            return "Ctrl-C" in path.read_text()

        wait_until(serving, "the start of the simulator")
        return SimpleNamespace(process=process, log=path)

    yield start
    for process, log in running:
        process.terminate()
        process.wait(10.0)
        log.close()


@pytest.fixture(scope="session")
def installed(tmp_path_factory):
    """Install packages into a directory of their own: ``installed("name<4", ...)`` is its PYTHONPATH.

    All workers of a run use the same: the first that needs it makes it.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent

    def install(*arguments):
        target = folder / ("packages-" + re.sub(r"[^\w.]+", "-", "-".join(arguments)))
        with FileLock(f"{target}.lock"):
            if not target.exists():
                made = target.with_name(f"{target.name}.part")
                shutil.rmtree(made, ignore_errors=True)
                pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", "--no-input"]
                pip += ["--disable-pip-version-check", "--retries", "1", "--target", str(made), *arguments]
                done = subprocess.run(pip, capture_output=True, text=True, timeout=300)
                if done.returncode != 0:
                    reason = done.stderr.strip().splitlines()[-1:] or ["no reason"]
                    pytest.skip(f"pip cannot install {' '.join(arguments)} (no network?): {reason[0]}")
                made.rename(target)
        return str(target)

    return install


@pytest.fixture
def mavsdk_system():
    """Connect MAVSDK: ``mavsdk_system(url)`` gives the first autopilot's system."""
    from mavsdk import ComponentType, Configuration, Mavsdk

    instances = []

    def connect(url, timeout_s=10.0):
        instance = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        instances.append(instance)
        assert instance.add_any_connection(url) == 0, f"MAVSDK cannot open {url}"
        system = instance.first_autopilot(timeout_s)
        assert system is not None, f"MAVSDK found no autopilot on {url}"
        return system

    yield connect
    for instance in instances:
        instance.destroy()


@pytest.fixture
def connected(fly, mavsdk_system):
    """A vehicle and MAVSDK on it, connected as the autopilot's own simulator is: UDP to us, TCP from us."""

    def connect(autopilot, **options):
        if autopilot == "ardupilot":
            flying = fly(autopilot, **options)
            return flying, mavsdk_system(f"tcpout://127.0.0.1:{port_of(flying.urls[0])}")
        port = free_port()
        flying = fly(autopilot, (f"udpout:127.0.0.1:{port}",), **options)
        return flying, mavsdk_system(f"udpin://127.0.0.1:{port}")

    return connect


def raw_items(items, mission_type=0):
    """Our items as MAVSDK's mission_raw takes them."""
    from mavsdk.plugins.mission_raw import MissionItem as RawItem

    def value(parameter):
        return math.nan if parameter is None else parameter

    return [
        RawItem(
            seq, item.frame, item.command, int(seq == 0 and mission_type == 0), 1,
            value(item.param1), value(item.param2), value(item.param3), value(item.param4),
            item.wire_x(), item.wire_y(), item.z, mission_type,
        )
        for seq, item in enumerate(items)
    ]  # fmt: skip


@pytest.fixture(scope="session")
def tools():
    """The helpers of this file, for the test modules."""
    return SimpleNamespace(
        wait_until=wait_until,
        free_port=free_port,
        port_of=port_of,
        mission_about=mission_about,
        fence_about=fence_about,
        rally_about=rally_about,
        with_home=with_home,
        raw_items=raw_items,
        request_streams=request_streams,
    )
