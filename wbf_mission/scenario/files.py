"""Scenario files: TOML whose keys are the options. What is in them is not trusted."""

from __future__ import annotations

import difflib
import functools
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geo.reading import UnreadableError, read_toml
from wbf_mission.scenario.option import ScenarioError
from wbf_mission.scenario.scenario import Scenario

if TYPE_CHECKING:
    from sim_vehicle.faults.fault import Fault

_FOLDER = Path(__file__).parent / "catalogue"
_ID = re.compile(r"WBF/[\w-]+-v\d+")


@functools.cache
def scenario_ids() -> tuple[str, ...]:
    """Return the ids, sorted.

    >>> "WBF/Miniberry-30-v1" in scenario_ids()
    True
    """
    return tuple(sorted(f"{one.parent.name}/{one.stem}" for one in _FOLDER.glob("*/*.toml")))


def scenario_file(given: str | Path) -> Path:
    """Return the file of a scenario that is given by its id, or the path that is given.

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
    """Return in a sentence what an id means; ScenarioError if there is none such."""
    lines = scenario_file(name).read_text(encoding="utf-8").splitlines()
    return " ".join(line[1:].strip() for line in lines if line.startswith("#"))


_FILES = ("farm", "mission", "vehicle", "world")


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario from a TOML file whose keys are the options of `Scenario`, or by an id.

    The ids are `wbf_mission.scenario.scenario_ids`.
    A farm, mission, vehicle or world that names an existing file beside the scenario is taken from there.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not TOML, or has an unknown key or a value that cannot be used.
    """
    return scenario_from_table(read_table(path), Path(path))


def load_broken_scenario(path: str | Path) -> tuple[Scenario, tuple[Fault, ...]]:
    """Read a scenario as `load_scenario` does, and what its tables ``[[fault]]`` say goes wrong in flight.

    ScenarioError as of `load_scenario`; FaultError if a fault is wrong.
    """
    path = Path(path)
    table = read_table(path)
    faults = take_faults(table, path)
    return scenario_from_table(table, path), faults


def take_faults(table: dict[str, Any], path: Path) -> tuple[Fault, ...]:
    """Return the faults of a file's table and leave them out of it; FaultError if one is wrong."""
    from sim_vehicle.faults.fault import faults_of

    faults = faults_of(table, str(path))
    table.pop("fault", None)
    return faults


def read_table(path: str | Path) -> dict[str, Any]:
    """Read a TOML file, or that of an id, as it is."""
    try:
        return read_toml(scenario_file(path))
    except UnreadableError as error:
        msg = f"{path}: cannot be read as a scenario: {error}; give a TOML file"
        raise ScenarioError(msg) from error


def scenario_from_table(table: dict[str, Any], path: Path) -> Scenario:
    """Make a scenario from the keys of a file; ``path`` is that file. Errors as of `load_scenario`."""
    table, folder = dict(table), scenario_file(path).parent
    for key in _FILES:
        given = table.get(key)
        # A layer may follow the name of a farm file.
        if isinstance(given, str) and given and (folder / given.partition("|")[0]).is_file():
            table[key] = str(folder / given)
    if isinstance(table.get("fields"), list):
        table["fields"] = [_beside(folder, one) for one in table["fields"]]
    try:
        return Scenario(**table)
    except ScenarioError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error


def _beside(folder: Path, item: object) -> object:
    """Return the path of a field file that lies beside the scenario, anything else as it is."""
    if isinstance(item, str) and item.endswith(".toml") and (folder / item).is_file():
        return str(folder / item)
    return item
