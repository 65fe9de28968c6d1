"""The command line, as a user and as a script sees it."""

import json

import pytest
from command_line import run

DISKS = ["--estimator", "adaptive-disk"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("plan --farm atlantis", "atlantis"),
        ("plan --planner teleport", "teleport"),
        ("plan --vehicle submarine", "submarine"),
        ("fly --estimator oracle", "oracle"),
        ("plan --budget=-5m", "-5m"),
        ("plan --budget 1m", "budget"),
        ("plan --altitude -3", "altitude"),
        ("plan --wind strong", "strong"),
        ("plan --wind 20,0", "wind of 20"),
        ("plan --seed x", "seed"),
        ("plan --out plan.doc", "plan.doc"),
        ("fly --mission absent.plan --no-files", "absent.plan"),
        ("fly --scenario absent.toml", "absent.toml"),
        ("fly --camera-fields tylcv,sugar --no-files", "sugar"),
        ("fly --speed 0", "--speed"),
        ("fly --mission absent.plan --budget 5min", "--budget"),
        ("fli", "fli"),
        ("farm show atlantis", "atlantis"),
        ("farm draw miniberry-10 --out farm.bmp", "farm.bmp"),
        ("farm save miniberry-10 --out farm.txt", "farm.txt"),
        ("sim --autopilot betaflight", "betaflight"),
        ("sim --home here", "here"),
        ("sim --listen carrier-pigeon:1", "carrier-pigeon"),
        ("upload absent.plan", "absent.plan"),
        ("download --out x.doc", "x.doc"),
        ("bench run --out absent/results --planners teleport", "teleport"),
        ("bench run --out absent/results --seeds 0", "seeds"),
    ],
)
def test_bad_input_is_one_line_exit_2_nothing_written(capsys, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *words.split())
    assert (code, out) == (2, "")
    assert err.startswith("error: ") and err.count("\n") == 1 and says in err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_scenario_file_says_what_goes_wrong(capsys, tmp_path):
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


def test_help_and_version(capsys):
    for command in (["plan"], ["fly"], ["sim"], ["upload"], ["download"], ["bench", "run"]):
        code, text, _ = run(capsys, *command, "--help")
        assert code == 0
        assert "Example" in text
    code, text, _ = run(capsys, "--version")
    assert code == 0
    assert text.startswith("wbf-mission ")


def test_a_group_without_a_command_shows_its_help(capsys):
    code, text, err = run(capsys, "farm")
    assert code == 2
    assert "draw" in text
    assert err == ""


def test_what_an_operator_should_know_is_said(capsys, tmp_path):
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
