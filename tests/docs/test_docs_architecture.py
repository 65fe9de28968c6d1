"""The page on the architecture knows every room and every decision, and its picture can be drawn."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_every_room_of_the_vehicle_is_in_the_table():
    rooms = {path.parent.name for path in (ROOT / "sim_vehicle").glob("*/__init__.py")}
    rows = set(re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE))
    assert rooms == rows


def test_every_decision_is_listed():
    pages = {path.name for path in (ROOT / "docs" / "decisions").glob("0*.md")}
    assert pages == set(re.findall(r"\(decisions/([\w-]+\.md)\)", PAGE))


def test_the_files_that_it_sends_a_reader_to_exist():
    table = PAGE.split("## I want to ...")[1].split("##")[0]
    named = re.findall(r"`((?:wbf_mission|sim_vehicle|mission|sensors|benchmarks)/[\w/.]*)`", table)
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_picture_is_drawn_from_the_code(tmp_path):
    out = tmp_path / "architecture.png"
    command = [sys.executable, str(ROOT / "docs" / "draw_architecture.py"), "--out", str(out)]
    subprocess.run(command, check=True, cwd=ROOT)
    assert out.read_bytes().startswith(b"\x89PNG")


def test_the_walk_through_a_flight_names_what_there_is():
    page = (ROOT / "docs" / "flight-in-code.md").read_text(encoding="utf-8")
    stops = re.findall(r"`([\w/]+\.py)`: `(\w+)`", page)
    assert len(stops) > 30
    for file, name in stops:
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^ *(?:def|class) {name}\b", text, re.MULTILINE), (file, name)


def test_every_room_of_the_application_is_told_of():
    rooms = {path.parent.name for path in (ROOT / "wbf_mission").glob("*/__init__.py")}
    told = PAGE.split("## The rooms of the application")[1].split("##")[0]
    assert rooms == set(re.findall(r"`(\w+)`", told)) - {"resolve"}
