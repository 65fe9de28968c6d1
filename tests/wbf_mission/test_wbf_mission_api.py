"""The front door: its page, its example, its weight, and what stands in its way."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import wbf_mission
from wbf_mission.packages import PACKAGES

REPOSITORY = Path(__file__).parents[2]


def python_blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_the_page_tells_all_public_names_and_no_others():
    text = (REPOSITORY / "docs" / "api.md").read_text(encoding="utf-8")
    table = text.partition("| name | is |")[2].partition("## A scenario")[0]
    told = {name for row in table.splitlines() for name in re.findall(r"`([^`]+)`", row.partition(" | ")[0])}
    assert told == set(wbf_mission.__all__)
    for name in wbf_mission.__all__:
        assert getattr(wbf_mission, name) is not None
        assert name in dir(wbf_mission)
    with pytest.raises(AttributeError, match="no attribute 'flie'"):
        wbf_mission.flie  # noqa: B018


def test_a_result_has_what_the_page_tells():
    text = (REPOSITORY / "docs" / "api.md").read_text(encoding="utf-8").partition("## A result")[2]
    told = [
        name
        for row in text.splitlines()
        for name in re.findall(r"`(\w+)(?:\([^`]*)?`", row.partition(" | ")[0])
    ]
    assert len(told) > 15
    there = {*dir(wbf_mission.Result), *wbf_mission.Result.__dataclass_fields__}
    assert set(told) <= there


def test_the_example_of_the_readme_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    (example,) = python_blocks(REPOSITORY / "README.md")
    assert example in python_blocks(REPOSITORY / "docs" / "api.md")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(example, "README.md", "exec"), names)
    assert "Outcome.COMPLETED" in capsys.readouterr().out
    assert Path("fly.png").read_bytes().startswith(b"\x89PNG")
    result, again = names["result"], wbf_mission.load_result("runs/mine")
    assert isinstance(result, wbf_mission.Result)
    assert again.score == result.score
    assert again.estimator == result.estimator
    tables = again.tables()
    assert tables["observations"].num_rows == len(result.observations)
    assert {"time_s", "score", "loss_tylcv"} <= set(tables["history"].column_names)


def test_the_import_is_light():
    heavy = ["numpy", "scipy", "shapely", "pyproj", "numba", "matplotlib", "pymavlink", "pyarrow", "typer"]
    for then in ("pass", "wbf_mission.Scenario()"):
        code = f"import sys, wbf_mission; {then}; print([name for name in {heavy!r} if name in sys.modules])"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", PACKAGES)
@pytest.mark.parametrize("kind", ["file", "folder", "package"])
def test_what_hides_a_package_is_named(tmp_path, name, kind):
    hiding = tmp_path / (f"{name}.py" if kind == "file" else name)
    if kind == "file":
        hiding.write_text("")
    else:
        hiding.mkdir()
    if kind == "package":
        (hiding / "__init__.py").write_text("")
    code = (
        f"import sys; sys.path.insert(0, {str(REPOSITORY)!r}); sys.path.insert(0, {str(tmp_path)!r})\n"
        "try:\n    import wbf_mission\nexcept ImportError as error:\n    print(error)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    # A folder without __init__.py hides nothing as long as the package itself is on the path.
    if kind == "folder" and not done.stdout:
        return
    assert str(hiding) in done.stdout
    assert name in done.stdout
    assert done.stdout.count("\n") == 1
