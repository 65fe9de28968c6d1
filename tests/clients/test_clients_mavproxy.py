"""MAVProxy, typed at through a pipe as its user types.

It is installed without its dependencies (half a gigabyte of maps and plots, of which a headless one needs
none) into a directory of its own.
"""

import os
import re
import subprocess
import sys
import threading

import pytest

from mission.link import read_tlog
from mission.model import MissionItem, MissionType

pytestmark = pytest.mark.slow


@pytest.fixture(scope="session")
def mavproxy_path(installed):
    return installed("--no-deps", "MAVProxy>=1.8.70", "pyserial>=3.5")


class Session:
    """A running MAVProxy: what was typed, what it said."""

    def __init__(self, path, directory, master, wait_until):
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1", "HOME": str(directory)}
        command = [sys.executable, "-m", "MAVProxy.mavproxy", f"--master={master}"]
        command += [f"--state-basedir={directory}"]
        command += ["--default-modules=wp,mode,arm,fence,rally,ftp,param,cmdlong,log,rc"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, env=environment, cwd=directory,
        )  # fmt: skip
        self._wait_until = wait_until
        self.lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            self.lines.append(line.rstrip())

    def expect(self, pattern, since=0, limit_s=20.0):
        """Wait for a line with the pattern and return the match."""

        def found():
            return next((m for line in self.lines[since:] if (m := re.search(pattern, line))), None)

        try:
            return self._wait_until(found, pattern, limit_s)
        except AssertionError:
            pytest.fail(f"MAVProxy did not say {pattern!r}, but:\n" + "\n".join(self.lines[-40:]))

    def type(self, command, pattern=None, limit_s=20.0):
        """Type a command and wait for an answer, if there is one."""
        since = len(self.lines)
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return None if pattern is None else self.expect(pattern, since, limit_s)

    def close(self):
        self._process.kill()
        self._process.wait(10.0)
        self._reader.join(5.0)
        self._process.stdin.close()
        self._process.stdout.close()


def write_waypoints(path, items):
    """Write a waypoint file as MAVProxy reads it."""
    rows = ["QGC WPL 110"]
    for seq, item in enumerate(items):
        params = [item.param1 or 0, item.param2 or 0, item.param3 or 0, item.param4 or 0]
        fields = [seq, 0, item.frame, item.command, *params, item.x, item.y, item.z, 1]
        rows.append("\t".join(map(str, fields)))
    path.write_text("\n".join(rows) + "\n")
    return path.name


@pytest.fixture
def session(mavproxy_path, fly, tools, tmp_path):
    """A vehicle on its default kind of link and MAVProxy on it: ``session(autopilot)``."""
    open_sessions = []

    def start(autopilot, **options):
        if autopilot == "ardupilot":
            flying = fly(autopilot, **options)
            master = f"tcp:127.0.0.1:{tools.port_of(flying.urls[0])}"
        else:
            port = tools.free_port()
            flying = fly(autopilot, (f"udpout:127.0.0.1:{port}",), **options)
            master = f"udpin:127.0.0.1:{port}"
        proxy = Session(mavproxy_path, tmp_path, master, tools.wait_until)
        open_sessions.append(proxy)
        proxy.expect("Detected vehicle 1:1", limit_s=30.0)
        proxy.expect(r"Received \d+ parameters")
        return flying, proxy

    yield start
    for proxy in open_sessions:
        proxy.close()


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_plans_parameters_and_a_flight(autopilot, session, tools, tmp_path):
    flying, proxy = session(autopilot)
    ardupilot = flying.is_ardupilot
    mission = write_waypoints(tmp_path / "mission.txt", flying.mission)
    fence = write_waypoints(tmp_path / "fence.txt", tools.fence_about(flying.home))
    rally = write_waypoints(tmp_path / "rally.txt", tools.rally_about(flying.home))
    count = len(flying.mission)

    name, default, value = ("WPNAV_SPEED", 1000, 600.0) if ardupilot else ("MPC_XY_CRUISE", 5, 6.0)
    proxy.type("param fetch", r"Received \d+ parameters")
    proxy.type(f"param show {name}", rf"{name}\s+{default}\b")
    proxy.type(f"param set {name} {value:g}")
    tools.wait_until(lambda: flying.vehicle.pilot.spec.cruise_speed_m_s == 6.0, what="the new speed")

    proxy.type(f"fence load {fence}", "Got MISSION_ACK: TYPE_FENCE: ACCEPTED")
    proxy.type("fence list", "Saved 5 fence items")
    proxy.type(f"rally load {rally}", "Got MISSION_ACK: TYPE_RALLY: ACCEPTED")
    proxy.type("rally list", "Saved 2 rally items")
    proxy.type(f"wp load {mission}", "Got MISSION_ACK: TYPE_MISSION: ACCEPTED")
    proxy.type("wp list", f"Saved {count} waypoints")
    listed = (tmp_path / "way.txt").read_text().splitlines()[1:]
    assert [int(row.split("\t")[3]) for row in listed] == [item.command for item in flying.mission]
    assert float(listed[-2].split("\t")[8]) == pytest.approx(
        flying.mission[-2].x, abs=1e-6
    )  # it saves six decimals

    if ardupilot:
        proxy.type("wp set 1", "Got COMMAND_ACK: DO_SET_MISSION_CURRENT: ACCEPTED")
    else:  # PX4 does not know the command; MAVProxy takes the message from then on
        proxy.type("wp set 2", "Got COMMAND_ACK: DO_SET_MISSION_CURRENT: UNSUPPORTED")
        proxy.type("wp set 2", "waypoint 2")
        proxy.type("wp set 0", "waypoint 0")
    proxy.type("arm throttle", "ARMED")
    # MAVProxy cannot set the modes of PX4 by name.
    start = "mode auto" if ardupilot else "long MISSION_START 0 0 0 0 0 0 0"
    proxy.type(start, "Got COMMAND_ACK: (DO_SET_MODE|MISSION_START): ACCEPTED")
    proxy.expect("Mode (AUTO|MISSION)")
    proxy.expect(f"waypoint {count - 1}", limit_s=30.0)
    proxy.expect("DISARMED", limit_s=30.0)
    assert flying.vehicle.outcome.value == "completed"

    proxy.type("wp clear", "Got MISSION_ACK: TYPE_MISSION: ACCEPTED")
    proxy.type("wp list", r"Requesting [01] waypoints")
    proxy.type("fence clear", "Got MISSION_ACK: TYPE_FENCE: ACCEPTED")
    proxy.type("rally clear", "Got MISSION_ACK: TYPE_RALLY: ACCEPTED")


def test_a_long_mission_goes_up_and_comes_down_by_pipelined_requests(session, tools, tmp_path):
    flying, proxy = session("ardupilot", speed=5.0)
    places = [
        MissionItem.waypoint(*flying.place(0.5 * (i % 40), 0.5 * (i // 40)), 8.0 + i % 5) for i in range(300)
    ]
    items = tools.with_home((flying.mission[1], *places), flying.home)
    name = write_waypoints(tmp_path / "long.txt", items)
    proxy.type(f"wp load {name}", "Got MISSION_ACK: TYPE_MISSION: ACCEPTED", limit_s=30.0)
    proxy.type("wp list", f"Saved {len(items)} waypoints", limit_s=30.0)
    rows = (tmp_path / "way.txt").read_text().splitlines()[1:]
    assert [float(row.split("\t")[10]) for row in rows[1:]] == [item.z for item in items[1:]]


def test_guided_flight_typed_by_hand(session, tools):
    flying, proxy = session("ardupilot")
    proxy.type("mode guided", "Mode GUIDED")
    proxy.type("arm throttle", "ARMED")
    proxy.type("takeoff 6", "Got COMMAND_ACK: NAV_TAKEOFF: ACCEPTED")
    tools.wait_until(lambda: flying.vehicle.pilot.state.position_m[2] > 5.8, what="the altitude")
    proxy.type("mode land", "Mode LAND")
    proxy.expect("DISARMED")
    proxy.type("mode auto", "AP: PreArm: Mode requires mission")


def test_parameters_come_by_ftp_and_files_are_listed(session, tools, tmp_path):
    flying, proxy = session("ardupilot")
    count = len(flying.vehicle.firmware.parameters(flying.vehicle.pilot.spec, 1))
    proxy.type("param fetch", rf"Received {count} parameters \(ftp\)")
    proxy.type("param show ARMING_RUDDER", r"ARMING_RUDDER\s+2")
    (tmp_path / "note.txt").write_text("a note\n" * 200)
    proxy.type(f"ftp put {tmp_path / 'note.txt'} APM/LOGS/note.txt", "Sent file of length 1400")
    proxy.type("ftp list /APM/LOGS", r"note\.txt\s+1400")
    proxy.type("ftp list /", r" D APM")


@pytest.mark.parametrize(("autopilot", "number"), [("px4", 0), ("ardupilot", 1)])
def test_the_log_of_a_flight_is_listed_and_downloaded(autopilot, number, session, tools, tmp_path):
    flying, proxy = session(autopilot)
    proxy.type("log list", "No logs")
    vehicle = flying.vehicle
    tools.wait_until(lambda: vehicle.pilot.now_s > 5.0, what="some seconds")
    proxy.type("arm throttle")
    tools.wait_until(lambda: vehicle.pilot.armed, what="arming")
    proxy.type("disarm")
    tools.wait_until(lambda: not vehicle.pilot.armed, what="disarming")
    ended_s = vehicle.pilot.now_s
    tools.wait_until(lambda: vehicle.pilot.now_s > ended_s + 3.0, what="the end of the log")
    size = int(proxy.type("log list", rf"Log {number} +numLogs 1 lastLog {number} size (\d+)").group(1))
    proxy.type(f"log download {number} flight.tlog", rf"Finished downloading flight.tlog \({size} bytes")
    messages = [message.get_type() for _, message in read_tlog(tmp_path / "flight.tlog")]
    assert "HEARTBEAT" in messages
    directory = "/APM/LOGS" if flying.is_ardupilot else "/fs/microsd/log"
    proxy.type(f"ftp list {directory}", r"00000001\.tlog\s+" + str(size) if flying.is_ardupilot else r" D 20")
    proxy.type("log erase")
    proxy.type("log list", "No logs")


def test_plans_go_and_come_as_files(session, tools, tmp_path):
    flying, proxy = session("ardupilot")
    mission = write_waypoints(tmp_path / "mission.txt", flying.mission)
    proxy.type(f"wp ftpload {mission}", rf"Sent waypoint of length {len(flying.mission)} in")
    # MAVProxy says so when it has sent the last part, not when the vehicle has taken it.
    mission_held = flying.vehicle.pilot.mission
    tools.wait_until(lambda: len(mission_held.items) == len(flying.mission) - 1, what="the mission")
    assert [item.command for item in mission_held.items] == [item.command for item in flying.mission[1:]]
    proxy.type("wp ftp", "Saved waypoints to")
    rally = "rally.txt"
    home = flying.home
    row = [0, 0, 3, 5100, 0, 0, 0, 0, home.latitude_deg, home.longitude_deg + 1e-4, 12, 1]
    (tmp_path / rally).write_text("QGC WPL 110\n" + "\t".join(map(str, row)) + "\n")
    proxy.type(f"rally ftpload {rally}", "Sent rally item of length 1 in")
    server = flying.vehicle._plans.server
    tools.wait_until(lambda: len(server.plan(MissionType.RALLY).items) == 1, what="the rally point")
    (tmp_path / "few.parm").write_text("WPNAV_SPEED 600\nFS_THR_ENABLE 3\n")
    proxy.type("param ftpload few.parm", "Sending 2 params")
    value = flying.vehicle._parameters.value
    tools.wait_until(lambda: value("WPNAV_SPEED") == 600.0, what="the speed")
    tools.wait_until(lambda: value("FS_THR_ENABLE") == 3.0, what="the failsafe")
    proxy.type("ftp list @SYS", "tasks.txt")


def test_a_vehicle_is_flown_by_typed_channels(session, tools):
    # At real time: a pause of a second is a failsafe.
    flying, proxy = session("ardupilot", speed=1.0)
    pilot = flying.vehicle.pilot
    proxy.type("mode loiter", "Mode LOITER")
    proxy.type("rc 3 1500")
    proxy.type("arm throttle", "AP: Arming motors")
    proxy.type("rc 3 1900")
    tools.wait_until(lambda: pilot.state.position_m[2] > 2.0, what="the climb")
    proxy.type("rc 3 1500")
    proxy.type("rc 2 1300")
    tools.wait_until(lambda: pilot.state.velocity_m_s[1] > 2.0, what="the way forward")
    proxy.type("rc all 0")
    proxy.expect("AP: Radio Failsafe$")
    tools.wait_until(lambda: pilot.mode.value == "return", what="the return")
