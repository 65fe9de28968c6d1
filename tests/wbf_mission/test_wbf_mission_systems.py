"""Other operating systems: the types hold for macOS and Windows, and nothing needs what only Unix has."""

import subprocess
import sys
from pathlib import Path

import pytest
from processes import running, wait_until
from pymavlink import mavutil

from geo.farms import get_farm
from mission.files.formats import open_mission
from mission.link.codec.dialect import mavlink as m
from sensors.field_files import read_fields
from sim_vehicle.airframe.catalog import load_vehicle
from wbf_mission.scenario.files import load_scenario

ROOT = Path(__file__).parents[2]
CORE = ["geo", "sensors", "mission", "sim_vehicle", "wbf_mission"]


@pytest.mark.slow
def test_the_types_hold_on_windows():
    cache = ROOT / ".mypy_cache" / "win32"  # mypy discards a cache of another platform
    words = [sys.executable, "-m", "mypy", "--platform", "win32", f"--cache-dir={cache}"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


BARE = """
import importlib, os, pkgutil, signal, sys, time

# Libraries ask for the system when they are imported: they come first.
import joblib, multiprocessing.resource_tracker, platformdirs, psutil

for name in ("fcntl", "grp", "pwd", "resource", "syslog", "termios", "tty", "pty"):
    sys.modules[name] = None
for module, names in (
    (os, "fork forkpty getpgid killpg sched_getaffinity setsid sysconf getloadavg mkfifo"),
    (signal, "SIGHUP SIGKILL SIGALRM SIG_BLOCK SIG_SETMASK pthread_sigmask sigwait alarm"),
    (time, "CLOCK_BOOTTIME CLOCK_MONOTONIC clock_gettime"),
):
    for name in names.split():
        delattr(module, name)
"""

IMPORTS = """
for package in sys.argv[1:]:
    for found in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
        if ".addons" not in found.name and not found.name.endswith("__main__"):
            importlib.import_module(found.name)

from geo.processes import interrupts_held

with interrupts_held():
    pass
"""

COMMAND = """
from wbf_mission.__main__ import main

sys.exit(main())
"""


def run_bare(code, *words, folder):
    done = subprocess.run(
        [sys.executable, "-c", BARE + code, *words], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_modules_of_the_core_are_imported_without_what_only_unix_has(tmp_path):
    run_bare(IMPORTS, *CORE, folder=tmp_path)


@pytest.mark.slow
def test_a_plan_and_a_flight_need_nothing_that_only_unix_has(tmp_path):
    farm = ["--farm", "miniberry-10", "--seed", "1"]
    run_bare(COMMAND, "plan", *farm, "--out", "plan.plan", folder=tmp_path)
    run_bare(COMMAND, "fly", *farm, "--out", "run", folder=tmp_path)
    words = (*farm, "--days", "1", "--jobs", "-1")
    run_bare(COMMAND, "farm", "generate", *words, "--out", "environments", folder=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"plan.plan", "run", "environments"}


@pytest.mark.slow
def test_a_client_uploads_to_a_simulator_without_what_only_unix_has(tmp_path):
    ready = tmp_path / "ready"
    words = ["sim", "--farm", "miniberry-10", "--ready-file", "ready", "--listen", "udpin:127.0.0.1:0"]
    with running([sys.executable, "-c", BARE + COMMAND, *words], tmp_path, stdout=subprocess.DEVNULL):
        wait_until(ready.exists, "the simulator does not start")
        link = mavutil.mavlink_connection(ready.read_text().strip().replace("udpin", "udpout"))
        try:
            wait_until(lambda: answers(link, "HEARTBEAT"), "a heartbeat")
            link.mav.mission_count_send(1, 1, 2, 0)
            for number in range(2):
                wait_until(lambda: answers(link, "MISSION_REQUEST_INT"), f"a request of item {number}")
                place = (int(28.0583e7), int(-82.1417e7) + 1000 * number, 20.0)
                command = m.MAV_CMD_NAV_WAYPOINT if number else m.MAV_CMD_NAV_TAKEOFF
                link.mav.mission_item_int_send(1, 1, number, 6, command, 0, 1, 0, 0, 0, 0, *place)
            assert wait_until(lambda: answers(link, "MISSION_ACK"), "an acknowledgement").type == 0
        finally:
            link.close()


def answers(link, kind):
    """Return the next message of a kind; until one comes, the client's heartbeat is sent."""
    link.mav.heartbeat_send(m.MAV_TYPE_GCS, m.MAV_AUTOPILOT_INVALID, 0, 0, 0)
    return link.recv_match(type=kind, blocking=True, timeout=1.0)


@pytest.mark.parametrize(
    ("read", "name"),
    [
        (load_scenario, "missions/windy-lawnmower.toml"),
        (read_fields, "missions/fields/nitrogen.toml"),
        (load_vehicle, "sim_vehicle/airframe/vehicles/mini-quad.toml"),
        (get_farm, "missions/strawberry-field.kml"),
        (get_farm, "tests/data/foreign/label.geojson"),
        (get_farm, "tests/data/foreign/missionplanner.poly"),
        (open_mission, "tests/data/plans/survey.plan"),
        (open_mission, "tests/data/foreign/wpl120.waypoints"),
        (open_mission, "tests/data/foreign/mavproxy_fence.txt"),
    ],
)
def test_texts_that_an_editor_of_windows_saved_say_the_same(read, name, tmp_path):
    saved = tmp_path / Path(name).name
    lines = (ROOT / name).read_text(encoding="utf-8-sig").splitlines()
    saved.write_bytes("\r\n".join(["\ufeff" + lines[0], *lines[1:], ""]).encode())
    assert read(saved) == read(ROOT / name)
