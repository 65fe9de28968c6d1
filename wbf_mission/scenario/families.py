"""Families of catalogued scenarios, by their difference from the benchmark's own world."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import msgspec

from geo.reading import read_toml
from wbf_mission.scenario.option import ScenarioError

_FILE = Path(__file__).parent / "catalogue" / "families.toml"


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
    estimators: tuple[str, ...] = ("adaptive-disk", "gp", "epidemic")  # Estimators that model its fields


class _File(msgspec.Struct, forbid_unknown_fields=True):
    family: tuple[Family, ...]


@functools.cache
def families() -> tuple[Family, ...]:
    """Return all families, the benchmark's own world first.

    >>> [family.name for family in families()][:3]
    ['own', 'worlds', 'smooth']
    """
    return msgspec.convert(read_toml(_FILE), _File).family


def get_family(name: str) -> Family:
    """Return a family by its name; ScenarioError if the name is unknown.

    >>> get_family("smooth").estimators
    ('adaptive-disk', 'gp')
    """
    known = {family.name: family for family in families()}
    if name not in known:
        raise ScenarioError(f"unknown family {name!r:.60}: give one of {', '.join(known)}")
    return known[name]


def family_of(scenario: str) -> Family | None:
    """Return the family of a scenario id; None if it has none.

    >>> family_of("WBF/Field-Bend-v1").name, family_of("WBF/Waterberry-v1")
    ('farms', None)
    """
    return next((family for family in families() if scenario in family.scenarios), None)
