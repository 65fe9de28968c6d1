"""The error tree that `geo.errors` draws."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import geo.errors

ROOT = Path(geo.errors.__file__).parents[1]
FLOORS = ("geo", "sensors", "mission", "sim_vehicle", "wbf_mission")
_LINE = re.compile(r"^ {4}(?P<lead>(?:\|   )*)\+-- (?P<name>[\w.]+)  +\S")


def drawn() -> dict[str, str]:
    """Return the parent of each class, by the indentation of its line."""
    above = ["geo.errors.WbfMissionError"]
    parents = {}
    for line in str(geo.errors.__doc__).splitlines():
        if found := _LINE.match(line):
            depth = len(found["lead"]) // 4 + 1
            above[depth:] = [found["name"]]
            parents[found["name"]] = above[depth - 1]
    return parents


def test_the_drawn_tree_is_that_of_the_classes() -> None:
    defined = set()
    for floor in FLOORS:
        for file in (ROOT / floor).rglob("*.py"):
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            for name in re.findall(r"^class (\w+Error)\(", file.read_text(encoding="utf-8"), re.MULTILINE):
                if issubclass(getattr(importlib.import_module(module), name), geo.errors.WbfMissionError):
                    defined.add(f"{module}.{name}")
    parents = drawn()
    assert set(parents) == defined - {"geo.errors.WbfMissionError"}
    for name, parent in parents.items():
        child, above = (
            getattr(importlib.import_module(full.rpartition(".")[0]), full.rpartition(".")[2])
            for full in (name, parent)
        )
        assert child.__bases__[0] is above, name
