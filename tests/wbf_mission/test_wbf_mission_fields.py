"""A fourth field from one file: from the environment over MAVLink to score, results and pictures."""

import json

import numpy as np
import pytest

from geo import get_farm
from sensors.camera.leaf_camera import LeafCamera
from sensors.field_files import load_field_set
from sim_vehicle.camera.component import LeafCameraComponent
from wbf_mission.cli.app import main
from wbf_mission.flight import fly
from wbf_mission.results.result import load_result
from wbf_mission.run import resolve
from wbf_mission.scenario import Scenario, load_scenario

NITROGEN = """
[[field]]
name = "nitrogen"
kind = "continuous"
title = "nitrogen in the soil"
unit = "part of the most"
crops = ["tomato"]
default = 0.5
weight = 0.3
cost_above = 2.0
colours = ["#ffffe5", "#41ab5d", "#00441b"]

[field.dynamics]
evaporation = 0.02
rain_probability = 0.3
"""
RUST = """
[[field]]
name = "rust"
kind = "disease"
crops = ["strawberry"]
default = 1.0
cost_above = 10.0
dynamics = { likelihood = 0.3, duration_days = 8 }
"""


@pytest.fixture
def nitrogen(tmp_path):
    path = tmp_path / "nitrogen.toml"
    path.write_text(NITROGEN)
    return path


FLY = ["fly", "--farm", "miniberry-10", "--planner", "lawnmower", "--budget", "60m", "--day", "6"]
NAMES = ("tylcv", "ccr", "soil", "nitrogen")


def test_a_fourth_field_is_flown_estimated_scored_saved_and_drawn(nitrogen, tmp_path):
    out = tmp_path / "run"
    # By an exact estimate: otherwise it swings out over the farm's border, where there is nothing to observe.
    fields = ["--fields", f"tylcv,ccr,soil,{nitrogen}", "--no-estimate-errors"]
    assert main([*FLY, *fields, "--estimator", "gp", "--out", str(out), "--plots", "--quiet"]) == 0

    summary = json.loads((out / "summary.json").read_text())
    assert set(summary["losses"]) == set(NAMES)
    assert summary["camera"]["images"] == summary["camera"]["observations"] > 50
    assert summary["camera"]["other_fields"] == summary["camera"]["malformed"] == 0
    result = load_result(out)
    seen, truth = result.observations, result.truth
    assert seen.fields == result.fields.names == NAMES
    assert result.fields["nitrogen"] == load_field_set([str(nitrogen)])["nitrogen"]
    assert truth is not None and result.model is not None
    value = result.model.value
    assert truth.shape == value.shape == (4, 10, 10)
    # What arrived over MAVLink is what is there, bit for bit.
    np.testing.assert_array_equal(seen.values, truth[:, seen.x, seen.y].T)
    assert len(np.unique(truth[3])) > 50
    mask = load_field_set([str(nitrogen)]).masks(get_farm("miniberry-10").grid())[0]
    error = (value[3] - truth[3])[mask].astype(float)
    loss = np.where(error > 0, 2.0, 1.0) @ error**2 / mask.sum()
    assert result.history.entries[-1].field_loss[3] == pytest.approx(loss, rel=1e-5)
    assert [one.field.name for one in result.maps] == list(NAMES)
    assert summary["losses"]["nitrogen"] == pytest.approx(loss, rel=1e-5)
    assert all((out / f"field_{name}.png").exists() for name in NAMES)


def test_a_scenario_names_a_field_file_that_lies_beside_it(nitrogen):
    (nitrogen.parent / "rust.toml").write_text(RUST)
    path = nitrogen.parent / "mine.toml"
    path.write_text(
        'farm = "miniberry-10"\nvehicle = "ideal"\nestimator = "point"\n'
        'fields = ["rust.toml", "nitrogen.toml", "soil"]\ncamera_fields = ["nitrogen", "rust"]\n'
    )
    result = fly(load_scenario(path))
    assert result.fields.names == ("rust", "nitrogen", "soil")
    assert np.isnan(result.observations.values[:, 2]).all()
    assert set(np.unique(result.observations.values[:, 0])) <= {0.0, 0.5, 1.0}
    assert result.model is not None
    assert result.model.fields == result.fields.names


def test_an_estimator_that_knows_only_the_benchmarks_fields_says_so(nitrogen, tmp_path, capsys):
    out = tmp_path / "run"
    fields = ["--fields", f"tylcv,ccr,soil,{nitrogen}"]
    assert main([*FLY, *fields, "--estimator", "authors-ad", "--out", str(out)]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "estimator 'authors-ad' needs exactly the fields tylcv, ccr, soil; this run has" in told


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("tylcv,rust", "unknown field 'rust': choose tylcv, ccr, soil, or give a file"),
        ("soil,tylcv,soil", "'soil' is given twice"),
        ("soil,missing.toml", "missing.toml: cannot be read as a field file: no such file"),
        ("soil --camera-fields soil,soil", "camera: field 'soil' is given twice"),
    ],
)
def test_fields_that_cannot_be_used_are_one_line(fields, message, tmp_path, capsys):
    assert main([*FLY, "--fields", *fields.split(), "--out", str(tmp_path / "run")]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_a_field_without_a_scored_cell_is_noted(nitrogen, capsys):
    nitrogen.write_text(NITROGEN.replace('["tomato"]', '["tomatoe"]'))
    assert main([*FLY, "--fields", f"tylcv,ccr,soil,{nitrogen}", "--estimator", "point", "--no-files"]) == 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "nitrogen" in line]
    assert line == (
        "farm miniberry-10: grows strawberry, tomato, but the field nitrogen is of tomatoe, so its errors are"
        " not scored"
    )


def test_a_vehicle_that_senses_other_fields_is_warned_of(nitrogen, tmp_path, monkeypatch, capsys):
    other = Scenario(farm="miniberry-10", fields=("tylcv", "ccr", "soil", str(nitrogen)), day=6)

    def carry(_camera, farm, **more):
        fields = load_field_set(other.farm.fields)
        environment = resolve.make_environment(other, farm, use_cache=False)
        (options,) = resolve.cameras_of(other, fields)
        camera = LeafCamera(environment, farm.grid().shape, 6, options, np.random.default_rng(1))
        return LeafCameraComponent(camera, farm, **more)

    monkeypatch.setattr("wbf_mission.run.hosting.LeafCameraComponent", carry)
    out = tmp_path / "run"
    assert main([*FLY, "--out", str(out), "--no-plots", "-q"]) == 1
    told = "the camera senses tylcv, ccr, soil, nitrogen instead of tylcv, ccr, soil; give this command and"
    assert f"warning: {told}" in " ".join(capsys.readouterr().err.split())
    (warning,) = json.loads((out / "summary.json").read_text())["warnings"]
    assert warning.startswith(told)
    assert load_result(out).warnings == [warning]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ('fields = ["tylcv", "no-such-field"]', "no-such-field"),
        ('estimator = "gp:no_such=1"', "no_such"),
        ('fields = ["tylcv", "nitrogen.toml"]', "nitrogen.toml"),
    ],
)
def test_plan_refuses_what_fly_refuses(tmp_path, capsys, lines, says):
    path = tmp_path / "run.toml"
    path.write_text(f'farm = "miniberry-10"\nplanner = "lawnmower"\nbudget = "60m"\n{lines}\n')
    out = tmp_path / "rows.plan"
    assert main(["plan", "--scenario", str(path), "--out", str(out), "-q"]) == 2
    planned = capsys.readouterr().err
    assert says in planned
    assert not out.exists()
    assert main(["fly", "--scenario", str(path), "--no-files", "-q"]) == 2
    assert capsys.readouterr().err == planned
