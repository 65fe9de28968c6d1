"""Commands that read a farm read it alike, and say nothing that the user cannot do."""

import ast
import json
from pathlib import Path

import pytest
from advice import FLAG, commands, flags_of, misadvice, named_in

import geo
from mission.files import write_mission
from mission.model import Mission, MissionItem
from wbf_mission.cli.app import main
from wbf_mission.cli.options import READS_FARM

ROOT = Path(geo.__file__).parents[1]
HOW = {"--" + key.replace("_", "-") for key in READS_FARM}
READERS = {
    "plan": [],
    "fly": ["--no-files"],
    "map": ["--out", "{folder}/map", "--observations", "{folder}/leaves.csv"],
    "sim": [],
    "studio": [],
    "monitor": ["udpin:127.0.0.1:0", "--live", "0", "--duration", "0.1"],
    "preflight": ["{folder}/a.plan"],
    "upload": ["{folder}/a.plan"],
    "farm show": [],
    "farm draw": ["--out", "{folder}/farm.png"],
    "farm save": ["--out", "{folder}/farm.geojson"],
    "farm generate": ["--out", "{folder}/environments"],
}
"""The commands that read a farm, with what they need besides."""


def square(x=0.0, **properties):
    ring = [[10 + x, 50], [10.002 + x, 50], [10.002 + x, 50.002], [10 + x, 50.002], [10 + x, 50]]
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }


def farm_file(*features, **members):
    return json.dumps({"type": "FeatureCollection", **members, "features": features})


BOW_TIE = square(crop="rye")
BOW_TIE["geometry"]["coordinates"][0][1:3] = BOW_TIE["geometry"]["coordinates"][0][2:0:-1]
FAR = square(crop="rye")
FAR["geometry"]["coordinates"] = [[[5e5, 5e6], [5e5 + 80, 5e6], [5e5 + 80, 5e6 + 80], [5e5, 5e6]]]
FOREIGN = {"--porcelain", "--no-optional-locks", "--nthreads"}  # of git and Dask
BAD = {
    "some patches without a crop": farm_file(square(crop="wheat"), square(0.002)),
    "some without an owner": farm_file(square(crop="rye", owner="me"), square(0.002, crop="rye")),
    "a bow tie": farm_file(BOW_TIE),
    "no coordinate system": farm_file(FAR),
    "labels only": farm_file({"type": "Feature", "properties": {}, "geometry": None}),
    "cells too small": farm_file(square(crop="rye"), cell_size_m=0.01),
    "no JSON": "{",
}


@pytest.fixture
def folder(tmp_path):
    write_mission(Mission((MissionItem.waypoint(50.001, 10.001, 10.0),)), tmp_path / "a.plan")
    (tmp_path / "leaves.csv").write_text("lat,lon,soil\n50.001,10.001,0.5\n")
    return tmp_path


def words(name, farm, folder):
    rest = [one.format(folder=folder) for one in READERS[name]]
    is_argument = any(
        param.name == "farm" for param in commands()[name].params if not param.opts[0].startswith("-")
    )
    return [*name.split(), *([] if is_argument else ["--farm"]), str(farm), *rest]


def test_every_command_that_reads_a_farm_reads_it_alike():
    reads = {name for name in commands() if "--farm" in flags_of(name)}
    reads |= {name for name, one in commands().items() if any(param.name == "farm" for param in one.params)}
    assert reads == set(READERS)
    assert {"--crop", "--farm-crs", "--repair"} <= HOW
    assert {name: HOW - flags_of(name) for name in READERS} == {name: set() for name in READERS}


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", READERS)
def test_what_is_wrong_with_a_farm_is_told_in_a_line(name, bad, folder, capsys):
    (folder / "fields.json").write_text(BAD[bad])
    arguments = words(name, folder / "fields.json", folder)
    before = sorted(folder.iterdir())
    assert main(arguments) == 2
    told = capsys.readouterr()
    (line,) = told.err.splitlines()
    assert line.startswith(f"error: farm file {folder / 'fields.json'}: ")
    assert not misadvice(arguments, line)
    assert told.out == ""
    assert sorted(folder.iterdir()) == before


def texts_of(module):
    """The texts in a module that are no docstrings, with the lines on which they begin."""
    source = module.read_text(encoding="utf-8")
    tree = ast.parse(source if FLAG.search(source) else "")
    bare = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if id(node) in bare:
            continue
        if isinstance(node, ast.JoinedStr):
            bare |= {id(part) for part in node.values}
            parts = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
            yield node.lineno, "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def test_every_option_that_a_text_names_is_one_of_some_command():
    known = set().union({"--version"}, FOREIGN, *map(flags_of, commands()))
    wrong = []
    for package in geo.errors.PACKAGES:
        for module in (ROOT / package).rglob("*.py"):
            for line, text in texts_of(module):
                for found in FLAG.finditer(text):
                    whose = named_in(text[: found.start()].rpartition("wbf-mission ")[2])
                    there = known if whose is None else flags_of(whose)
                    if found[0] not in there:
                        wrong.append(f"{module.relative_to(ROOT)}:{line}: {whose or ''} {found[0]}")
    assert not wrong


@pytest.mark.parametrize("name", ["map", "monitor", "preflight"])
def test_what_is_left_out_of_a_farm_is_told(name, folder, capsys):
    place = [[10.0005, 50.0005], [10.0015, 50.0005], [10.0015, 50.0015], [10.0005, 50.0015]]
    field = {"type": "Polygon", "coordinates": [place]}
    label = {"type": "Point", "coordinates": place[0]}
    geometries = [(field, {"crop": "tomato"}), (label, {"name": "Silo"})]
    lines = [json.dumps({"type": "Feature", "properties": p, "geometry": g}) for g, p in geometries]
    (folder / "fields.geojsonl").write_text("\n".join(lines))
    assert main(words(name, folder / "fields.geojsonl", folder)) in (0, 1, 3)
    told = capsys.readouterr().err
    assert "1 feature left out (points that are neither home nor rally): Silo" in told
    assert "feature 1 ('patch 1'): an open ring was closed over " in told
