"""Planners, policies and estimators of a user's own file."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from geo.farm_file import split_layer
from wbf_mission import BenchSpec, ScenarioError, load_scenario
from wbf_mission.addons.boards.submission import code_files
from wbf_mission.cli.app import main
from wbf_mission.own_code import files_beside, own_choice

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
POLICY = f"{EXAMPLES / 'my_policy.py'}:RowsThenGreedy"
ZIGZAG = f"{EXAMPLES / 'my_planner.py'}:zigzag"
ESTIMATOR = f"{EXAMPLES / 'my_estimator.py'}:Smooth"
PLANNER = """
from wbf_mission import make_planner

def wide(request, *, spacing_m=2.0):
    return make_planner("spiral", max_spacing_m=spacing_m)(request)
"""


@pytest.mark.parametrize("name", ["my_policy.py", "my_estimator.py", "my_planner.py"])
def test_the_page_shows_the_examples_as_they_are(name):
    page = (EXAMPLES.parent / "your-own.md").read_text()
    text = (EXAMPLES / name).read_text()
    assert f"```python\n{text}```" in page or f"```{{literalinclude}} examples/{name}\n```" in page
    code = [line for line in text.splitlines() if line and not line.lstrip().startswith('"""')]
    assert len(code) < 30


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("check-policy", [POLICY]),
        ("check-planner", [ZIGZAG, "--land", "convex"]),
        ("check-estimator", [ESTIMATOR]),
    ],
)
def test_a_contract_that_is_kept(command, name, capsys):
    assert main([command, *name, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["keeps"] is True


def test_a_kit_is_as_wide_as_is_asked(capsys):
    assert main(["check-planner", ZIGZAG, "--land", "convex,concave", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["broken"].startswith("L, start ")
    assert main(["check-planner", "spiral", "--land", "flat"]) == 2
    assert "unknown land 'flat': choose convex, concave, pierced, apart" in capsys.readouterr().err


def test_they_fly(tmp_path, capsys):
    arguments = ["fly", "--farm", "miniberry-10", "--vehicle", "ideal", "--json", "--no-plots"]
    out = ["--out", str(tmp_path / "run")]
    assert main([*arguments, "--policy", f"{POLICY}:share=0.5", "--estimator", ESTIMATOR, *out]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["policy"], summary["estimator"]) == ("RowsThenGreedy:share=0.5", "Smooth")
    assert len(summary["decisions"]) > 1
    (tmp_path / "mine.py").write_text(PLANNER)
    planner = f"{tmp_path / 'mine.py'}:wide:spacing_m=3.0"
    assert main([*arguments, "--planner", planner, "--estimator", "point", "--no-files"]) == 0
    assert json.loads(capsys.readouterr().out)["planner"] == "wide:spacing_m=3.0"


def test_changed_code_is_another_run(tmp_path):
    def keys(text, name):
        (tmp_path / name).write_text(text)
        planner = own_choice(f"{tmp_path / name}:wide", "planner")
        return {one.key for one in BenchSpec.of(planners=[planner], seeds=1).runs()}

    assert keys(PLANNER, "one.py") == keys(PLANNER, "two.py")
    assert not keys(PLANNER, "one.py") & keys(PLANNER.replace("2.0", "2.5"), "three.py")


LOADS = """
import pathlib
import helper
from mission.planners import make_planner
FOLDER = pathlib.Path(__file__).parent

class Loads:
    __name__ = "loads"

    def __call__(self, request):
        import later
        spacing = float((FOLDER / "data" / "spacing.txt").read_text()) + helper.more() + later.MORE
        numbers = [float(one.read_text()) for one in sorted(FOLDER.glob("more-*.txt"))]
        return make_planner("spiral", max_spacing_m=spacing + sum(numbers))(request)
"""


# A new process for each change, as one that has loaded the modules does not see it.
KEYS = """
import json, os, pathlib, sys
from wbf_mission.bench.digests import own_digest
from wbf_mission.own_code import own_choice
for name, text in [(None, ""), *json.loads(sys.argv[1])]:
    if name is not None:
        pathlib.Path(name).write_text(text)
    if os.fork() == 0:
        print(own_digest(own_choice(str(pathlib.Path("loads.py").resolve()) + ":Loads", "policy").made))
        sys.exit()
    assert os.wait()[1] == 0
"""


def test_files_that_code_names_and_modules_beside_it_count_with_it(tmp_path, capsys):
    (tmp_path / "data").mkdir()
    files = {
        "loads.py": LOADS,
        "helper.py": "import deeper\ndef more():\n    return deeper.MORE\n",
        "deeper.py": "MORE = 1.0\n",
        "later.py": "MORE = 0.5\n",
        "data/spacing.txt": "0.5",
        "more-1.txt": "0",
        "other.txt": "0",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)

    changes = [
        ("data/spacing.txt", "0.6"),
        ("deeper.py", "MORE = 1.1\n"),
        ("later.py", "MORE = 0.6\n"),
        ("more-2.txt", "0.2"),
        ("more-1.txt", "0.1"),
        ("other.txt", "1"),
    ]
    words = [sys.executable, "-c", KEYS, json.dumps(changes)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=tmp_path)
    *keys, after = done.stdout.split()
    assert len(set(keys)) == len(keys) == len(changes)
    assert after == keys[-1], "nothing reads other.txt"
    assert set(code_files([tmp_path / "loads.py"])) == {
        f"code/{name}" for name in [*files, "more-2.txt"] if name != "other.txt"
    }
    run = [
        "--scenarios",
        "WBF/Miniberry-10-v1",
        "--planners",
        f"{tmp_path / 'loads.py'}:Loads",
        "--seeds",
        "1",
    ]
    run += ["--estimators", "point", "--out", str(tmp_path / "r"), "--quiet"]
    assert main(["bench", "run", *run]) == 0
    who = ["--name", "M", "--by", "M", "--code", str(tmp_path / "loads.py"), "--out", str(tmp_path / "p.zip")]
    assert main(["bench", "submit", str(tmp_path / "r"), *who]) == 0
    assert "1 equal" in capsys.readouterr().out


def test_a_module_beside_the_file_does_not_hide_another(tmp_path, capsys):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text("import sameone\n" + PLANNER)
        (tmp_path / folder / "sameone.py").write_text(f"NAME = {folder!r}")
    assert own_choice(f"{tmp_path / 'a' / 'mine.py'}:wide", "planner").made
    with pytest.raises(ScenarioError, match=r"b/mine.py imports its neighbour sameone, but .*a/sameone.py"):
        own_choice(f"{tmp_path / 'b' / 'mine.py'}:wide", "planner")
    (tmp_path / "mine.py").write_text("import json\n" + PLANNER)
    (tmp_path / "json.py").write_text("")
    with pytest.raises(ScenarioError, match=r"imports its neighbour json, but .* has the same name"):
        own_choice(f"{tmp_path / 'mine.py'}:wide", "planner")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("raise ValueError('no\\nway')", "cannot be run: ValueError: no way (mine.py, line 1)"),
        ("x = (", "cannot be run: SyntaxError: '(' was never closed (mine.py, line 1)"),
        ("class Other: pass", "defines no Mine; it defines Other"),
        ("class Mine:\n    def __init__(self):\n        1 / 0", "Mine cannot be made: ZeroDivisionError"),
        ("class Mine: pass", "a policy has triggers, start() and decide(observation)"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, capsys, text, words):
    (tmp_path / "mine.py").write_text(text)
    given = ["--policy", f"{tmp_path / 'mine.py'}:Mine", "--no-files"]
    assert main(["fly", "--farm", "miniberry-10", "--vehicle", "ideal", *given]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_objects_of_a_file_are_taken_as_they_are_and_have_no_parameters(tmp_path):
    code = "from functools import partial\ndef plan(request, *, gap=1): pass\nMine = partial(plan, gap=2)\n"
    (tmp_path / "mine.py").write_text(f"{code}class Policy: pass\npolicy = Policy()\n")
    planner = own_choice(f"{tmp_path / 'mine.py'}:Mine", "planner")
    assert (planner.name, planner.made.keywords) == ("Mine", {"gap": 2})
    assert own_choice(f"{tmp_path / 'mine.py'}:policy", "policy").name == "policy"
    with pytest.raises(ScenarioError, match="policy is an object; name its class to set parameters"):
        own_choice(f"{tmp_path / 'mine.py'}:policy:share=4", "policy")


def test_a_file_that_is_not_there_is_named(capsys):
    assert main(["fly", "--planner", "nowhere.py:Mine", "--no-files"]) == 2
    assert "there is no file nowhere.py" in capsys.readouterr().err
    assert main(["fly", "--policy", "mine.py", "--no-files"]) == 2
    assert "policy: mine.py names a file, but no policy in it; give FILE.py:NAME" in capsys.readouterr().err
    assert own_choice("spiral:direction=0.3", "planner") is None


def test_files_do_not_name_code(tmp_path):
    (tmp_path / "evil.py").write_text(
        f"open({str(tmp_path / 'ran')!r}, 'w').close()\ndef mine(request): pass\n"
    )
    name = f"{tmp_path / 'evil.py'}:mine"
    (tmp_path / "run.toml").write_text(f'planner = "{name}"\n')
    with pytest.raises(ScenarioError):
        load_scenario(tmp_path / "run.toml")
    (tmp_path / "spec.toml").write_text(f'planners = ["{name}"]\n')
    with pytest.raises(ScenarioError, match="only options of the command line take FILE"):
        BenchSpec.read(tmp_path / "spec.toml")
    (tmp_path / "table.toml").write_text(f'[policy]\nname = "{name}"\n')
    assert main(["fly", "--scenario", str(tmp_path / "table.toml"), "--no-files"]) == 2
    assert not (tmp_path / "ran").exists()


def test_texts_that_cannot_name_a_file_are_passed_over(tmp_path):
    file = tmp_path / "mine.py"
    texts = ["x**2", "**/*", "\u6f22" * 120, "a/../b", "*" * 300, "data.csv"]
    file.write_text(f"TEXTS = {texts!r}\n", encoding="utf-8")
    (tmp_path / "data.csv").write_text("1\n")
    assert [path.name for path in files_beside(file)] == ["data.csv"]


def test_a_path_of_windows_with_a_drive_letter_is_one_file():
    with pytest.raises(ScenarioError, match=r"^policy: there is no file C:\\my code\\p\.py; give FILE"):
        own_choice(r"C:\my code\p.py:Mine:speed=3", "policy")
    assert split_layer(r"C:\farms\fields.gpkg|north") == (Path(r"C:\farms\fields.gpkg"), "north")
