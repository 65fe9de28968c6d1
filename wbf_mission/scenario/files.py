"""Scenario files: TOML whose keys are the options. What is in them is not trusted."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from wbf_mission.scenario.option import ScenarioError
from wbf_mission.scenario.scenario import Scenario

MAX_BYTES = 2**20
_FILES = ("farm", "mission", "vehicle")


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario from a TOML file whose keys are the options of `Scenario`.

    A farm, mission or vehicle that names an existing file beside the scenario is taken from there.

    Raises
    ------
    ScenarioError
        If the file cannot be read, is not TOML, or has an unknown key or a value that cannot be used.
    """
    return scenario_from_table(read_table(path), Path(path))


def read_table(path: str | Path) -> dict[str, Any]:
    """Read a TOML file as it is; ScenarioError if it cannot be read, is too large or is not TOML."""
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            msg = f"{path}: cannot be read as a scenario (a folder or a device); give a TOML file"
            raise ScenarioError(msg)
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            msg = f"{path}: larger than {MAX_BYTES // 2**20} MiB; no scenario is"
            raise ScenarioError(msg)
        text = data.decode()
    except (OSError, ValueError) as error:
        if isinstance(error, ScenarioError):
            raise
        msg = f"{path}: cannot be read as a scenario ({_reason(error)}); give a TOML file"
        raise ScenarioError(msg) from error
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        msg = f"{path}: not TOML ({error})"
        raise ScenarioError(msg) from error
    except RecursionError:
        msg = f"{path}: not a scenario (nested too deeply)"
        raise ScenarioError(msg) from None


def scenario_from_table(table: dict[str, Any], path: Path) -> Scenario:
    """Make a scenario from the keys of a file; ``path`` is that file. Errors as of `load_scenario`."""
    table = dict(table)
    for key in _FILES:
        given = table.get(key)
        if isinstance(given, str) and given and (path.parent / given).is_file():
            table[key] = str(path.parent / given)
    if isinstance(table.get("fields"), list):
        table["fields"] = [_beside(path, one) for one in table["fields"]]
    try:
        return Scenario(**table)
    except ScenarioError as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error


def _beside(path: Path, item: object) -> object:
    """Give the path of a field file that lies beside the scenario, anything else as it is."""
    if isinstance(item, str) and item.endswith(".toml") and (path.parent / item).is_file():
        return str(path.parent / item)
    return item


def _reason(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return "not UTF-8 text" if isinstance(error, UnicodeDecodeError) else str(error)
