"""The page on the architecture knows every room, its picture can be drawn, and every decision is listed."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FLOORS = ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for floor in FLOORS
    for path in (ROOT / floor).rglob("__init__.py")
)
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_every_room_of_the_vehicle_is_in_the_table():
    rooms = {path.parent.name for path in (ROOT / "sim_vehicle").glob("*/__init__.py")}
    rows = set(re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE))
    assert rooms == rows


def test_every_decision_is_listed():
    pages = {path.name for path in (ROOT / "docs" / "decisions").glob("0*.md")}
    index = (ROOT / "docs" / "decisions" / "index.md").read_text(encoding="utf-8")
    assert pages == set(re.findall(r"\((0[\w-]+\.md)\)", index))


def test_the_files_that_it_sends_a_reader_to_exist():
    table = PAGE.split("## I want to ...")[1].split("##")[0]
    named = re.findall(r"`((?:wbf_mission|sim_vehicle|mission|sensors|benchmarks)/[\w/.]*)`", table)
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_picture_is_that_of_the_code():
    drawing = importlib.import_module("draw_architecture")
    assert drawing.check(drawing.PICTURE) == []


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


@pytest.mark.parametrize("package", PACKAGES)
def test_the_face_of_a_package_says_what_it_is_and_gives_what_it_names(package):
    """It has a docstring; what it gives on is in `__all__`, and what is there can be had."""
    face = importlib.import_module(package)
    assert face.__doc__
    source = Path(face.__file__).read_text(encoding="utf-8")
    given = set(re.findall(r"^ {0,4}from [\w.]+ import (\w+) as \1$", source, re.MULTILINE))
    named = set(getattr(face, "__all__", ()))
    assert given <= named
    for name in named:
        getattr(face, name)


def test_what_pages_and_examples_import_is_public():
    """A name that a reader is told to import from a package is one that its face names."""
    texts = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs" / "examples").glob("*.py")]
    told = 0
    for path in texts:
        for package, names in re.findall(
            r"^from ([\w.]+) import ([\w, ]+)$", path.read_text("utf-8"), re.MULTILINE
        ):
            if package in PACKAGES:
                face = importlib.import_module(package)
                for name in names.replace(" ", "").split(","):
                    told += 1
                    is_module = (
                        f"{package}.{name}" in PACKAGES
                        or (ROOT / package.replace(".", "/") / f"{name}.py").exists()
                    )
                    assert is_module or name in face.__all__, f"{path}: {name} of {package}"
    assert told > 20
