"""What a planner is asked: where, from where, for how much, to see how wide."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import shapely

from geo.units import FOOT_M
from mission.errors import PlanningError
from mission.planners.budget import BatchBudget, Budget, ExplainedBudget
from mission.planners.path import Area, PlannedPath, Points


@dataclass(frozen=True, slots=True)
class CropArea:
    """The land of one crop.

    Parameters
    ----------
    crop : str
        What grows there: `geo.Crop` or another name.
    area : shapely Polygon or MultiPolygon
        In metres of the farm frame.
    """

    crop: str
    area: Area

    def __post_init__(self) -> None:
        check_area(self.area, f"area of the {self.crop} crop")


SearchProgress: TypeAlias = Callable[[int, int], None]
"""Takes how many rounds of a search are done, and how many there will be as far as can be told."""


_ROUNDING_M = 1e-3


def _untold(_done: int, _total: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True, slots=True)
class PlanningRequest:
    """One planning problem. Positions are in metres of the farm frame.

    Parameters
    ----------
    area : shapely Polygon or MultiPolygon
        What is to be seen, and where the path may go, if `passable` says nothing else. Land that must not be
        flown over is left out by the caller (holes are respected).
    start_xy_m : tuple of float
        Where the flight starts; it may lie outside the area.
    budget : Budget
        What start, path and return may cost together.
    footprint_m : float
        Width of what the camera sees at once. The path keeps half of it away from the area's border, and
        rows are never closer to each other than it. 0: no inset and no limit of the density.
    crop_areas : tuple of CropArea
        The land of the crops, for planners that treat them differently.
    seed : int or numpy.random.SeedSequence
        Seed of the planners that draw.
    progress : callable
        Told by planners that search for long, see `SearchProgress`.
    passable : shapely Polygon or MultiPolygon, optional
        Where the path may go, if that is more than the area: the land between what is to be seen. It holds
        the area; None: the area. `room` is either.
    row_spacing_m : float, optional
        Distance between rows that the overlap of the images asks for, of planners that see the whole area.
        None: a footprint.
    footprint_along_m : float, optional
        Length, in the direction of the flight, of what the camera sees at once. None: as its width.
    least_leg_m : float
        Several legs in a row that are shorter are not flown, but left out by the autopilot.

    Raises
    ------
    PlanningError
        If the area is empty or invalid, or a number is not finite or out of its range.
    """

    area: Area
    start_xy_m: tuple[float, float]
    budget: Budget
    footprint_m: float = FOOT_M
    crop_areas: tuple[CropArea, ...] = ()
    seed: int | np.random.SeedSequence = 0
    progress: SearchProgress = _untold
    passable: Area | None = None
    row_spacing_m: float | None = None
    footprint_along_m: float | None = None
    least_leg_m: float = 0.0

    def __post_init__(self) -> None:
        check_area(self.area, "area")
        start = tuple(float(value) for value in self.start_xy_m)
        if len(start) != 2 or not all(math.isfinite(value) for value in start):
            msg = f"planning request: the start {self.start_xy_m} is no (x, y) in metres"
            raise PlanningError(msg)
        object.__setattr__(self, "start_xy_m", start)
        if not (math.isfinite(self.footprint_m) and self.footprint_m >= 0):
            msg = f"planning request: footprint {self.footprint_m} m is no width"
            raise PlanningError(msg)
        if not (math.isfinite(self.budget.limit) and self.budget.limit > 0):
            limit = f"{self.budget.limit} {self.budget.unit}"
            msg = f"planning request: a budget must be a finite number above zero, not {limit}"
            raise PlanningError(msg)
        self._check_room()
        self._check_camera()

    def _check_room(self) -> None:
        if self.passable is None:
            return
        check_area(self.passable, "passable land")
        outside = shapely.difference(self.area, self.passable)
        if not shapely.buffer(outside, -_ROUNDING_M).is_empty:
            msg = f"planning request: {outside.area:.3g} m2 of the area lie outside the passable land"
            raise PlanningError(msg)

    def _check_camera(self) -> None:
        for name in ("row_spacing_m", "footprint_along_m"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                msg = f"planning request: {name} {value} m must be a finite number above zero"
                raise PlanningError(msg)

    @property
    def room(self) -> Area:
        """Where the path may go."""
        return self.area if self.passable is None else self.passable

    def cost(self, points_m: Points) -> float:
        """Return the cost of start, points and, if the budget counts it, the return."""
        return float(self.budget.cost(self._flight(points_m)))

    def costs(self, paths_m: Sequence[Points]) -> list[float]:
        """Return the `cost` of each of several paths."""
        flights = [self._flight(points) for points in paths_m]
        if len(flights) > 1 and isinstance(self.budget, BatchBudget):
            return [float(cost) for cost in self.budget.costs(flights)]
        return [float(self.budget.cost(flight)) for flight in flights]

    def reason(self, points_m: Points) -> str:
        """Return why a path of infinite cost cannot be flown, if the budget can tell; else nothing."""
        return self.budget.reason(self._flight(points_m)) if isinstance(self.budget, ExplainedBudget) else ""

    def _flight(self, points_m: Points) -> Points:
        return np.vstack((np.asarray(self.start_xy_m, dtype=np.float64), points_m))


class Planner(Protocol):
    """A planner: a callable that turns a request into a path whose cost is within the request's budget."""

    def __call__(self, request: PlanningRequest, /) -> PlannedPath:
        """Plan, or raise PlanningError."""


def check_area(area: Area, what: str) -> None:
    """Raise PlanningError unless the area is a valid, finite Polygon or MultiPolygon that is not empty."""
    if not isinstance(area, shapely.Polygon | shapely.MultiPolygon):
        msg = f"planning request: the {what} must be a Polygon or MultiPolygon, not {type(area).__name__}"
        raise PlanningError(msg)
    if not np.isfinite(shapely.get_coordinates(area)).all() or not area.is_valid:
        msg = f"planning request: the {what} is not valid geometry: {shapely.is_valid_reason(area)}"
        raise PlanningError(msg)
    if area.is_empty or not area.area > 0:
        msg = f"planning request: the {what} is empty"
        raise PlanningError(msg)
