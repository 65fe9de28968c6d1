"""Scenarios that results can be compared by: small files with versioned ids such as ``WBF/Miniberry-30-v1``.

What an id means never changes: a change gets a new version. None names a planner, a policy or an estimator.
"""

from __future__ import annotations

import difflib
import functools
import re
from pathlib import Path

from wbf_mission.scenario.option import ScenarioError

__all__ = ["about_scenario", "scenario_file", "scenario_ids"]

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

    Raises
    ------
    ScenarioError
        If it looks like an id and is none.

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
