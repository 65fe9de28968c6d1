"""Input that nobody means: one line on stderr, exit code 2, nothing left behind; never a traceback."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from operator import itemgetter

import pytest

from geo import get_farm, save_farm
from wbf_mission.cli.app import main

NUMBERS = ("nan", "inf", "-inf", "1e999", "9" * 400)
ODD = ("", *NUMBERS, "\x1b[31m", "[bold]x[/nope]", "\udcff", "..", "/dev/zero")
FILES = ("pipe", "folder", "zero", "loop", "deep", "large", "bytes")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for suffix in ("toml", "plan", "geojson", "geojsonl", "poly", "kmz", "zip", "fen", "waypoints"):
        os.mkfifo(f"pipe.{suffix}")
        (tmp_path / f"folder.{suffix}").mkdir()
        (tmp_path / f"zero.{suffix}").symlink_to("/dev/zero")
        (tmp_path / f"loop.{suffix}").symlink_to(f"loop.{suffix}")
        (tmp_path / f"deep.{suffix}").write_text("a = " * (suffix == "toml") + "[" * 100_000)
        (tmp_path / f"bytes.{suffix}").write_bytes(b"\xff\xfe\x00")
        with (tmp_path / f"large.{suffix}").open("wb") as file:
            file.truncate(200_000_000)
    return tmp_path


def refused(capsys, folder, *arguments):
    before = sorted(folder.iterdir())
    code = main(list(arguments))
    out, err = capsys.readouterr()
    assert (code, out) == (2, ""), (arguments, err)
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert err[:-1].isprintable(), "no control character reaches the terminal"
    assert sorted(folder.iterdir()) == before
    return err


@pytest.mark.parametrize("value", ODD, ids=lambda value: ascii(value)[:20])
@pytest.mark.parametrize(
    "arguments",
    [
        ["plan", "--farm"],
        ["plan", "--budget"],
        ["plan", "--vehicle"],
        ["plan", "--autopilot"],
        ["plan", "--param"],
        ["plan", "--altitude"],
        ["plan", "--seed"],
        ["plan", "--wind"],
        ["plan", "--scenario"],
        ["plan", "--out"],
        ["fly", "--no-files", "--mission"],
        ["fly", "--no-files", "--day"],
        ["sim", "--no-camera", "--count"],
        ["sim", "--no-camera", "--listen"],
        ["sim", "--no-camera", "--home"],
        ["sim", "--no-camera", "--fault"],
        ["farm", "show"],
        ["farm", "save", "miniberry-10", "--out"],
        ["farm", "generate", "--keep"],
        ["vehicle", "show"],
        ["upload"],
        ["download", "--out"],
        ["check"],
        ["bench", "run", "--out", "x", "--seeds"],
        ["bench", "run", "--out", "x", "--planners"],
        ["bench", "run", "--out", "x"],
        ["bench", "report"],
    ],
    ids=" ".join,
)
def test_odd_values(capsys, tmp_path, monkeypatch, arguments, value):
    monkeypatch.chdir(tmp_path)
    refused(capsys, tmp_path, *arguments, value)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize(
    ("arguments", "suffix"),
    [
        (["plan", "--scenario"], "toml"),
        (["sim", "--scenario"], "toml"),
        (["plan", "--vehicle"], "toml"),
        (["vehicle", "show"], "toml"),
        (["plan", "--farm"], "geojson"),
        (["fly", "--no-files", "--mission"], "plan"),
        (["upload"], "plan"),
        *((["farm", "show"], suffix) for suffix in ("geojsonl", "poly", "kmz", "zip")),
        *((["preflight"], suffix) for suffix in ("fen", "waypoints", "kmz")),
    ],
    ids=str,
)
def test_odd_files(capsys, folder, arguments, suffix, name):
    assert f"{name}.{suffix}" in refused(capsys, folder, *arguments, f"{name}.{suffix}")


def test_names_are_text(capsys, tmp_path):
    """Markup and emoji codes in a farm's name are shown, not obeyed; control characters are left out."""
    path = tmp_path / "farm.geojson"
    save_farm(get_farm("miniberry-10"), path)
    document = json.loads(path.read_text())
    for feature in document["features"]:
        if "name" in feature["properties"]:
            feature["properties"]["name"] = "[bold]x[/nope] :smile:"
    document["name"] = "[bold]x[/nope] :smile:"
    path.write_text(json.dumps(document))
    assert main(["farm", "show", str(path)]) == 0
    out, _ = capsys.readouterr()
    assert "[bold]x[/nope] :smile:" in out
    path.write_text(json.dumps(document).replace(":smile:", "\\u001b[31m"))
    assert main(["farm", "show", str(path)]) == 0
    out, err = capsys.readouterr()
    assert "[bold]x[/nope] [31m" in out and "\x1b" not in out + err


def run(*arguments, script='"$@"', **options):
    """Run the command line through a shell, which can close and redirect."""
    command = ["sh", "-c", script, "sh", sys.executable, "-m", "wbf_mission", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


CLOSED, FULL, GONE = '"$@" >&-', '"$@" >/dev/full', '{ "$@"; echo $? >&2; } | true'
SAYS = {
    CLOSED: (0, ""),
    '"$@" <&- >&- 2>&-': (0, ""),
    FULL: (2, "error: stdout cannot be written to: No space left on device\n"),
    GONE: (0, "141\n"),
}


@pytest.mark.parametrize(
    ("arguments", "script"), [*(("vehicle list", script) for script in SAYS), ("fly --help-all", GONE)]
)
def test_an_output_that_takes_nothing(arguments, script):
    done = run(*arguments.split(), script=script)
    assert (done.returncode, done.stderr) == SAYS[script]


def test_a_command_with_a_closed_output_still_writes_its_file(tmp_path):
    arguments = ["farm", "save", "miniberry-10", "--out", "mine.geojson"]
    assert run(*arguments, script=CLOSED, cwd=tmp_path).returncode == 0
    assert json.loads((tmp_path / "mine.geojson").read_text())["type"] == "FeatureCollection"


LARGE = (
    "farm save miniberry-100 --out big.geojson",
    "farm draw miniberry-100 --out big.png",
    "plan --farm miniberry-10 --planner lawnmower --budget 60m --out big.plan",
)
# One process for all of them.
LIMITED = """
import contextlib, io, json, resource, signal, sys
from wbf_mission.cli.app import main

resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
told = []
for words in sys.argv[1:]:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = main(words.split())
    told.append((code, out.getvalue(), err.getvalue()))
json.dump(told, sys.stdout)
"""


def test_a_full_disk_names_the_file_and_leaves_the_old_one(tmp_path):
    """A limit on the size of files stands for the disk; the system ends a write there with an error."""
    targets = [tmp_path / words.split()[-1] for words in LARGE]
    for target in targets:
        target.write_text("old")
    # Coverage, where it is measured, would write its own file into the limit.
    env = {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE_")}
    # Without -B the bytecode that it writes would be cut short as well, and later processes would read it.
    done = subprocess.run(
        [sys.executable, "-B", "-c", LIMITED, *LARGE],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
        env=env,
    )
    for target, (code, out, err) in zip(targets, json.loads(done.stdout), strict=True):
        assert (code, out) == (2, ""), err
        last = err.splitlines()[-1]
        assert last.startswith("error: ") and target.name in last
        assert "Traceback" not in err
        assert target.read_text() == "old"
    assert set(tmp_path.iterdir()) == set(targets)


def test_an_output_is_never_what_is_read(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_farm(get_farm("miniberry-10"), tmp_path / "my.geojson")
    (tmp_path / "link.geojson").symlink_to("my.geojson")
    before = (tmp_path / "my.geojson").read_bytes()
    (tmp_path / "old.plan").write_text("a plan")
    plan = ["plan", "--farm", "my.geojson", "--budget", "40m", "--out"]
    sim = ["sim", "--no-camera", "--duration", "1"]
    for arguments in (
        *([*plan, out] for out in ("my.geojson", "./my.geojson", "link.geojson")),
        ["plan", "--farm", "my.geojson|layer", "--out", "my.geojson"],
        ["farm", "save", "my.geojson", "--out", "my.geojson"],
        [*sim, "--farm", "my.geojson", "--overwrite", "--tlog", "my.geojson"],
    ):
        assert "this is an input file" in refused(capsys, tmp_path, *arguments)
    for option in ("--tlog", "--ready-file"):
        refused(capsys, tmp_path, *sim, option, "old.plan")
    assert (tmp_path / "my.geojson").read_bytes() == before
    assert (tmp_path / "old.plan").read_text() == "a plan"


def test_a_mistake_of_the_program_is_one_line_too(capsys, monkeypatch):
    monkeypatch.setattr(
        "wbf_mission.addons.browse.vehicles._summary", itemgetter("none")
    )  # no code of a user's
    assert main(["vehicle", "list"]) == 70
    _, err = capsys.readouterr()
    assert err.startswith("error: TypeError: 'VehicleSpec' object is not subscriptable; this is a mistake in")
    assert err.count("\n") == 1
    monkeypatch.setenv("WBF_MISSION_DEBUG", "1")
    with suppress(TypeError):
        pytest.fail(f"ended with {main(['vehicle', 'list'])}, the traceback was wanted")
