"""What the command line loads before it knows that it is needed: measured in modules, not in seconds."""

import json
import subprocess
import sys

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
# One process for all command lines; what one of them loads is told with those after it, too.
CALLS = f"""
import contextlib, io, json, os, sys
from wbf_mission.__main__ import main
told = []
for words, environment in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    os.environ.update(environment)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        try:
            code = main()
        except SystemExit as end:
            code = end.code
    told.append((code, out.getvalue(), [one for one in {HEAVY!r} if one in sys.modules]))
print(json.dumps(told))
"""


def called(*lines):
    """Exit code, output and loaded heavy modules of command lines, each with its environment."""
    done = subprocess.run([sys.executable, "-c", CALLS, json.dumps(lines)], capture_output=True, check=True)
    return json.loads(done.stdout)


def commands():
    from wbf_mission.cli.app import app

    yield ()
    yield from ((one.name,) for one in app.registered_commands)
    for group in app.registered_groups:
        yield (group.name,)
        yield from ((group.name, one.name) for one in group.typer_instance.registered_commands)


def test_help_loads_no_library():
    asked = [*((*command, "--help") for command in commands()), ("fly", "--help-all")]
    for words, (code, text, modules) in zip(asked, called(*((words, {}) for words in asked)), strict=True):
        assert (code, modules) == (0, []), words
        assert f"Usage: {' '.join(('wbf-mission', *words[:-1]))} " in text


COMPLETED = {
    "wbf-mission pl": {"plan"},
    "wbf-mission fly --win": {"--wind", "--wind-shear"},
    "wbf-mission fly --help": {"--help", "--help-all"},
    "wbf-mission plan --farm water": {"waterberry"},
    "wbf-mission plan --planner spi": {"spiral"},
    "wbf-mission fly --estimator ada": {"adaptive-disk"},
    "wbf-mission vehicle show qu": {"quad"},
}


def test_version_bad_usage_and_completion_load_no_library():
    line_of = {"_WBF_MISSION_COMPLETE": "complete_bash"}
    completions = [
        ((), {**line_of, "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)})
        for words in COMPLETED
    ]
    version, bad, *completed = called((("--version",), {}), (("plan", "--bogus"), {}), *completions)
    assert version[0] == 0 and version[1].startswith("wbf-mission ") and version[2] == []
    assert bad == [2, "", []]
    for (words, found), (code, text, modules) in zip(COMPLETED.items(), completed, strict=True):
        assert (code, modules) == (0, []), words
        assert found <= set(text.split()), words
