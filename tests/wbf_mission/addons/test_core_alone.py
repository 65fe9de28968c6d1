"""The core does its work where there are no add-ons."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from bench_rows import made_row

from wbf_mission.bench.rows import BenchStore
from wbf_mission.cli import pages
from wbf_mission.cli.app import main

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
    ],
)
def test_a_command_works_without_add_ons(tmp_path, command):
    done = run(tmp_path, *command.split())
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", ["check", "export", "report", "studio"])
def test_what_add_ons_bring_is_not_there(tmp_path, command):
    done = run(tmp_path, command)
    assert (done.returncode, "No such command" in done.stderr) == (2, True), done.stderr


def test_files_of_add_ons_are_of_no_known_format(tmp_path):
    done = run(tmp_path, "convert", "a.kml", "a.plan")
    assert done.returncode == 2
    said = " ".join(done.stderr.split())
    assert "missions are read from .plan, .waypoints, .wpl, .txt, .fen, .ral or .json" in said


@pytest.mark.parametrize(
    ("command", "page"),
    [
        ("fly --farm miniberry-10 --planner spiral --connect udpin:127.0.0.1:0 --yes --live 0", "live"),
        ("bench report rows --out written", "bench"),
        ("bench replay rows spiral1 --out written", "run"),
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


@pytest.mark.parametrize("command", ["bench board no.zip --out written", "bench paper --out written"])
def test_add_ons_ask_for_pages_as_the_core_does(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pages, "entry_points", lambda group: [])
    assert main(command.split()) == 2
    assert "brings the page 'bench' (wbf_mission.pages)" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_every_part_says_on_a_short_page_what_it_is():
    addons = [path.parent for path in (ROOT / "wbf_mission" / "addons").glob("*/__init__.py")]
    parts = [ROOT / name for name in ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")]
    for part in (*parts, ROOT / "wbf_mission" / "addons", *addons):
        assert len((part / "README.md").read_text().splitlines()) <= 30
