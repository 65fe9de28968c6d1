"""The extra is optional, and its examples run."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[4]


def python(*arguments):
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=300, check=False, cwd=ROOT
    )


def test_importing_the_product_does_not_import_the_libraries():
    code = (
        "import sys, wbf_mission, wbf_mission.cli.app, wbf_mission.flight, wbf_mission.bench.benchmark;"
        "print(sorted({'gymnasium', 'pettingzoo', 'torch'} & set(sys.modules)))"
    )
    done = python("-c", code)
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.parametrize("missing", ["gymnasium", "pettingzoo"])
def test_without_a_library_one_line_says_what_to_install(missing):
    code = (
        "import importlib.util as util; real = util.find_spec\n"
        f"util.find_spec = lambda name, *rest: None if name == {missing!r} else real(name, *rest)\n"
        "from geo.errors import WbfMissionError\n"
        "try:\n"
        "    import wbf_mission.addons.rl\n"
        "except WbfMissionError as error:\n"
        "    print(error)\n"
    )
    done = python("-c", code)
    expected = f"training environments need {missing}: install with pip install 'wbf-mission[rl]'"
    assert done.stdout.splitlines() == [expected], done.stderr


@pytest.mark.parametrize("name", ["random_agent", "greedy_agent"])
def test_the_agents_of_the_page_are_short_and_run(name, monkeypatch, capsys):
    path = ROOT / "docs" / "examples" / f"{name}.py"
    assert len(path.read_text(encoding="utf-8").splitlines()) < 30
    monkeypatch.setattr(sys, "argv", [str(path), "WBF/Miniberry-10-v1"])
    runpy.run_path(str(path), run_name="__main__")
    scores = [float(one) for one in re.findall(r": (-\d\.\d{4})$", capsys.readouterr().out, re.MULTILINE)]
    assert len(scores) == 3
    assert max(scores) < 0.0
