"""A scenario has all options of a run. Equal scenarios give bit-equal results."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Unpack

from geo.texts import unknown
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
    """All options of a run.

    A keyword is the key of an option of any part (``farm``, ``planner``, ``budget``, ...; see
    docs/command-line.md), or the name of a part, which then gets the whole part.

    Parameters
    ----------
    seed : int
        Seed of all random numbers.

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
    seed: int = option(0, "Seed of all random numbers", RUN, low=0, high=2**64 - 1)

    def __init__(self, /, **options: Unpack[ScenarioKeywords]) -> None:
        given_all: dict[str, Any] = {**options}
        whole = {key: value for key, value in given_all.items() if isinstance(value, Part)}
        flat = {key: value for key, value in given_all.items() if key not in whole}
        mixed = sorted(set(flat) & set(PARTS)) if whole else []
        if mixed:
            msg = f"{mixed[0]} is a value, but other parts are objects: use scenario_with to change values"
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
            raise ScenarioError(unknown("part", next(iter(whole)), PARTS))
        object.__setattr__(self, "seed", options_of(Scenario)["seed"].checked(seed))

    def __getitem__(self, key: str) -> Any:
        """Return the value of the option with this key; raise ScenarioError if the key is unknown.

        >>> Scenario(farm="miniberry-10", wind_speed_m_s=4)["wind_speed_m_s"]
        4.0
        """
        if key == "seed":
            return self.seed
        if key not in _PLACES:
            raise ScenarioError(unknown("key", key, sorted([*_PLACES, "seed"])))
        part, name = _PLACES[key]
        return getattr(getattr(self, part), name)

    def to_dict(self) -> dict[str, Any]:
        """Return the plain values of all options by key, for a file or a summary.

        A planner, policy or estimator that is an object becomes its name.
        """
        values: dict[str, Any] = {}
        for part in PARTS:
            values |= getattr(self, part).values()
        values["seed"] = self.seed
        return {key: value.value if isinstance(value, Choice) else value for key, value in values.items()}


PARTS: Mapping[str, type[Part]] = {
    name: kind for name, kind in typing.get_type_hints(Scenario).items() if kind is not int
}
"""Classes of the parts, by name of the field of `Scenario`."""


def all_options() -> dict[str, tuple[type[Any], str, Option]]:
    """Return all options of a run by key; each is a tuple of part, field name and definition."""
    found: dict[str, tuple[type[Any], str, Option]] = {}
    for part in (*PARTS.values(), Scenario):
        for name, defined in options_of(part).items():
            if defined.key in found:
                raise AssertionError(f"option {defined.key} is in two parts")
            found[defined.key] = (part, name, defined)
    return found


_PLACES = {held.key: (part, name) for part, kind in PARTS.items() for name, held in options_of(kind).items()}


def _by_part(options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Group options by part and field name; raise ScenarioError if a key is unknown."""
    found: dict[str, dict[str, Any]] = {name: {} for name in PARTS}
    for key, value in options.items():
        if key not in _PLACES:
            raise ScenarioError(unknown("key", key, sorted([*_PLACES, "seed"])))
        part, name = _PLACES[key]
        found[part][name] = value
    return found


def require_scenario(given: Any) -> None:
    """Raise ScenarioError if `given` is not a `Scenario`, for example a dict of options."""
    if not isinstance(given, Scenario):
        how = ": write Scenario(**options)" if isinstance(given, Mapping) else ""
        raise ScenarioError(f"the scenario is a {type(given).__name__}: give a Scenario{how}")


def scenario_with(base: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """Return `base` with the values in `changes` that are not None; merge autopilot parameters.

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
