"""No part of the code grows beyond its budget of lines, ``.ci/budget.toml``."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUDGET = tomllib.loads((ROOT / ".ci" / "budget.toml").read_text())
ADDONS = ROOT / "wbf_mission" / "addons"
BESIDE = {"typescript": ("wbf_mission/addons/web/page/src", "*.ts"), "docs": ("docs", "*.md")}


def lines_of(paths):
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def sources_of(part, name):
    if part == "addons":
        return (ADDONS / name).rglob("*.py")
    if part == "beside":
        folder, pattern = BESIDE.get(name, (name, "*.py"))
        # Types that are made of Python are counted there.
        return (path for path in (ROOT / folder).rglob(pattern) if path.name != "schema.ts")
    return (path for path in (ROOT / name).rglob("*.py") if not path.is_relative_to(ADDONS))


@pytest.mark.parametrize(("part", "name"), [(part, name) for part, held in BUDGET.items() for name in held])
def test_a_part_keeps_its_budget(part, name):
    lines = lines_of(sources_of(part, name))
    assert 0 < lines <= BUDGET[part][name], (
        f"{name} has {lines} lines: shorten it, or raise its budget in .ci/budget.toml with a reason"
    )


def test_every_add_on_has_a_budget():
    assert {path.parent.name for path in ADDONS.glob("*/__init__.py")} == BUDGET["addons"].keys()
    assert max(BUDGET["addons"].values()) <= 4000
