"""What is imported is declared, and what is declared is used."""

import ast
import functools
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def names(requirements):
    return {re.match(r"[A-Za-z0-9._-]+", text)[0].lower().replace("_", "-") for text in requirements}


def executed(tree):
    """The statements that are executed: not those for type checkers only."""
    rest = [tree]
    while rest:
        yield (node := rest.pop())
        checks = isinstance(node, ast.If) and isinstance(node.test, ast.Name)
        below = node.orelse if checks and node.test.id == "TYPE_CHECKING" else ast.iter_child_nodes(node)
        rest += [child for child in below if not isinstance(child, ast.expr)]


@functools.cache
def imported(*folders):
    """Top-level modules that the files import when they run, at any place in them."""
    found = {}
    for folder in folders:
        for path in (ROOT / folder).rglob("*.py"):
            for node in executed(ast.parse(path.read_text(encoding="utf-8"))):
                modules = []
                if isinstance(node, ast.Import):
                    modules = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and node.level == 0:
                    modules = [node.module]
                for module in modules:
                    found.setdefault(module.partition(".")[0], path.relative_to(ROOT))
    return {name: path for name, path in found.items() if name not in sys.stdlib_module_names}


@functools.cache
def distributions():
    return {
        module: {name.lower().replace("_", "-") for name in found}
        for module, found in packages_distributions().items()
    }


def test_every_import_of_the_product_is_declared():
    extras = PROJECT["optional-dependencies"]
    used = ("serial", "dask", "gis", "mavsdk", "rl")
    declared = names(PROJECT["dependencies"]).union(*(names(extras[one]) for one in used))
    of = distributions()
    missing = {
        f"{module} ({path})"
        for module, path in imported(*PACKAGES).items()
        if module not in PACKAGES and not of.get(module, {module}) & declared
    }
    assert not missing, "declare these in pyproject.toml"


def test_every_dependency_is_imported_by_the_product():
    of = distributions()
    used = {name for module in imported(*PACKAGES) for name in of.get(module, {module})}
    used.add("websockets")  # uvicorn, which is told to, imports it
    assert names(PROJECT["dependencies"]) <= used


@pytest.mark.parametrize("folder", ["tests", "benchmarks"])
def test_what_tests_and_benchmarks_import_is_declared(folder):
    declared = names(PROJECT["dependencies"]).union(*map(names, PROJECT["optional-dependencies"].values()))
    of = distributions()
    own = {path.stem for path in (ROOT / folder).rglob("*.py")} | set(PACKAGES) | {folder}
    missing = {
        f"{module} ({path})"
        for module, path in imported(folder).items()
        if module not in own and module in of and not of[module] & declared
    }
    assert not missing, "declare these in pyproject.toml"


def test_the_page_on_installation_names_every_dependency():
    page = (ROOT / "docs" / "installation.md").read_text(encoding="utf-8").lower()
    for name in names(PROJECT["dependencies"]):
        assert f"| {name} " in page, name
    for extra in PROJECT["optional-dependencies"]:
        assert f"`{extra}`" in page
