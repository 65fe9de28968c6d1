"""A scenario: everything that decides a run. Equal scenarios give equal results, bit for bit."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Unpack

from wbf_mission.scenario.choice import Choice
from wbf_mission.scenario.option import Option, Part, ScenarioError, option, options_of
from wbf_mission.scenario.parts import (
    RUN,
    CameraOptions,
    EstimateOptions,
    FarmOptions,
    MissionOptions,
    ScenarioKeywords,
    ScoreOptions,
    VehicleOptions,
    WeatherOptions,
)


@dataclass(frozen=True, slots=True, init=False)
class Scenario:
    """One run: where, with what, for how much.

    It is made of keywords, each an option of one of the parts (``farm``, ``planner``, ``budget``, ...; all
    are in docs/command-line.md); a keyword that is a part's name also takes the whole part.

    Parameters
    ----------
    seed : int
        Everything random comes from it.

    Raises
    ------
    ScenarioError
        If an option is unknown, of the wrong type or out of range.

    Examples
    --------
    >>> scenario = Scenario(farm="miniberry-10", planner="lawnmower", wind_speed_m_s=4.0)
    >>> scenario.farm.name, scenario.mission.planner.name, scenario.weather.wind_speed_m_s
    ('miniberry-10', 'lawnmower', 4.0)
    """

    farm: FarmOptions
    mission: MissionOptions
    vehicle: VehicleOptions
    weather: WeatherOptions
    camera: CameraOptions
    estimate: EstimateOptions
    score: ScoreOptions
    seed: int = option(0, "Seed of everything random", RUN, low=0, high=2**64 - 1)

    def __init__(self, /, **options: Unpack[ScenarioKeywords]) -> None:
        given_all: dict[str, Any] = {**options}
        whole = {key: one for key, one in given_all.items() if isinstance(one, Part)}
        flat = {key: one for key, one in given_all.items() if key not in whole}
        mixed = sorted(set(flat) & set(PARTS)) if whole else []
        if mixed:
            msg = f"{mixed[0]} is given as a value beside whole parts: use scenario_with to change it"
            raise ScenarioError(msg)
        seed, by_part = flat.pop("seed", 0), _by_part(flat)
        for name, kind in PARTS.items():
            given = whole.pop(name, None)
            if given is None:
                made = kind(**by_part[name])
            elif not isinstance(given, kind):
                msg = f"{name} is a {type(given).__name__}: give a {kind.__name__} or its options"
                raise ScenarioError(msg)
            else:
                made = dataclasses.replace(given, **by_part[name])
            object.__setattr__(self, name, made)
        if whole:
            raise ScenarioError(unknown_key(next(iter(whole)), list(PARTS)))
        object.__setattr__(self, "seed", options_of(Scenario)["seed"].checked(seed))

    def __getitem__(self, key: str) -> Any:
        """Return an option by the key under which it is given; ScenarioError if there is no such option.

        >>> Scenario(farm="miniberry-10", wind_speed_m_s=4)["wind_speed_m_s"]
        4.0
        """
        if key == "seed":
            return self.seed
        if key not in _PLACES:
            raise ScenarioError(unknown_key(key, [*_PLACES, "seed"]))
        part, name = _PLACES[key]
        return getattr(getattr(self, part), name)

    def to_dict(self) -> dict[str, Any]:
        """Return all options by their keys as plain values, for a file or a summary.

        A planner or an estimator that is an object stands there by its name.
        """
        values: dict[str, Any] = {}
        for part in PARTS:
            values |= getattr(self, part).values()
        values["seed"] = self.seed
        return {key: one.value if isinstance(one, Choice) else one for key, one in values.items()}


PARTS: Mapping[str, type[Part]] = {
    name: kind for name, kind in typing.get_type_hints(Scenario).items() if kind is not int
}
"""The parts by the names of the scenario's fields."""


def all_options() -> dict[str, tuple[type[Any], str, Option]]:
    """Return every option of a run by its key: the part, the name of its field there, the option."""
    found: dict[str, tuple[type[Any], str, Option]] = {}
    for part in (*PARTS.values(), Scenario):
        for name, one in options_of(part).items():
            if one.key in found:
                msg = f"option {one.key} stands in two parts"
                raise AssertionError(msg)
            found[one.key] = (part, name, one)
    return found


_PLACES = {one.key: (part, name) for part, kind in PARTS.items() for name, one in options_of(kind).items()}


def _by_part(options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Sort options by their parts and their names there; ScenarioError for an unknown one."""
    found: dict[str, dict[str, Any]] = {name: {} for name in PARTS}
    for key, value in options.items():
        if key not in _PLACES:
            raise ScenarioError(unknown_key(key, [*_PLACES, "seed"]))
        part, name = _PLACES[key]
        found[part][name] = value
    return found


def unknown_key(key: str, known: list[str]) -> str:
    """Return what to say of a key that is not known."""
    near = difflib.get_close_matches(key, known, 1)
    meant = f"; is {near[0]!r} meant?" if near else ";"
    return f"unknown key {key!r}{meant} known keys are {', '.join(sorted(known))}"


def require_scenario(given: Any) -> None:
    """Raise ScenarioError for what is no scenario, such as a dict of options."""
    if not isinstance(given, Scenario):
        how = ": write Scenario(**options)" if isinstance(given, Mapping) else ""
        msg = f"the scenario is a {type(given).__name__}: give a Scenario{how}"
        raise ScenarioError(msg)


def scenario_with(base: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """Return ``base`` with those of ``changes`` that are not None; parameters are added to its own.

    Examples
    --------
    >>> scenario_with(Scenario(), {"planner": "lawnmower", "budget": None}).mission.planner.name
    'lawnmower'
    """
    given = {key: value for key, value in changes.items() if value is not None}
    if isinstance(given.get("parameters"), Mapping):
        given["parameters"] = {**base.vehicle.parameters, **given["parameters"]}
    seed, by_part = given.pop("seed", base.seed), _by_part(given)
    parts = {name: dataclasses.replace(getattr(base, name), **by_part[name]) for name in PARTS}
    return Scenario(**parts, seed=seed)
