"""The examples of the documentation do what they say: every ``wbf-mission`` line in a ``sh`` block runs."""

import ast
import doctest
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PAGES = sorted([REPOSITORY / "README.md", *(REPOSITORY / "docs").glob("*.md")])


def blocks(page: Path, language: str) -> list[str]:
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[str]:
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    # The benchmark of the README takes a minute: two environments show that the line is right.
    return [line.replace("--seeds 10", "--seeds 1") for line in lines if line.startswith("wbf-mission ")]


LONG = ("benchmark", "command-line", "days", "your-own")
RUN = [
    pytest.param(page, marks=[pytest.mark.slow] if page.stem in LONG else [], id=page.stem)
    for page in PAGES
    if commands(page)
]


@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_run(page: Path, tmp_path: Path) -> None:
    shutil.copytree(REPOSITORY / "missions", tmp_path / "missions")
    shutil.copytree(REPOSITORY / "docs" / "examples", tmp_path / "docs" / "examples")
    for line in commands(page):
        words = [sys.executable, "-m", "wbf_mission", *shlex.split(line)[1:]]
        done = subprocess.run(
            words, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False, env={**os.environ}
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_in_a_page_is_sound(page: Path) -> None:
    """Sessions (>>>) give what they show; other blocks are Python whose imports exist."""
    failures, _ = doctest.testfile(str(page), module_relative=False)
    assert failures == 0
    for block in blocks(page, "python"):
        if block.lstrip().startswith(">>>"):
            continue
        tree = ast.parse(block)
        imports = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Import)
            or (isinstance(node, ast.ImportFrom) and not str(node.module).startswith("my_"))
        ]
        exec(compile(ast.Module(imports, type_ignores=[]), page.name, "exec"), {})


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name}: {target}"
