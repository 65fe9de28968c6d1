"""Other operating systems: the types hold for macOS and Windows, and nothing needs what only Unix has."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = ["geo", "sensors", "mission", "sim_vehicle", "wbf_mission"]


@pytest.mark.slow
@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_the_types_hold_on_other_systems(platform: str) -> None:
    cache = ROOT / ".mypy_cache" / platform  # mypy discards a cache of another platform
    words = [sys.executable, "-m", "mypy", "--platform", platform, f"--cache-dir={cache}"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


BARE = """
import importlib, os, pkgutil, signal, sys, time

# Libraries ask for the system when they are imported: they come first.
import joblib, multiprocessing.resource_tracker, platformdirs, psutil

for name in ("fcntl", "grp", "pwd", "resource", "syslog", "termios", "tty", "pty"):
    sys.modules[name] = None
for module, names in (
    (os, "fork forkpty getpgid killpg sched_getaffinity setsid sysconf getloadavg mkfifo"),
    (signal, "SIGHUP SIGKILL SIGALRM SIG_BLOCK SIG_SETMASK pthread_sigmask sigwait alarm"),
    (time, "CLOCK_BOOTTIME CLOCK_MONOTONIC clock_gettime"),
):
    for name in names.split():
        delattr(module, name)
"""

IMPORTS = """
for package in sys.argv[1:]:
    for found in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
        if ".addons" not in found.name and not found.name.endswith("__main__"):
            importlib.import_module(found.name)

from geo.processes import interrupts_held

with interrupts_held():
    pass
"""

COMMAND = """
from wbf_mission.__main__ import main

sys.exit(main())
"""


def run_bare(code: str, *words: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", BARE + code, *words], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_modules_of_the_core_are_imported_without_what_only_unix_has(tmp_path: Path) -> None:
    run_bare(IMPORTS, *CORE, folder=tmp_path)


@pytest.mark.slow
def test_a_plan_and_a_flight_need_nothing_that_only_unix_has(tmp_path: Path) -> None:
    farm = ["--farm", "miniberry-10", "--seed", "1"]
    run_bare(COMMAND, "plan", *farm, "--out", "plan.plan", folder=tmp_path)
    run_bare(COMMAND, "fly", *farm, "--out", "run", folder=tmp_path)
    words = (*farm, "--days", "1", "--jobs", "-1")
    run_bare(COMMAND, "farm", "generate", *words, "--out", "environments", folder=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"plan.plan", "run", "environments"}
