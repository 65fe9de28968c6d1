"""What a command reads or did not make is not written over."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from mission.link.tlog import TlogWriter, read_tlog
from mission.model import Command, Frame, MissionItem
from wbf_mission.cli.app import main
from wbf_mission.flight import fly
from wbf_mission.results.result import load_result
from wbf_mission.results.writing import ResultFolder

SIM = ["sim", "--no-camera", "--listen", "udpin:127.0.0.1:0", "--speed", "max", "--duration", "2", "-q"]
FLY = ["fly", "--vehicle", "ideal", "--planner", "lawnmower", "--estimator", "point", "--no-plots", "-q"]


def refused(capsys, *arguments):
    assert main(list(arguments)) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1
    return error


def test_a_log_is_not_written_over_something_else(tmp_path, capsys):
    plan, log = tmp_path / "old.plan", tmp_path / "old.tlog"
    plan.write_text("mine")
    log.write_bytes(b"older")
    assert "--overwrite" in refused(capsys, *SIM, "--tlog", str(plan))
    assert plan.read_text() == "mine"
    # What cannot begin leaves an older log.
    refused(capsys, *SIM, "--tlog", str(log), "--listen", "carrier-pigeon:1")
    assert log.read_bytes() == b"older"
    assert main([*SIM, "--tlog", str(log)]) == 0
    assert main([*SIM, "--tlog", str(plan), "--overwrite"]) == 0
    assert len(list(read_tlog(log))) > 1
    assert len(list(read_tlog(plan))) > 1


WRONG = (
    "--farm atlantis",
    "--planner teleport",
    "--estimator oracle",
    "--planner lawnmower:colour=red",
    "--vehicle submarine",
    "--budget 1parsec",
    "--vehicle quad --wind 39,0",
    "--vehicle quad --cruise-speed 29",
    "--wind-shear log",
)


def test_a_run_that_cannot_be_leaves_an_older_result(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    flies = [*FLY, "--farm", "miniberry-10"]
    assert main([*flies, "--out", "run"]) == 0
    capsys.readouterr()
    before = {path: path.read_bytes() for path in Path("run").iterdir()}
    for wrong in WRONG:
        for out in (["--out", "run"], [], ["--out", "new", "--overwrite"]):
            refused(capsys, *flies, *out, *wrong.split())
    other = [*flies, "--out", "run", "--seed", "4"]
    assert "another run" in refused(capsys, *other)
    assert {path: path.read_bytes() for path in Path("run").iterdir()} == before
    assert main([*other, "--overwrite"]) == 0
    assert load_result("run").scenario.seed == 4
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_fly_does_not_take_the_mission_that_it_was_given(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("b").mkdir()
    assert main(["plan", "--farm", "miniberry-10", "--budget", "60m", "--out", "b/plan.plan", "-q"]) == 0
    before = Path("b/plan.plan").read_bytes()
    arguments = ["fly", "--farm", "miniberry-10", "--mission", "b/plan.plan", "--out", "b"]
    for overwrite in ([], ["--overwrite"]):
        assert "which the run reads" in refused(capsys, *arguments, *overwrite)
    assert Path("b/plan.plan").read_bytes() == before
    assert [path.name for path in Path("b").iterdir()] == ["plan.plan"]


def test_fly_does_not_take_the_vehicle_files_of_a_fleet(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("b").mkdir()
    Path("b/vehicle-2.toml").write_text('base = "quad"\n')
    arguments = [*FLY[:1], "--farm", "miniberry-10", "--out", "b", "--overwrite", "--vehicle"]
    for vehicle in ("b/vehicle-2.toml", "b/vehicle-2.toml,quad", "quad, b/vehicle-2.toml"):
        assert "holds b/vehicle-2.toml, which the run reads" in refused(capsys, *arguments, vehicle)
    assert [path.name for path in Path("b").iterdir()] == ["vehicle-2.toml"]


@pytest.mark.parametrize("has_home", [True, False])
def test_fly_names_the_file_in_which_the_rest_is(tmp_path, monkeypatch, capsys, has_home):
    def with_rest(*arguments, **more):
        result = fly(*arguments, **more)
        there = result.plan.mission.items[2]
        rally = MissionItem(Command.NAV_RALLY_POINT, Frame.GLOBAL, x=there.x, y=there.y, z=90.0)
        home = result.plan.mission.home if has_home else None
        result.rest = replace(result.plan.mission, home=home, rally=(rally,))
        return result

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("wbf_mission.flight.fly", with_rest)
    assert main([*FLY[:-1], "--farm", "miniberry-10", "--out", "run"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    name = "rest.plan" if has_home else "rest.json"
    assert f"in run/{name}: continue with fly --mission" in said
    assert "plan --resume run" in said
    assert ("rest.plan is left out, use rest.json" in said) is not has_home
    assert Path("run", name).is_file()
    again = ["--resume", "run", "--out", "again.json"]
    assert main(["plan", "--farm", "miniberry-10", "--vehicle", "ideal", *again]) == 0
    assert Path("again.json").is_file()


@pytest.mark.parametrize("key", ["farm", "mission", "fields"])
def test_a_nul_in_a_name_is_said(tmp_path, monkeypatch, capsys, key):
    monkeypatch.chdir(tmp_path)
    suffix = {"farm": "geojson", "mission": "plan"}.get(key, "toml")
    name = f'"a\\u0000b.{suffix}"'
    Path("nul.toml").write_text(f"{key} = {f'[{name}]' if key == 'fields' else name}\n")
    Path("r").mkdir()
    for out in ([], ["--out", "r"], ["--no-files"]):
        assert "NUL" in refused(capsys, "fly", "--scenario", "nul.toml", *out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["nul.toml", "r"]


def test_only_files_of_missions_and_farms_are_replaced(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("package.json", "notes.txt", "farm.json", "rows.plan", "farm.geojson"):
        Path(name).write_text("mine")
    plan = ["plan", "--farm", "miniberry-10", "--budget", "60m", "-q", "--out"]
    save = ["farm", "save", "miniberry-10", "-q", "--out"]
    download = ["download", "--connect", "udpin:127.0.0.1:0", "--wait", "0.1", "-q", "--out"]
    for arguments in ([*plan, "package.json"], [*save, "farm.json"], [*download, "notes.txt"]):
        assert "--overwrite" in refused(capsys, *arguments)
        assert Path(arguments[-1]).read_text() == "mine"
    for arguments in ([*plan, "rows.plan"], [*plan, "package.json", "--overwrite"], [*save, "farm.geojson"]):
        assert main(arguments) == 0
        assert json.loads(Path([one for one in arguments if one != "--overwrite"][-1]).read_text())
    assert main([*download, "notes.txt", "--overwrite"]) == 3
    assert Path("notes.txt").read_text() == "mine"


def test_force_replaces_nothing_and_overwrite_flies_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("mine")
    for arguments in (
        ["download", "--connect", "udpin:127.0.0.1:0", "--out", "notes.txt"],
        ["farm", "save", "miniberry-10", "--out", "notes.txt"],
        [*SIM, "--tlog", "notes.txt"],
    ):
        assert "has no --force: --overwrite replaces" in refused(capsys, *arguments, "--force")
    assert main([*FLY, "--farm", "miniberry-10", "--out", "run"]) == 0
    capsys.readouterr()
    other = [*FLY, "--farm", "miniberry-10", "--out", "run", "--seed", "4"]
    assert "--overwrite" in refused(capsys, *other, "--force")
    assert load_result("run").scenario.seed != 4
    assert "No such option: --overwrite" in refused(capsys, "upload", "notes.txt", "--overwrite")
    assert "No such option: --force" in refused(capsys, "farm", "show", "miniberry-10", "--force")
    assert Path("notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("command", "words", "told"),
    [
        ("fly", "--via x --connect udpin:1", "Invalid value for '--via': 'x' is not one of 'own', 'mavsdk'."),
        ("export", "x", "Missing option '--to'. Choose from: mcap, rerun, gpx, kml, geojson, csv"),
        ("bench submit", "", "Missing argument 'folder'."),
        ("bench", "nonsense", "No such command 'nonsense'."),
        (
            "check",
            "",
            "Invalid value: give the link to the vehicle, such as udpin:127.0.0.1:14550, or --list",
        ),
        ("", "--foo", "No such option: --foo"),
    ],
)
def test_a_wrong_use_is_one_line_that_names_the_help_of_the_command(command, words, told, capsys):
    text = refused(capsys, *command.split(), *words.split())
    assert told in text
    assert f"(see '{' '.join(['wbf-mission', *command.split()])} --help')" in text
    assert "\\t" not in text and "Value error" not in text


def test_a_fault_of_a_vehicle_that_is_not_there_is_refused_before_anything_is_made(capsys, monkeypatch):
    def never(*_, **__):
        raise AssertionError

    monkeypatch.setattr("wbf_mission.addons.base.simulator.make_components", never)
    assert "there is no vehicle 9; the systems are 1, 2" in refused(
        capsys, *SIM, "--count", "2", "--fault", "loss=0.1,vehicle=9"
    )


@pytest.mark.parametrize(
    "command",
    [
        ["plan", "--farm", "miniberry-10", "--budget", "60m", "--out"],
        ["download", "--connect", "tcp:127.0.0.1:1", "--out"],
        ["farm", "draw", "miniberry-10", "--out"],
        ["farm", "save", "miniberry-10", "--out"],
        [*SIM, "--tlog"],
        [*SIM, "--ready-file"],
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_a_folder_and_a_file_in_none_are_refused_before_anything_is_done(command, tmp_path, capsys):
    error = refused(capsys, *command, str(tmp_path))
    assert f"{tmp_path}: is a folder; give the name of a file" in error
    error = refused(capsys, *command, str(tmp_path / "new" / "file.plan"))
    assert f"there is no folder {tmp_path / 'new'}; make the folder, or give another name" in error
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_told_before_the_flight(monkeypatch, capsys):
    def never(*_, **__):
        raise AssertionError

    monkeypatch.setattr("wbf_mission.flight.fly", never)
    error = refused(capsys, *FLY, "--farm", "miniberry-10", "--out", "/sys/run")
    assert error.startswith("error: /sys/run: it cannot be written: ")


def test_a_full_disk_is_told_by_the_name_of_the_log(capsys):
    assert "/dev/full: No space left" in refused(capsys, *SIM, "--tlog", "/dev/full")


def test_a_full_disk_in_flight_is_told_by_the_name_of_the_folder(tmp_path):
    out = tmp_path / "run"
    with pytest.raises(OSError, match="No space") as caught, ResultFolder(out) as folder:
        folder.tlog.symlink_to("/dev/full")
        with TlogWriter(folder.tlog) as log:
            log.write(bytes(300), 1.0)
    assert caught.value.filename == str(out / "flight.tlog")
    assert list(tmp_path.iterdir()) == []


def test_a_working_folder_that_is_gone_is_told(tmp_path, monkeypatch, capsys):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert "the working folder was removed" in refused(capsys, "plan", "--farm", "miniberry-10")


@pytest.mark.parametrize("where", ["module", "planner", "estimator"])
def test_own_code_that_ends_the_program_is_told_with_its_line(tmp_path, monkeypatch, capsys, where):
    monkeypatch.chdir(tmp_path)
    text = {
        "module": "import sys\nsys.exit('bye')\n",
        "planner": "import sys\n\n\ndef mine(request):\n    sys.exit('bye')\n",
        "estimator": "import sys\n\n\nclass mine:\n    def fit(self, grid):\n        sys.exit('bye')\n"
        "    def partial_fit(self, observations):\n        pass\n    def predict(self):\n        pass\n",
    }[where]
    Path("own.py").write_text(text)
    line = {"module": 2, "planner": 5, "estimator": 6}[where]
    option = ["--estimator" if where == "estimator" else "--planner", "own.py:mine"]
    error = refused(capsys, "fly", "--farm", "miniberry-10", "--vehicle", "ideal", "--no-files", *option)
    assert "SystemExit: bye" in error
    assert f"line {line})" in error
    assert "own.py" in error
