"""Farms of other programs' files on the command line, in scenario files and in results."""

import json

import numpy as np
import pyogrio.raw
import pytest
import shapely
from command_line import ran

from geo import load_farm
from wbf_mission.scenario import load_scenario

X, Y = 386_900.0, 3_103_300.0  # UTM 17N, near Plant City


@pytest.fixture
def fields(tmp_path):
    """Return a GeoPackage of two layers, one of them with a spike."""
    path = tmp_path / "fields.gpkg"
    spiked = [(0, 0), (40, 0), (40, 20), (60, 20), (40, 20), (40, 30), (0, 30)]
    for layer, corners in (("2025", [(0, 0), (30, 0), (30, 30), (0, 30)]), ("2026", spiked)):
        shape = shapely.Polygon([(X + x, Y + y) for x, y in corners])
        pyogrio.raw.write(
            path,
            np.array([shapely.to_wkb(shape)], object),
            [np.array(["acker"], object)],
            np.array(["name"]),
            geometry_type="Polygon",
            crs="EPSG:32617",
            layer=layer,
            append=path.exists(),
        )
    return path


def test_show_and_save_say_what_was_mended(fields, tmp_path, capsys):
    saved = tmp_path / "farm.geojson"
    _, err = ran(capsys, "farm", "save", f"{fields}|2026", "--out", str(saved), code=2)
    assert err.count("\n") == 1 and "feature 1 ('acker'): the polygon is not valid: Self-intersection" in err
    assert not saved.exists()
    words = ("--repair", "--crop", "maize")
    _, err = ran(capsys, "farm", "save", f"{fields}|layername=2026", "--out", str(saved), *words)
    assert err == "note: feature 1 ('acker'): mended (self-intersection): 1200.6 -> 1200.6 m2\n"
    farm = load_farm(saved)
    assert [(one.name, one.crop) for one in farm.patches] == [("acker", "maize")]
    document = json.loads(ran(capsys, "farm", "show", f"{fields}|2025", "--json", "-q")[0])
    assert document["notes"] == ["no patch names its crop: the crop is called 'crop'; --crop gives a name"]
    assert ran(capsys, "farm", "draw", str(saved), "--out", str(tmp_path / "farm.png"), "-q")[1] == ""


def test_a_plan_of_a_layer_beside_the_scenario_file(fields, capsys):
    scenario = fields.parent / "mine.toml"
    scenario.write_text(
        'farm = "fields.gpkg|layername=2026"\nrepair = true\ncrop = "maize"\nbudget = "300m"\n'
    )
    assert load_scenario(scenario).farm.load().patches[0].crop == "maize"
    out, err = ran(capsys, "plan", "--scenario", str(scenario), "--planner", "lawnmower", "--json")
    assert json.loads(out)["farm"] == "fields"
    assert "note: farm: feature 1 ('acker'): mended (self-intersection)" in err


def test_a_field_without_a_model_is_planned_for_and_not_simulated(fields, capsys):
    layer = fields.parent / "ph.toml"
    layer.write_text(
        '[[field]]\nname = "ph"\nunit = "pH"\nrange = [4, 9]\ndefault = 6.5\ncrops = ["maize"]\n'
    )
    farm = ("--farm", f"{fields}|2025", "--crop", "maize", "--fields", str(layer))
    out, _ = ran(capsys, "plan", *farm, "--planner", "lawnmower", "--budget", "300m", "--json", "-q")
    assert json.loads(out)["waypoints"] > 2
    started = fields.parent / "run"
    _, err = ran(
        capsys, "fly", *farm, "--planner", "lawnmower", "--budget", "300m", "--out", str(started), code=2
    )
    assert err == (
        "error: fields: ph can only be measured, and a simulated camera needs dynamics; "
        'give a kind such as "continuous" and a table [field.dynamics] (docs/fields.md)\n'
    )
    assert not started.exists()


def test_a_field_of_any_crop_is_flown(fields, capsys):
    layer = fields.parent / "water.toml"
    layer.write_text(
        '[[field]]\nname = "water"\nkind = "continuous"\ncrops = ["all"]\n'
        'unit = "%"\nrange = [0, 40]\ndefault = 10\n'
    )
    farm = ("--farm", f"{fields}|2025", "--crop", "maize", "--fields", str(layer), "--vehicle", "ideal")
    words = ("--planner", "lawnmower", "--budget", "300steps", "--no-files", "--no-plots", "--json", "-q")
    out, _ = ran(capsys, "fly", *farm, *words)
    assert json.loads(out)["outcome"] == "completed"
    _, err = ran(capsys, "fly", *farm[:4], *farm[6:], *words, code=2)
    assert "grows maize, but the fields tylcv, ccr, soil are of tomato, strawberry: name fields" in err
