"""The core does its work where there are no add-ons."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from bench_rows import made_row

from geo import imports
from wbf_mission.bench.rows import BenchStore, read_rows
from wbf_mission.cli.app import main
from wbf_mission.cli.command import PAGES

HIDDEN = Path(__file__).parents[2] / "support" / "core_alone"
ROOT = Path(__file__).parents[3]
FARMS = ROOT / "wbf_mission" / "scenario" / "catalogue" / "WBF" / "farms"


ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (HIDDEN, ROOT)))}

# One process for all commands: it finds no add-ons.
COMMANDS = """
import contextlib, io, json, os, sys
from wbf_mission.cli.app import main

told = []
for folder, words in json.loads(sys.argv[1]):
    os.chdir(folder)
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(words.split())
    told.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(told))
"""
WORKS = (
    "plan --farm miniberry-10 --planner spiral --out mine.plan --quiet",
    "fly --farm miniberry-10 --policy greedy --estimator gp --budget 60s --out flown --quiet",
    "fly --farm miniberry-10 --policy greedy --budget 60s --autopilot ardupilot --no-files",
    "bench run --scenarios WBF/Miniberry-10-v1 --planners spiral --estimators point --seeds 1 --out new",
    "bench run --family own --planners spiral --seeds 1 --out new",
)
BROUGHT = (
    *("check", "check-policy", "command", "convert", "download", "export", "map", "monitor", "preflight"),
    *("report", "sim", "studio", "upload", "warm-up", "bench compare", "bench list", "bench replay"),
    *("farm", "vehicle"),
)
OTHER_FORMAT = "plan --farm miniberry-10 --mission a.kml"
OTHER_VEHICLES = (
    "plan --farm miniberry-10 --vehicle rover",
    "plan --farm miniberry-10 --vehicle mine.toml",
    "bench run --scenarios WBF/Miniberry-100-Mixed-v1 --planners spiral --seeds 1 --out new",
)
FLY = "fly --farm miniberry-10 --planner spiral"
MISSING = {
    f"{FLY} --live 0": "brings the page 'live' (wbf_mission.pages)",
    f"{FLY} --connect udpin:127.0.0.1:0 --yes": (
        "connects to real vehicles with 'fly' (wbf_mission.connections)"
    ),
    f"{FLY} --fault loss=0.1": "injects faults with 'session' (wbf_mission.faults)",
    "fly --scenario broken.toml": "injects faults with 'tables' (wbf_mission.faults)",
    f"{FLY} --animate --out flown": "makes 'run.gif' (wbf_mission.products)",
    f"{FLY} --treatment-map --out flown": "makes 'treatment' (wbf_mission.products)",
    "bench run --sealed a.secret --out b": "opens rounds that are 'sealed' (wbf_mission.rounds)",
    "plan --farm miniberry-10 --height-above-ground 10 --terrain a.tif": (
        "reads heights of the ground from 'rasters' (wbf_mission.ground)"
    ),
    "plan --farm a.geojson --repair": "repairs farms, as 'mended' (wbf_mission.farm_repairs)",
    **{
        f"plan --farm a.{suffix}|fields": f"reads farms in '{suffix}' (wbf_mission.farm_formats)"
        for suffix in ("gpkg", "kml", "poly")
    },
}
NO_PICTURES = "fly --farm miniberry-10 --vehicle ideal --budget 40steps --out flown"


def add_row(folder):
    store = BenchStore(folder / "rows")
    store.add(made_row("spiral", 1, [0.5], scenario="WBF/Miniberry-10-v1"))
    store.close()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What each command says, and whether it left its folder as it was."""
    folders = {}
    for words in (*WORKS, *BROUGHT, OTHER_FORMAT, *OTHER_VEHICLES, *MISSING, NO_PICTURES):
        folders[words] = tmp_path_factory.mktemp("alone")
        (folders[words] / "mine.toml").write_text('kind = "rover"\n')
        (folders[words] / "broken.toml").write_text("[[fault]]\nkind = 'link-loss'\n")
        for name in ("a.secret", "a.gpkg", "a.kml", "a.poly"):
            (folders[words] / name).write_bytes(b"")
        (folders[words] / "a.geojson").write_bytes((FARMS / "pair.geojson").read_bytes())
        add_row(folders[words])
    before = {words: sorted(folder.rglob("*")) for words, folder in folders.items()}
    asked = json.dumps([(str(folder), words) for words, folder in folders.items()])
    command = [sys.executable, "-c", COMMANDS, asked]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = {}
    for (words, folder), (code, out, err) in zip(folders.items(), json.loads(done.stdout), strict=True):
        is_kept = sorted(folder.rglob("*")) == before[words]
        found[words] = SimpleNamespace(code=code, out=out, err=err, is_kept=is_kept, folder=folder)
    return found


@pytest.mark.parametrize("words", WORKS)
def test_a_command_works_without_add_ons(alone, words):
    assert alone[words].code == 0, alone[words].err


def test_the_default_estimator_and_those_of_a_family_are_of_the_core(alone):
    assert "greedy, gp, " in alone[WORKS[2]].out
    assert {row.estimator for row in read_rows(alone[WORKS[4]].folder / "new")} == {"adaptive-disk", "gp"}


@pytest.mark.parametrize("words", BROUGHT)
def test_what_add_ons_bring_is_not_there(alone, words):
    assert (alone[words].code, "No such command" in alone[words].err) == (2, True), alone[words].err


def test_files_of_add_ons_are_of_no_known_format(alone):
    assert alone[OTHER_FORMAT].code == 2
    said = " ".join(alone[OTHER_FORMAT].err.split())
    assert "missions are read from .plan, .waypoints, .wpl, .txt or .json" in said


@pytest.mark.parametrize("words", OTHER_VEHICLES)
def test_a_vehicle_of_an_add_on_is_refused_in_one_line_that_names_it(alone, words):
    done = alone[words]
    assert (done.code, done.out) == (2, ""), done.err
    assert done.err.startswith("error: ") and done.err.count("\n") == 1
    assert "fixed-wing (wbf_mission.addons.wings), rover (wbf_mission.addons.rovers)" in done.err


@pytest.mark.parametrize(("words", "missing"), MISSING.items())
def test_a_part_that_no_add_on_brings_is_named_before_anything_is_done(alone, words, missing):
    done = alone[words]
    line = re.fullmatch(r"(?:note: no pictures, .*\n)?error: (?:farm file \S+: )?(.*)\n", done.err)
    assert (done.code, line and line[1]) == (
        2,
        f"no installed package {missing}: install wbf-mission again",
    ), done.err
    assert done.is_kept


def test_without_the_add_on_a_flight_is_saved_without_pictures(alone):
    done = alone[NO_PICTURES]
    said = "note: no pictures, since no installed package makes 'path.png' (wbf_mission.products)\n"
    assert (done.code, done.err.count(said)) == (0, 1), done.err
    assert (done.folder / "flown" / "result.json").is_file() and not list(done.folder.rglob("*.png"))


VEHICLES = """
from mission.link.codec.dialect import mavlink as m
from mission.model import GeoPoint
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import get_kind, kind_of_type
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink import SimVehicle

vehicle = SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15, 10.0))
(version,) = vehicle.built(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
ftp = m.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251)
print(version.capabilities & m.MAV_PROTOCOL_CAPABILITY_FTP, vehicle.receive(ftp, 1.0))
copter = SimVehicle(with_autopilot(get_vehicle("quad"), "ardupilot"), GeoPoint(28.05, -82.15, 10.0))
bits = m.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED, m.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
print(copter.built(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION)[0].capabilities & sum(bits))
print(kind_of_type(1), kind_of_type(10), get_kind(kind_of_type(2)).typical)
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
        print(get_kind(kind_of_type(mav_type)).typical)
    except VehicleError as error:
        print("not installed" in str(error))
"""


def test_a_vehicle_has_no_extras_and_heartbeats_of_other_kinds_are_not_taken_for_multirotors():
    command = [sys.executable, "-c", VEHICLES]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    told = [
        "0 []",
        "0",
        "fixed-wing rover quad",
        "3 None",
        "[] () None",
        "3",
        "follow me holding",
        "True",
        "True",
    ]
    assert done.stdout.split("\n")[:9] == told, done.stderr


@pytest.mark.parametrize(
    ("command", "page"),
    [("bench replay rows spiral1 --out written", "run"), ("report rows --out written.html", "bench.report")],
)
def test_add_ons_ask_for_pages_as_the_core_does(tmp_path, monkeypatch, capsys, command, page):
    add_row(tmp_path)
    there = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    found = imports.entry_points
    monkeypatch.setattr(imports, "entry_points", lambda group: [] if group == PAGES else found(group))
    assert main(command.split()) == 2
    assert f"brings the page '{page}' (wbf_mission.pages)" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == there


def test_a_contract_check_that_no_add_on_brings_is_named():
    command = [sys.executable, "-c", "from wbf_mission import check_policy"]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    said = "no installed package brings 'check_policy' (wbf_mission.contracts): "
    assert done.stderr.endswith(f"geo.errors.WbfMissionError: {said}install wbf-mission again\n")


def test_every_part_says_on_a_short_page_what_it_is():
    addons = [path.parent for path in (ROOT / "wbf_mission" / "addons").glob("*/__init__.py")]
    parts = [ROOT / name for name in ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")]
    for part in (*parts, ROOT / "wbf_mission" / "addons", *addons):
        assert len((part / "README.md").read_text().splitlines()) <= 30
