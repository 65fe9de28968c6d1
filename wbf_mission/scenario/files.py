"""Scenario files, and the catalogue of scenarios and their families.

A scenario file is TOML with the options as keys. The content of a file is not trusted.
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
    """Return the sorted ids of the scenarios in the catalogue.

    >>> "WBF/Miniberry-30-v1" in scenario_ids()
    True
    """
    return tuple(sorted(f"{path.parent.name}/{path.stem}" for path in _FOLDER.glob("*/*.toml")))


def scenario_file(given: str | Path) -> Path:
    """Return the file of a scenario that is given by an id or a path.

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
    """Return a sentence that describes a scenario; raise ScenarioError if the id is unknown."""
    lines = scenario_file(name).read_text(encoding="utf-8").splitlines()
    return " ".join(line[1:].strip() for line in lines if line.startswith("#"))


@dataclass(frozen=True, slots=True)
class Family:
    """A group of scenarios that differ in the same way from the world of the benchmark."""

    name: str
    title: str
    about: str  # Difference from the world of the benchmark.
    at_home: str  # Planners, policies or estimators expected to do well.
    scenarios: tuple[str, ...]  # Ids of the scenarios.
    planners: tuple[str, ...] = (
        *("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint"),
        *("greedy", "rolling-horizon"),
    )
    estimators: tuple[str, ...] = ("adaptive-disk", "gp", "epidemic")  # Installed models of the fields


class _Families(msgspec.Struct, forbid_unknown_fields=True):
    family: tuple[Family, ...]


@functools.cache
def families() -> tuple[Family, ...]:
    """Return all families, first the benchmark's own world; leave out estimators not installed.

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
    """Return the family with this name; raise ScenarioError if the name is unknown.

    >>> get_family("smooth").estimators
    ('adaptive-disk', 'gp')
    """
    known = {family.name: family for family in families()}
    if name not in known:
        raise ScenarioError(unknown("family", name, known))
    return known[name]


def family_of(scenario: str) -> Family | None:
    """Return the family to which a scenario id belongs; None if it belongs to no family.

    >>> family_of("WBF/Field-Bend-v1").name, family_of("WBF/Waterberry-v1")
    ('farms', None)
    """
    return next((family for family in families() if scenario in family.scenarios), None)


_FILES = ("farm", "mission", "vehicle", "world")


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario, by id or from a TOML file whose keys are the options of `Scenario`.

    `wbf_mission.scenario.scenario_ids` returns the ids. A relative path of a farm, mission, vehicle, world or
    field file is first looked for in the folder of the scenario file.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not TOML, or has an unknown key or an invalid value.
    """
    return scenario_from_table(read_table(path), Path(path))


def load_broken_scenario(path: str | Path) -> tuple[Scenario, tuple[AnyFault, ...]]:
    """Read a scenario file and the faults in the file's tables ``[[fault]]``.

    Raise ScenarioError as `load_scenario` does, and VehicleError if a fault is invalid.
    """
    path = Path(path)
    table = read_table(path)
    faults = take_faults(table, path)
    return scenario_from_table(table, path), faults


def take_faults(table: dict[str, Any], path: Path) -> tuple[AnyFault, ...]:
    """Remove the faults from a file's table and return them; raise VehicleError for an invalid fault."""
    if "fault" not in table:
        return ()
    from sim_vehicle.host.injection import fault_part

    faults: tuple[AnyFault, ...] = fault_part("tables")(table, str(path))
    del table["fault"]
    return faults


def read_table(path: str | Path) -> dict[str, Any]:
    """Read the TOML file that a path or a scenario id names as a table, without checking the table."""
    try:
        return read_toml(scenario_file(path))
    except UnreadableError as error:
        raise ScenarioError(f"{path}: cannot be read as a scenario: {error}; give a TOML file") from error


def scenario_from_table(table: dict[str, Any], path: Path) -> Scenario:
    """Make a scenario of a table from the file `path`; raise errors as `load_scenario` does."""
    table, folder = dict(table), scenario_file(path).parent
    for key in _FILES:
        given = table.get(key)
        # After the name of a farm file there may be ``|`` and a layer.
        if isinstance(given, str) and given and (folder / given.partition("|")[0]).is_file():
            table[key] = str(folder / given)
    if isinstance(table.get("fields"), list):
        table["fields"] = [_beside(folder, field) for field in table["fields"]]
    try:
        return Scenario(**table)
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from error


def _beside(folder: Path, item: object) -> object:
    """Return the path of a field file that is in the scenario's folder, or any other value unchanged."""
    if isinstance(item, str) and item.endswith(".toml") and (folder / item).is_file():
        return str(folder / item)
    return item
