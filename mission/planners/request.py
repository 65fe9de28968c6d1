"""The request to a planner (area, start, budget, footprint), and planners by their names."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias, cast

import numpy as np
import shapely

from geo.imports import entry_points, load_entry
from geo.named import ParameterError, check_parameters, parse_named
from geo.texts import FOOT_M, unknown
from mission.errors import AnswerError, PlanningError
from mission.planners.budget import BatchBudget, Budget, ExplainedBudget
from mission.planners.path import Area, PlannedPath, Points


@dataclass(frozen=True, slots=True)
class CropArea:
    """The land of one crop.

    Parameters
    ----------
    crop : str
        A `geo.Crop` or the name of another crop.
    area : shapely Polygon or MultiPolygon
        Land of the crop, in metres of the farm frame.
    """

    crop: str
    area: Area

    def __post_init__(self) -> None:
        check_area(self.area, f"area of the {self.crop} crop")


SearchProgress: TypeAlias = Callable[[int, int], None]
"""Callback of a search: takes the number of rounds done and the estimated total number of rounds."""


_ROUNDING_M = 1e-3  # Outlines are rounded, so the area may extend this far beyond the passable land.


def _no_progress(_done: int, _total: int) -> None:
    pass


@dataclass(frozen=True, slots=True)
class PlanningRequest:
    """One planning problem. Positions are in metres of the farm frame.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        Land to cover, without the land that must not be flown over (holes). Without `passable` the path must
        stay inside this land.
    start_xy_m : tuple of float
        Start of the flight, inside or outside the area.
    budget : Budget
        Limit and cost of approach, path and return together.
    footprint_m : float
        Width of an image on the ground. The path stays half a footprint inside the area's border, and rows
        are at least a footprint apart. 0: no inset and no least spacing.
    crop_areas : tuple of CropArea
        Land of each crop, for planners that treat crops differently.
    seed : int or numpy.random.SeedSequence
        Seed of random planners.
    progress : callable
        Progress callback of long searches, see `SearchProgress`.
    passable : shapely Polygon or MultiPolygon, optional
        Land that the path may cross, including the area. None: the area only.
    row_spacing_m : float, optional
        Row spacing that gives the wanted image overlap, for planners that cover the whole area. None: the
        footprint.
    footprint_along_m : float, optional
        Length of an image on the ground, in the direction of flight. None: equal to `footprint_m`.
    least_leg_m : float
        Shortest leg that the autopilot flies reliably. An autopilot skips waypoints if several successive
        legs are shorter.

    Raises
    ------
    PlanningError
        If the area is empty or invalid, or a number is not finite or out of range.
    """

    area: Area
    start_xy_m: tuple[float, float]
    budget: Budget
    footprint_m: float = FOOT_M
    crop_areas: tuple[CropArea, ...] = ()
    seed: int | np.random.SeedSequence = 0
    progress: SearchProgress = _no_progress
    passable: Area | None = None
    row_spacing_m: float | None = None
    footprint_along_m: float | None = None
    least_leg_m: float = 0.0

    def __post_init__(self) -> None:
        check_area(self.area, "area")
        start = tuple(float(value) for value in self.start_xy_m)
        if len(start) != 2 or not all(math.isfinite(value) for value in start):
            msg = f"planning request: the start {self.start_xy_m} is not a point (x, y) in metres"
            raise PlanningError(msg)
        object.__setattr__(self, "start_xy_m", start)
        if not (math.isfinite(self.footprint_m) and self.footprint_m >= 0):
            msg = f"planning request: footprint {self.footprint_m} m must be a finite number, zero or more"
            raise PlanningError(msg)
        if not (math.isfinite(self.budget.limit) and self.budget.limit > 0):
            limit = f"{self.budget.limit} {self.budget.unit}"
            raise PlanningError(f"planning request: a budget must be a finite number above zero, not {limit}")
        for name in ("row_spacing_m", "footprint_along_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise PlanningError(f"planning request: {name} {value} m must be a finite number above zero")
        if self.passable is None:
            return
        check_area(self.passable, "passable land")
        outside = shapely.difference(self.area, self.passable)
        if not shapely.buffer(outside, -_ROUNDING_M).is_empty:
            msg = f"planning request: {outside.area:.3g} m2 of the area are outside the passable land"
            raise PlanningError(msg)

    @property
    def room(self) -> Area:
        """The land that the path may cross: `passable`, or `area` if `passable` is None."""
        return self.area if self.passable is None else self.passable

    def cost(self, points_m: Points) -> float:
        """Return the cost of the flight from the start through the points; the budget may add the return."""
        return float(self.budget.cost(self._flight(points_m)))

    def costs(self, paths_m: Sequence[Points]) -> list[float]:
        """Return the costs of the flights along several paths, as `cost` does for one path."""
        flights = [self._flight(points) for points in paths_m]
        if len(flights) > 1 and isinstance(self.budget, BatchBudget):
            return [float(cost) for cost in self.budget.costs(flights)]
        return [float(self.budget.cost(flight)) for flight in flights]

    def reason(self, points_m: Points) -> str:
        """Return the reason for the infinite cost of a path; empty if the budget gives no reason."""
        return self.budget.reason(self._flight(points_m)) if isinstance(self.budget, ExplainedBudget) else ""

    def _flight(self, points_m: Points) -> Points:
        return np.vstack((np.asarray(self.start_xy_m, dtype=np.float64), points_m))


class Planner(Protocol):
    """A planner: a callable that turns a request into a path within the request's budget."""

    def __call__(self, request: PlanningRequest, /) -> PlannedPath:
        """Return a path for the request, or raise PlanningError."""


def check_area(area: Area, what: str) -> None:
    """Raise PlanningError unless the area is a valid, finite and non-empty Polygon or MultiPolygon."""
    if not isinstance(area, shapely.Polygon | shapely.MultiPolygon):
        msg = f"planning request: the {what} must be a Polygon or MultiPolygon, not {type(area).__name__}"
        raise PlanningError(msg)
    if not np.isfinite(shapely.get_coordinates(area)).all() or not area.is_valid:
        msg = f"planning request: the {what} is not valid geometry: {shapely.is_valid_reason(area)}"
        raise PlanningError(msg)
    if area.is_empty or not area.area > 0:
        raise PlanningError(f"planning request: the {what} is empty")


ENTRY_POINT_GROUP = "wbf_mission.planners"


class Registered(NamedTuple):
    """A loaded entry point: name, name for error messages, object, and the parameters in the user's text."""

    name: str
    what: str
    found: Any
    parameters: dict[str, Any]


@dataclass(frozen=True, slots=True)
class ConfiguredPlanner:
    """A planner with fixed parameters, and its name for error messages and results."""

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
        Further parameters, see `planner_parameters`. They override the parameters of a `ConfiguredPlanner`.

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
    """Load the entry point that a text names (see `geo.named.parse_named`); names are case-insensitive."""
    name, given = parse_named(text)
    entry = next((found for found in entry_points(group=group) if found.name.lower() == name.lower()), None)
    if entry is None:
        raise PlanningError(unknown(kind, name, registered_names(group)))
    found = load_entry(entry, f"{kind} {entry.name}", PlanningError)
    twice = sorted(given.keys() & parameters.keys())
    if twice:
        raise ParameterError(f"{kind} {entry.name}: {twice[0]} is given twice; give it once")
    return Registered(entry.name, f"{kind} {entry.name} ({entry.value})", found, given)


def registered_names(group: str) -> tuple[str, ...]:
    """Return the names of the entry points of a group, sorted."""
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


def _checked(planner: Any, what: str) -> Callable[..., PlannedPath]:
    if not callable(planner) or inspect.isclass(planner):
        fault = "is a class; give an instance of it" if inspect.isclass(planner) else "is not a callable"
        msg = f"{what} {fault}: a planner is called with a PlanningRequest and returns a PlannedPath"
        raise PlanningError(msg)
    return cast("Callable[..., PlannedPath]", planner)
