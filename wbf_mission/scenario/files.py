"""Scenario files, and the catalogue of scenarios and their families.

A file is TOML with the options as keys; its contents are not trusted.
"""

from __future__ import annotations

import difflib
import functools
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from geo.reading import UnreadableError, read_toml
from geo.texts import unknown
from wbf_mission.scenario.choice import names_of
from wbf_mission.scenario.option import ScenarioError
from wbf_mission.scenario.scenario import Scenario

if TYPE_CHECKING:
    from sim_vehicle.host.injection import AnyFault

_FOLDER = Path(__file__).parent / "catalogue"
_ID = re.compile(r"WBF/[\w-]+-v\d+")


@functools.cache
def scenario_ids() -> tuple[str, ...]:
    """Return the ids of the catalogued scenarios, sorted.

    >>> "WBF/Miniberry-30-v1" in scenario_ids()
    True
    """
    return tuple(sorted(f"{path.parent.name}/{path.stem}" for path in _FOLDER.glob("*/*.toml")))


def scenario_file(given: str | Path) -> Path:
    """Return the file of a scenario, given by its id or its path.

    Examples
    --------
    >>> scenario_file("WBF/Miniberry-30-v1").name, scenario_file("mine.toml").name
    ('Miniberry-30-v1.toml', 'mine.toml')
    """
    name = Path(given).as_posix()
    if name in scenario_ids():
        return _FOLDER / f"{name}.toml"
    if _ID.fullmatch(name) and not Path(given).exists():
        near = difflib.get_close_matches(name, scenario_ids(), 1, cutoff=0.0)
        msg = f"unknown scenario {name}; is {near[0]} meant? 'wbf-mission bench list' prints all"
        raise ScenarioError(msg)
    return Path(given)


def about_scenario(name: str) -> str:
    """Return the description of a scenario id, in one sentence; ScenarioError if the id is unknown."""
    lines = scenario_file(name).read_text(encoding="utf-8").splitlines()
    return " ".join(line[1:].strip() for line in lines if line.startswith("#"))


@dataclass(frozen=True, slots=True)
class Family:
    """Group of scenarios that differ from the benchmark's own world in the same way."""

    name: str
    title: str
    about: str  # Difference from the benchmark's own world
    at_home: str  # Planners, policies or estimators that are expected to do well
    scenarios: tuple[str, ...]  # Ids
    planners: tuple[str, ...] = (
        *("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint"),
        *("greedy", "rolling-horizon"),
    )
    estimators: tuple[str, ...] = ("adaptive-disk", "gp", "epidemic")  # Installed ones that model its fields


class _Families(msgspec.Struct, forbid_unknown_fields=True):
    family: tuple[Family, ...]


@functools.cache
def families() -> tuple[Family, ...]:
    """Return all families, the benchmark's own world first, with their estimators that are installed.

    >>> [family.name for family in families()][:3]
    ['own', 'worlds', 'smooth']
    """
    listed = msgspec.convert(read_toml(_FOLDER / "families.toml"), _Families).family
    installed = names_of("estimator")
    return tuple(
        replace(family, estimators=tuple(name for name in family.estimators if name in installed))
        for family in listed
    )


def get_family(name: str) -> Family:
    """Return a family by its name; ScenarioError if the name is unknown.

    >>> get_family("smooth").estimators
    ('adaptive-disk', 'gp')
    """
    known = {family.name: family for family in families()}
    if name not in known:
        raise ScenarioError(unknown("family", name, known))
    return known[name]


def family_of(scenario: str) -> Family | None:
    """Return the family of a scenario id; None if it has none.

    >>> family_of("WBF/Field-Bend-v1").name, family_of("WBF/Waterberry-v1")
    ('farms', None)
    """
    return next((family for family in families() if scenario in family.scenarios), None)


_FILES = ("farm", "mission", "vehicle", "world")


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario from a TOML file with the options of `Scenario` as keys, or by an id.

    The ids are `wbf_mission.scenario.scenario_ids`. Relative paths of a farm, mission, vehicle, world or
    field file are first searched in the folder of the scenario file.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not TOML, or has an unknown key or an invalid value.
    """
    return scenario_from_table(read_table(path), Path(path))


def load_broken_scenario(path: str | Path) -> tuple[Scenario, tuple[AnyFault, ...]]:
    """Read a scenario file, and the faults in its tables ``[[fault]]``.

    ScenarioError as for `load_scenario`; VehicleError if a fault is invalid.
    """
    path = Path(path)
    table = read_table(path)
    faults = take_faults(table, path)
    return scenario_from_table(table, path), faults


def take_faults(table: dict[str, Any], path: Path) -> tuple[AnyFault, ...]:
    """Remove the faults from a file's table and return them; VehicleError if one is invalid."""
    if "fault" not in table:
        return ()
    from sim_vehicle.host.injection import fault_part

    faults: tuple[AnyFault, ...] = fault_part("tables")(table, str(path))
    del table["fault"]
    return faults


def read_table(path: str | Path) -> dict[str, Any]:
    """Read the TOML file of a path or a scenario id as a table, without any checks."""
    try:
        return read_toml(scenario_file(path))
    except UnreadableError as error:
        msg = f"{path}: cannot be read as a scenario: {error}; give a TOML file"
        raise ScenarioError(msg) from error


def scenario_from_table(table: dict[str, Any], path: Path) -> Scenario:
    """Return the scenario of a table read from the file `path`; errors as for `load_scenario`."""
    table, folder = dict(table), scenario_file(path).parent
    for key in _FILES:
        given = table.get(key)
        # A farm file's name may be followed by ``|`` and a layer.
        if isinstance(given, str) and given and (folder / given.partition("|")[0]).is_file():
            table[key] = str(folder / given)
    if isinstance(table.get("fields"), list):
        table["fields"] = [_beside(folder, field) for field in table["fields"]]
    try:
        return Scenario(**table)
    except ScenarioError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error


def _beside(folder: Path, item: object) -> object:
    """Return the path of a field file in the scenario's folder; any other value unchanged."""
    if isinstance(item, str) and item.endswith(".toml") and (folder / item).is_file():
        return str(folder / item)
    return item
