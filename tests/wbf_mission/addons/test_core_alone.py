"""The core does its work where there are no add-ons."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from bench_rows import made_row

from geo import imports
from wbf_mission.bench.rows import BenchStore
from wbf_mission.cli.app import main
from wbf_mission.cli.pages import GROUP

HIDDEN = Path(__file__).parents[2] / "support" / "core_alone"
ROOT = Path(__file__).parents[3]


def run(folder, *words):
    path = os.pathsep.join(map(str, (HIDDEN, ROOT)))
    return subprocess.run(
        [sys.executable, "-m", "wbf_mission", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "command",
    [
        "plan --farm miniberry-10 --planner spiral --out mine.plan --quiet",
        "fly --farm miniberry-10 --policy greedy --estimator gp --budget 60s --out flown --quiet",
        "bench run --scenarios WBF/Miniberry-10-v1 --planners spiral --estimators point --seeds 1 --out rows",
        "check-policy greedy",
        "vehicle list",
        "bench list",
    ],
)
def test_a_command_works_without_add_ons(tmp_path, command):
    done = run(tmp_path, *command.split())
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["check", "export", "map", "report", "studio", "bench replay"])
def test_what_add_ons_bring_is_not_there(tmp_path, command):
    done = run(tmp_path, *command.split())
    assert (done.returncode, "No such command" in done.stderr) == (2, True), done.stderr


def test_files_of_add_ons_are_of_no_known_format(tmp_path):
    done = run(tmp_path, "convert", "a.kml", "a.plan")
    assert done.returncode == 2
    said = " ".join(done.stderr.split())
    assert "missions are read from .plan, .waypoints, .wpl, .txt, .fen, .ral or .json" in said


@pytest.mark.parametrize(
    "words",
    [
        "vehicle show wing",
        "plan --farm miniberry-10 --vehicle rover",
        "sim --vehicle fixed-wing",
        "vehicle show mine.toml",
        "bench run --scenarios WBF/Miniberry-100-Mixed-v1 --planners spiral --seeds 1 --out rows",
    ],
)
def test_a_vehicle_of_an_add_on_is_refused_in_one_line_that_names_it(tmp_path, words):
    (tmp_path / "mine.toml").write_text('kind = "rover"\n')
    done = run(tmp_path, *words.split())
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert "fixed-wing (wbf_mission.addons.wings), rover (wbf_mission.addons.rovers)" in done.stderr


VEHICLES = """
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from mission.transfer.vehicles import Vehicle
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import kind_of_type
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.live.discovery import typical_vehicle

vehicle = SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15, 10.0))
(version,) = vehicle.built(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
ftp = m.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251)
print(version.capabilities & m.MAV_PROTOCOL_CAPABILITY_FTP, vehicle.receive(ftp, 1.0))
print(kind_of_type(1), kind_of_type(10), typical_vehicle(Vehicle(1, 1, 12, 2)))
pitch = m.MAVLink_command_long_message(1, 1, 1000, 0, -30, 0, 0, 0, 0, 0, 0)
print(vehicle.receive(pitch, 1.0)[0].result, vehicle.camera_attitude(0.0))
stick = m.MAVLink_manual_control_message(1, 0, 0, 900, 0, 0)
print(vehicle.receive(stick, 1.0), vehicle.built(m.MAVLINK_MSG_ID_RAW_IMU), vehicle.pilot.sticks)
circle = m.MAVLink_command_long_message(1, 1, m.MAV_CMD_DO_ORBIT, 0, 10, 0, 0, 0, 0, 0, 0)
print(vehicle.receive(circle, 1.0)[0].result)
vehicle.pilot.arm()
vehicle.pilot.takeoff(10.0)
vehicle.poll(20.0)
vehicle.pilot.set_mode(Mode.FOLLOW)
vehicle.poll(40.0)
print(vehicle.pilot.mode.value, vehicle.pilot.state.phase.value)
for mav_type in (1, 10):
    try:
        print(typical_vehicle(Vehicle(1, 1, 12, mav_type)))
    except VehicleError as error:
        print("not installed" in str(error))
"""


def test_a_vehicle_has_no_extras_and_heartbeats_of_other_kinds_are_not_taken_for_multirotors():
    path = os.pathsep.join(map(str, (HIDDEN, ROOT)))
    done = subprocess.run(
        [sys.executable, "-c", VEHICLES],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    told = ["0 []", "fixed-wing rover quad", "3 None", "[] () None", "3", "follow me holding", "True", "True"]
    assert done.stdout.split("\n")[:8] == told, done.stderr


@pytest.mark.parametrize(
    ("command", "page"),
    [
        ("fly --farm miniberry-10 --planner spiral --connect udpin:127.0.0.1:0 --yes --live 0", "live"),
        ("bench report rows --out written", "bench"),
    ],
)
def test_a_page_that_no_add_on_brings_is_refused_before_anything_is_done(tmp_path, command, page):
    store = BenchStore(tmp_path / "rows")
    store.add(made_row("spiral", 1, [0.5], scenario="WBF/Miniberry-10-v1"))
    store.close()
    there = sorted(tmp_path.rglob("*"))
    done = run(tmp_path, *command.split())
    told = f"error: no package that is installed brings the page '{page}' (wbf_mission.pages): "
    assert (done.returncode, done.stderr) == (2, told + "install wbf-mission anew\n")
    assert sorted(tmp_path.rglob("*")) == there


@pytest.mark.parametrize(("option", "name"), [("--animate", "run.gif"), ("--treatment-map", "treatment")])
def test_a_product_that_no_add_on_makes_is_refused_before_anything_flies(tmp_path, option, name):
    done = run(tmp_path, "fly", "--farm", "miniberry-10", "--planner", "spiral", option, "--out", "flown")
    said = f"error: no package that is installed makes '{name}' (wbf_mission.products): "
    assert (done.returncode, done.stderr) == (2, said + "install wbf-mission anew\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "page"),
    [
        ("bench board no.zip --out written", "bench"),
        ("bench paper --out written", "bench"),
        ("bench replay rows spiral1 --out written", "run"),
    ],
)
def test_add_ons_ask_for_pages_as_the_core_does(tmp_path, monkeypatch, capsys, command, page):
    store = BenchStore(tmp_path / "rows")
    store.add(made_row("spiral", 1, [0.5], scenario="WBF/Miniberry-10-v1"))
    store.close()
    there = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    found = imports.entry_points
    monkeypatch.setattr(imports, "entry_points", lambda group: [] if group == GROUP else found(group))
    assert main(command.split()) == 2
    assert f"brings the page '{page}' (wbf_mission.pages)" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == there


def test_every_part_says_on_a_short_page_what_it_is():
    addons = [path.parent for path in (ROOT / "wbf_mission" / "addons").glob("*/__init__.py")]
    parts = [ROOT / name for name in ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")]
    for part in (*parts, ROOT / "wbf_mission" / "addons", *addons):
        assert len((part / "README.md").read_text().splitlines()) <= 30
