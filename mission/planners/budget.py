"""Budgets of flights, in metres, seconds, watt hours or steps of the paper's robot."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geo.units import FOOT_M
from mission.errors import PlanningError
from mission.planners.path import path_length

_UNITS = {
    "m": ("m", 1.0),
    "km": ("m", 1000.0),
    "s": ("s", 1.0),
    "sec": ("s", 1.0),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "step": ("steps", 1.0),
    "steps": ("steps", 1.0),
    "wh": ("Wh", 1.0),
    "kwh": ("Wh", 1000.0),
}
Way: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
_BUDGET = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)(e[+-]?\d+)?\s*([a-z]+)\s*", re.IGNORECASE | re.ASCII)


def _straight(path_xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return path_xy_m


@runtime_checkable
class Budget(Protocol):
    """Limit and cost of paths.

    The cost need not be a length: the application predicts seconds or watt hours with the vehicle's model. A
    planner assumes only that denser paths cost roughly more, and checks every path that it returns. A budget
    that prices several paths at once in less time is also a `BatchBudget`.
    """

    @property
    def limit(self) -> float:
        """The most that a path may cost, in `unit`."""

    @property
    def unit(self) -> str:
        """The unit of `limit` and `cost`: ``m``, ``s``, ``Wh`` or ``steps``."""

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the cost of flying ``path_xy_m``, float64[n, 2] in metres of the farm frame, n >= 1.

        The first row is the start of the flight, the others are the points of the planned path. The path
        leaves out the way home: a budget that pays for it adds it.
        """


@runtime_checkable
class BatchBudget(Budget, Protocol):
    """A budget that prices many paths at once."""

    def costs(self, paths_xy_m: Sequence[NDArray[np.float64]]) -> list[float]:
        """Return the `cost` of each path, equal to the last bit."""


@runtime_checkable
class ExplainedBudget(Budget, Protocol):
    """A budget that gives the reason of an infinite cost."""

    def reason(self, path_xy_m: NDArray[np.float64]) -> str:
        """Return in words why a path (as for `cost`) cannot be flown; empty if it can."""


@dataclass(frozen=True, slots=True)
class LengthBudget:
    """A budget of flown metres over ground.

    Parameters
    ----------
    limit_m : float
        The greatest length of start, path and return together.
    return_to : tuple of float, optional
        End of the flight; the leg there is part of the cost. None: the flight ends with the path.
    way : callable
        Takes the path, the return included, float64[n, 2], and returns the line as it is flown; by default
        straight from point to point.

    Examples
    --------
    >>> LengthBudget(100.0, return_to=(0.0, 0.0)).cost([[0.0, 0.0], [3.0, 4.0]])
    10.0
    """

    limit_m: float
    return_to: tuple[float, float] | None = None
    way: Way = _straight

    def __post_init__(self) -> None:
        check_limit(self.limit_m, "m")

    @property
    def limit(self) -> float:
        """The limit in metres."""
        return self.limit_m

    @property
    def unit(self) -> str:
        """``m``."""
        return "m"

    def cost(self, path_xy_m: ArrayLike) -> float:
        """Return the length from the start through the path and back to `return_to`."""
        path = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
        if self.return_to is not None:
            path = np.vstack((path, np.asarray(self.return_to, dtype=np.float64)))
        return path_length(self.way(path))


@dataclass(frozen=True, slots=True)
class StepBudget:
    """A budget of timesteps of the paper's robot, which moves at most one cell in a timestep.

    The robot takes a new step at every waypoint, so a leg costs its length in cells rounded up, and a
    waypoint at the robot's own position costs one step too.

    Parameters
    ----------
    limit_steps : float
        The number of steps.
    step_m : float
        Length of a step: one cell.
    return_to : tuple of float, optional
        End of the way. None: it ends with the path, as in the paper.
    way : callable
        As for `LengthBudget`.

    Examples
    --------
    >>> StepBudget(360, step_m=1.0).cost([[0.0, 0.0], [0.0, 0.0], [2.5, 0.0]])
    4.0
    """

    limit_steps: float
    step_m: float = FOOT_M
    return_to: tuple[float, float] | None = None
    way: Way = _straight

    def __post_init__(self) -> None:
        check_limit(self.limit_steps, "steps")
        if not (math.isfinite(self.step_m) and self.step_m > 0):
            msg = f"step of {self.step_m} m: a step budget needs a step longer than nothing"
            raise PlanningError(msg)

    @property
    def limit(self) -> float:
        """The number of steps."""
        return self.limit_steps

    @property
    def unit(self) -> str:
        """``steps``."""
        return "steps"

    def cost(self, path_xy_m: ArrayLike) -> float:
        """Return the number of steps from the start through the path and back to `return_to`."""
        path = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
        if self.return_to is not None:
            path = np.vstack((path, np.asarray(self.return_to, dtype=np.float64)))
        legs = np.hypot(*np.diff(self.way(path), axis=0).T) / self.step_m
        return float(np.maximum(np.ceil(legs - 1e-6), 1.0).sum())


def check_limit(limit: float, unit: str) -> None:
    """Raise PlanningError unless the limit is a finite number above zero."""
    if not (math.isfinite(limit) and limit > 0):
        msg = f"budget of {limit:g} {unit}: a budget must be a finite number above zero"
        raise PlanningError(msg)


def parse_budget(text: str) -> tuple[float, str]:
    """Read a budget such as ``8000m``.

    Parameters
    ----------
    text : str
        A number and its unit: ``8000m``, ``2.5km``, ``25min``, ``1500s``, ``1h``, ``360steps``, ``120Wh``.

    Returns
    -------
    tuple of float and str
        The value in the base unit, and the base unit: ``m``, ``s``, ``steps`` or ``Wh``.

    Raises
    ------
    PlanningError
        If the text is no number with a known unit, or the number is not finite and above zero.

    Examples
    --------
    >>> parse_budget("2.5km")
    (2500.0, 'm')
    >>> parse_budget("25 min")
    (1500.0, 's')
    """
    match = _BUDGET.fullmatch(text)
    known = match and _UNITS.get(match.group(3).lower())
    if match is None or known is None:
        shown = text if len(text) <= 40 else text[:37] + "..."
        msg = (
            f"budget {shown!r} is not understood: write a positive number and a unit, for example "
            "8000m, 2.5km, 25min, 1500s, 1h, 360steps or 120Wh"
        )
        raise PlanningError(msg)
    unit, factor = known
    value = float(match.group(1) + (match.group(2) or "")) * factor
    check_limit(value, unit)
    return value, unit
