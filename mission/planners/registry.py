"""Look-up of planners by name, and planners with fixed parameters.

Each entry point of the group ``wbf_mission.planners`` is a planner.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

from geo.imports import entry_points, load_entry
from geo.named import ParameterError, check_parameters, parse_named
from mission.errors import AnswerError, PlanningError
from mission.planners.path import PlannedPath
from mission.planners.request import Planner, PlanningRequest

ENTRY_POINT_GROUP = "wbf_mission.planners"


class Registered(NamedTuple):
    """A loaded entry point: name, name in error messages, object, and parameters given in the text."""

    name: str
    what: str
    found: Any
    parameters: dict[str, Any]


@dataclass(frozen=True, slots=True)
class ConfiguredPlanner:
    """A planner with fixed parameters; its name appears in error messages and results."""

    name: str
    planner: Callable[..., PlannedPath]
    parameters: dict[str, Any]

    def __call__(self, request: PlanningRequest, /) -> PlannedPath:
        """Return the planner's path; raise AnswerError if the planner does not return a PlannedPath."""
        path: object = self.planner(request, **self.parameters)
        if not isinstance(path, PlannedPath):
            msg = f"planner {self.name} returned a {type(path).__name__}, not a PlannedPath"
            raise AnswerError(msg, "no path")
        return path


def planner_names() -> tuple[str, ...]:
    """Return the names of the installed planners, sorted.

    Examples
    --------
    >>> "lawnmower" in planner_names()
    True
    """
    return registered_names(ENTRY_POINT_GROUP)


def make_planner(planner: str | Planner, /, **parameters: Any) -> ConfiguredPlanner:
    """Return a planner with fixed parameters.

    Parameters
    ----------
    planner : str or Planner
        Your own planner, or the name of an installed planner, optionally with parameters:
        ``lawnmower:direction=0.3`` (see `geo.named.parse_named`). Names are case-insensitive.
    **parameters
        Further parameters, see `planner_parameters`. They override those of a `ConfiguredPlanner`.

    Raises
    ------
    PlanningError
        If no planner has the name, its package cannot be imported, or the object is not a planner.
    ParameterError
        If the text cannot be parsed, or a parameter is unknown or given twice.

    Examples
    --------
    >>> chosen = make_planner("Lawnmower:direction=0.3")
    >>> chosen.name, chosen.parameters
    ('lawnmower', {'direction': 0.3})
    """
    given: Mapping[str, Any] = {}
    found: Callable[..., PlannedPath]
    if isinstance(planner, str):
        named = load_registered("planner", ENTRY_POINT_GROUP, planner, parameters)
        name, given, found = named.name, named.parameters, _checked(named.found, named.what)
    elif isinstance(planner, ConfiguredPlanner):
        name, given, found = planner.name, planner.parameters, planner.planner
    else:
        name = str(getattr(planner, "__name__", type(planner).__name__))
        found = _checked(planner, f"planner {name}")
    check_parameters(f"planner {name}", parameters.keys() | given.keys(), planner_parameters(found))
    return ConfiguredPlanner(name, found, {**given, **parameters})


def planner_parameters(planner: Callable[..., PlannedPath]) -> dict[str, Any]:
    """Return the parameters of a planner (its keyword-only arguments) with their defaults.

    Examples
    --------
    >>> from mission.planners.random_waypoint import random_waypoint
    >>> planner_parameters(random_waypoint)
    {'waypoints': None}
    """
    if isinstance(planner, ConfiguredPlanner):
        return {**planner_parameters(planner.planner), **planner.parameters}
    return {
        name: argument.default
        for name, argument in inspect.signature(planner).parameters.items()
        if argument.kind is argument.KEYWORD_ONLY
    }


def load_registered(kind: str, group: str, text: str, parameters: Mapping[str, Any]) -> Registered:
    """Return the entry point that a text names (see `geo.named.parse_named`); names are case-insensitive."""
    name, given = parse_named(text)
    entry = next((found for found in entry_points(group=group) if found.name.lower() == name.lower()), None)
    if entry is None:
        msg = f"no {kind} is named {name!r}; there are {', '.join(registered_names(group)) or 'none'}"
        raise PlanningError(msg)
    found = load_entry(entry, f"{kind} {entry.name}", PlanningError)
    twice = sorted(given.keys() & parameters.keys())
    if twice:
        msg = f"{kind} {entry.name}: {twice[0]} is given twice; give it once"
        raise ParameterError(msg)
    return Registered(entry.name, f"{kind} {entry.name} ({entry.value})", found, given)


def registered_names(group: str) -> tuple[str, ...]:
    """Return the names of the entry points of a group, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


def _checked(planner: Any, what: str) -> Callable[..., PlannedPath]:
    if not callable(planner) or inspect.isclass(planner):
        fault = "is a class; give an object of it" if inspect.isclass(planner) else "is no callable"
        msg = f"{what} {fault}: a planner is called with a PlanningRequest and returns a PlannedPath"
        raise PlanningError(msg)
    return cast("Callable[..., PlannedPath]", planner)
