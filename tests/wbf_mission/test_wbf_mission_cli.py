"""The command line, as a user and as a script sees it."""

import json
from pathlib import Path

import pytest

from mission.files import read_mission
from wbf_mission.cli.app import main

DISKS = ["--estimator", "adaptive-disk"]
FLY = ["fly", "--farm", "miniberry-10", "--vehicle", "ideal", "--planner", "lawnmower", *DISKS]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(list(arguments))
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["plan", "--farm", "atlantis"], "atlantis"),
        (["plan", "--planner", "teleport"], "teleport"),
        (["plan", "--vehicle", "submarine"], "submarine"),
        (["fly", "--estimator", "oracle"], "oracle"),
        (["plan", "--budget=-5m"], "-5m"),
        (["plan", "--budget", "0m"], "0"),
        (["plan", "--budget", "many"], "many"),
        (["plan", "--budget", "1m"], "budget"),
        (["plan", "--altitude", "-3"], "altitude"),
        (["plan", "--wind", "strong"], "strong"),
        (["plan", "--seed", "-1"], "seed"),
        (["plan", "--seed", "x"], "seed"),
        (["plan", "--out", "plan.doc"], "plan.doc"),
        (["fly", "--mission", "absent.plan", "--no-files"], "absent.plan"),
        (["fly", "--scenario", "absent.toml"], "absent.toml"),
        (["fly", "--camera-fields", "tylcv,sugar", "--no-files"], "sugar"),
        (["fly", "--speed", "0"], "--speed"),
        (["fly", "--bogus"], "--bogus"),
        (["fli"], "fli"),
        (["farm", "show", "atlantis"], "atlantis"),
        (["sim", "--autopilot", "betaflight"], "betaflight"),
        (["sim", "--home", "here"], "here"),
        (["sim", "--listen", "carrier-pigeon:1"], "carrier-pigeon"),
        (["upload", "absent.plan"], "absent.plan"),
        (["download", "--out", "x.doc"], "x.doc"),
        (["bench", "run", "--out", "absent/results", "--planners", "teleport"], "teleport"),
        (["bench", "run", "--out", "absent/results", "--seeds", "0"], "seeds"),
        (["bench", "report", "absent"], "absent"),
        (["plan", "--wind", "20,0"], "wind of 20"),
        (["fly", "--mission", "absent.plan", "--budget", "5min"], "--budget"),
        (["fly", "--mission", "absent.plan", "--planner", "spiral"], "--planner"),
        (["farm", "draw", "miniberry-10", "--out", "farm.bmp"], "farm.bmp"),
        (["farm", "save", "miniberry-10", "--out", "farm.txt"], "farm.txt"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_line_exit_2_nothing_written(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert says in err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_plan_prints_and_writes_every_format(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for suffix in (".plan", ".waypoints", ".json"):
        out = tmp_path / f"path{suffix}"
        code, text, _ = run(
            capsys,
            "plan",
            "--farm",
            "miniberry-100",
            "--planner",
            "spiral",
            "--budget",
            "500m",
            "--out",
            str(out),
        )
        assert code == 0
        for word in ("length", "predicted time", "coverage", "battery use"):
            assert word in text
        assert len(read_mission(out).items) > 5


def test_plan_json_is_one_document(capsys: pytest.CaptureFixture[str]) -> None:
    code, text, err = run(capsys, "plan", "--budget", "200m", "--json")
    assert code == 0
    assert err == ""
    values = json.loads(text)
    assert (values["planner"], values["seed"]) == ("spiral", 0)
    # The budget counts the legs as planned; a PX4 is led on where they turn.
    assert values["length_m"] == pytest.approx(200.0, rel=0.12)
    assert 0.0 < values["coverage"] <= 1.0


def test_fly_json_and_files(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, text, err = run(capsys, *FLY, "--out", str(tmp_path / "run"), "--json")
    assert code == 0
    assert err == ""
    values = json.loads(text)
    assert values["outcome"] == "completed"
    assert values["observations"] > 30
    assert (tmp_path / "run" / "summary.json").is_file()
    assert (tmp_path / "run" / "path.png").read_bytes().startswith(b"\x89PNG")


def test_a_scenario_file_says_what_goes_wrong(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "broken.toml"
    told = 'farm = "miniberry-10"\nvehicle = "quad"\nvehicles = 2\nestimator = "point"\n'
    motor = '[[fault]]\nkind = "motor-failure"\nat = "airborne"\nfrom = 3\n'
    file.write_text(told + motor + "vehicle = 2\n")
    arguments = ("fly", "--scenario", str(file), "--no-files", "--quiet", "--json")
    _, out, _ = run(capsys, *arguments)
    assert [one["outcome"] for one in json.loads(out)["flights"]] == ["completed", "crashed"]
    _, out, _ = run(capsys, *arguments, "--fault", "motor-failure,vehicle=1,at=airborne,from=3")
    assert [one["outcome"] for one in json.loads(out)["flights"]] == ["crashed", "crashed"]
    for wrong, why in ((motor + "vehicle = 3\n", "vehicle 3"), ("[[fault]]\nkind = 'warp'\n", "fault 1")):
        file.write_text(told + wrong)
        code, out, err = run(capsys, *arguments[:-1])
        assert (code, out) == (2, "") and why in err and err.count("\n") == 1


def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["plan"], ["fly"], ["sim"], ["upload"], ["download"], ["bench", "run"]):
        code, text, _ = run(capsys, *command, "--help")
        assert code == 0
        assert "Example" in text
    code, text, _ = run(capsys, "--version")
    assert code == 0
    assert text.startswith("wbf-mission ")


def test_a_group_without_a_command_shows_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    code, text, err = run(capsys, "farm")
    assert code == 2
    assert "draw" in text
    assert err == ""


def test_what_an_operator_should_know_is_said(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "rows.plan"
    far = ("--farm", "waterberry", "--planner", "random-waypoint", "--budget", "1500m")
    assert run(capsys, "plan", *far, "--out", str(out))[0] == 0
    code, text, err = run(
        capsys, "fly", "--farm", "miniberry-10", "--mission", str(out), *DISKS, "--no-files", "--json"
    )
    assert code == 1
    assert "no waypoint lies on the farm" in err
    assert "no image shows the farm" in err
    values = json.loads(text)
    assert (values["outcome"], values["observations"], values["score"]) == ("completed", 0, None)


def test_fly_into_a_file_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "taken"
    path.write_text("mine")
    code, _, err = run(capsys, *FLY, "--out", str(path))
    assert code == 2
    assert "taken" in err
    assert path.read_text() == "mine"
