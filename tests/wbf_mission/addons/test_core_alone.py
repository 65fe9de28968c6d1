"""The core does its work where there are no add-ons."""

import os
import re
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


def python(*words, folder=None):
    path = os.pathsep.join(map(str, (HIDDEN, ROOT)))
    env = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=env, capture_output=True, text=True, check=False
    )


def run(folder, *words):
    return python("-m", "wbf_mission", *words, folder=folder)


@pytest.mark.parametrize(
    "command",
    [
        "plan --farm miniberry-10 --planner spiral --out mine.plan --quiet",
        "fly --farm miniberry-10 --policy greedy --estimator gp --budget 60s --out flown --quiet",
        "bench run --scenarios WBF/Miniberry-10-v1 --planners spiral --estimators point --seeds 1 --out rows",
        "vehicle list",
        "bench list",
    ],
)
def test_a_command_works_without_add_ons(tmp_path, command):
    done = run(tmp_path, *command.split())
    assert done.returncode == 0, done.stderr


ADDED = ["check", "check-policy", "command", "export", "map", "monitor", "report", "studio"]


@pytest.mark.parametrize("command", [*ADDED, "bench compare", "bench replay", "farm generate"])
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
from sim_vehicle.errors import VehicleError
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.live.discovery import typical_vehicle

vehicle = SimVehicle(get_vehicle("quad"), GeoPoint(28.05, -82.15, 10.0))
(version,) = vehicle.built(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
ftp = m.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251)
print(version.capabilities & m.MAV_PROTOCOL_CAPABILITY_FTP, vehicle.receive(ftp, 1.0))
print(kind_of_type(1), kind_of_type(10), typical_vehicle(Vehicle(1, 1, 12, 2)))
for mav_type in (1, 10):
    try:
        print(typical_vehicle(Vehicle(1, 1, 12, mav_type)))
    except VehicleError as error:
        print("not installed" in str(error))
"""


def test_a_vehicle_has_no_files_and_heartbeats_of_other_kinds_are_not_taken_for_multirotors():
    done = python("-c", VEHICLES)
    assert done.stdout.split("\n")[:4] == ["0 []", "fixed-wing rover quad", "True", "True"], done.stderr


@pytest.fixture
def folder(tmp_path):
    """A folder with the rows of a benchmark, the secret of a round and empty farm files."""
    store = BenchStore(tmp_path / "rows")
    store.add(made_row("spiral", 1, [0.5], scenario="WBF/Miniberry-10-v1"))
    store.close()
    for name in ("a.secret", "a.gpkg", "a.kml", "a.poly"):
        (tmp_path / name).write_bytes(b"")
    return tmp_path


FLY = "fly --farm miniberry-10 --planner spiral"


@pytest.mark.parametrize(
    ("command", "missing"),
    [
        (f"{FLY} --connect udpin:127.0.0.1:0 --yes --live 0", "brings the page 'live' (wbf_mission.pages)"),
        ("sim --live 0 --farm miniberry-10", "brings the page 'live.simulation' (wbf_mission.pages)"),
        ("bench report rows --out written", "brings the page 'bench' (wbf_mission.pages)"),
        (f"{FLY} --animate --out flown", "makes 'run.gif' (wbf_mission.products)"),
        (f"{FLY} --treatment-map --out flown", "makes 'treatment' (wbf_mission.products)"),
        ("bench run --sealed a.secret --out b", "opens rounds that are 'sealed' (wbf_mission.rounds)"),
        *(
            (f"plan --farm a.{suffix}|fields", f"reads farms in '{suffix}' (wbf_mission.farm_formats)")
            for suffix in ("gpkg", "kml", "poly")
        ),
    ],
)
def test_a_part_that_no_add_on_brings_is_named_before_anything_is_done(folder, command, missing):
    there = sorted(folder.rglob("*"))
    done = run(folder, *command.split())
    (said,) = re.fullmatch(r"error: (?:farm file \S+: )?(.*)\n", done.stderr).groups()
    assert (done.returncode, said) == (2, f"no package that is installed {missing}: install wbf-mission anew")
    assert sorted(folder.rglob("*")) == there


def test_without_the_add_on_a_flight_is_saved_without_pictures(tmp_path):
    command = "fly --farm miniberry-10 --vehicle ideal --budget 9steps --out flown"
    done = run(tmp_path, *command.split())
    said = "note: no pictures: no package that is installed makes 'path.png' (wbf_mission.products)\n"
    assert (done.returncode, done.stderr.count(said)) == (0, 1), done.stderr
    assert (tmp_path / "flown" / "result.json").is_file() and not list(tmp_path.rglob("*.png"))
    done = run(tmp_path, "farm", "draw", "miniberry-10", "--out", "farm.png")
    told = "error: no package that is installed makes 'path.png' (wbf_mission.products): "
    assert (done.returncode, done.stderr) == (2, told + "install wbf-mission anew\n")
    assert not (tmp_path / "farm.png").exists()


@pytest.mark.parametrize(
    ("command", "page"),
    [
        ("bench board no.zip --out written", "bench"),
        ("bench paper --out written", "bench"),
        ("bench replay rows spiral1 --out written", "run"),
        ("report rows --out written.html", "bench.report"),
    ],
)
def test_add_ons_ask_for_pages_as_the_core_does(folder, monkeypatch, capsys, command, page):
    there = sorted(folder.rglob("*"))
    monkeypatch.chdir(folder)
    found = imports.entry_points
    monkeypatch.setattr(imports, "entry_points", lambda group: [] if group == GROUP else found(group))
    assert main(command.split()) == 2
    assert f"brings the page '{page}' (wbf_mission.pages)" in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == there


def test_a_contract_check_that_no_add_on_brings_is_named():
    done = python("-c", "from wbf_mission import check_policy")
    said = "no package that is installed brings 'check_policy' (wbf_mission.contracts): "
    assert done.stderr.endswith(f"geo.errors.WbfMissionError: {said}install wbf-mission anew\n")


def test_every_part_says_on_a_short_page_what_it_is():
    addons = [path.parent for path in (ROOT / "wbf_mission" / "addons").glob("*/__init__.py")]
    parts = [ROOT / name for name in ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")]
    for part in (*parts, ROOT / "wbf_mission" / "addons", *addons):
        assert len((part / "README.md").read_text().splitlines()) <= 30
