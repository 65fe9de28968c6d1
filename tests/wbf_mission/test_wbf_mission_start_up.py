"""What the command line loads before it knows that it is needed: measured in modules, not in seconds."""

import json
import os
import subprocess
import sys

import pytest

HEAVY = (
    "numpy",
    "scipy",
    "sklearn",
    "numba",
    "pyproj",
    "shapely",
    "matplotlib",
    "pymavlink",
    "pyarrow",
    "zarr",
    "mavsdk",
    "joblib",
    "rich",
)
SHOW = f"""
import atexit, sys
atexit.register(lambda: sys.stderr.write("LOADED " + " ".join(m for m in {HEAVY!r} if m in sys.modules)))
from wbf_mission.__main__ import main
main()
"""


# One process for the help of all commands; what one of them loads is told with those after it, too.
HELP = f"""
import contextlib, io, json, sys
from wbf_mission.__main__ import main
told = []
for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    with contextlib.redirect_stdout(io.StringIO()) as out:
        try:
            code = main()
        except SystemExit as end:
            code = end.code
    told.append((code, out.getvalue(), [one for one in {HEAVY!r} if one in sys.modules]))
print(json.dumps(told))
"""


def loaded(*arguments, **environment):
    """Run the command line and return (exit code, stdout, the heavy modules that were loaded)."""
    done = subprocess.run(
        [sys.executable, "-c", SHOW, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=False,
    )
    _, _, modules = done.stderr.rpartition("LOADED")
    return done.returncode, done.stdout, modules.split()


COMMANDS = (
    (),
    *(
        (name,)
        for name in ("plan", "fly", "sim", "check", "preflight", "upload", "download", "monitor", "command")
    ),
    *((name,) for name in ("convert", "export", "map", "report", "studio", "warm-up")),
    *((f"check-{one}",) for one in ("planner", "policy", "estimator")),
    ("bench",),
    *(("bench", name) for name in ("list", "show", "run", "compare", "report", "replay", "paper")),
    *(("bench", name) for name in ("submit", "board", "verify", "seal")),
    ("farm",),
    *(("farm", name) for name in ("list", "show", "draw", "save", "generate")),
    ("vehicle",),
    ("vehicle", "list"),
    ("vehicle", "show"),
)


def test_help_loads_no_library():
    asked = [*((*command, "--help") for command in COMMANDS), ("fly", "--help-all")]
    done = subprocess.run([sys.executable, "-c", HELP, json.dumps(asked)], capture_output=True, check=True)
    for words, (code, text, modules) in zip(asked, json.loads(done.stdout), strict=True):
        assert (code, modules) == (0, []), words
        assert f"Usage: {' '.join(('wbf-mission', *words[:-1]))} " in text


def test_every_command_is_in_the_list_above():
    from wbf_mission.cli.app import app

    names = {(one.name,) for one in app.registered_commands}
    for group in app.registered_groups:
        names |= {
            (group.name,),
            *((group.name, one.name) for one in group.typer_instance.registered_commands),
        }
    assert names | {()} == set(COMMANDS)


def test_the_version_loads_no_library():
    code, text, modules = loaded("--version")
    assert (code, modules) == (0, [])
    assert text.startswith("wbf-mission ")


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("wbf-mission pl", {"plan"}),
        ("wbf-mission fly --win", {"--wind", "--wind-shear"}),
        ("wbf-mission fly --help", {"--help", "--help-all"}),
        ("wbf-mission plan --farm water", {"waterberry"}),
        ("wbf-mission plan --planner spi", {"spiral"}),
        ("wbf-mission fly --estimator ada", {"adaptive-disk"}),
        ("wbf-mission vehicle show qu", {"quad"}),
    ],
)
def test_completion_loads_no_library(words, found):
    code, text, modules = loaded(
        _WBF_MISSION_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(len(words.split()) - 1)
    )
    assert code == 0
    assert found <= set(text.split())
    assert modules == []


def test_bad_usage_loads_no_library():
    code, text, modules = loaded("plan", "--bogus")
    assert (code, text, modules) == (2, "", [])
