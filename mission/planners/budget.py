"""Flight budgets in metres, seconds, watt hours or timesteps of the paper's robot."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geo.texts import FOOT_M
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
    """A budget of a flight: the cost of a path, and the greatest allowed cost.

    The cost need not be a length: `wbf_mission` predicts seconds or watt hours with a model of the vehicle. A
    planner assumes only that denser paths usually cost more, and checks the cost of each path that it
    returns. A budget that computes many costs faster together than one by one is also a `BatchBudget`.
    """

    @property
    def limit(self) -> float:
        """Greatest cost of a path, in `unit`."""

    @property
    def unit(self) -> str:
        """Unit of `limit` and `cost`: ``m``, ``s``, ``Wh`` or ``steps``."""

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the cost of flying ``path_xy_m``, float64[n, 2] in metres of the farm frame, n >= 1.

        The first row is the start of the flight, the other rows are the points of the planned path. The array
        does not include the return leg: a budget that counts the return adds the leg home.
        """


@runtime_checkable
class BatchBudget(Budget, Protocol):
    """A budget that evaluates many paths in one call."""

    def costs(self, paths_xy_m: Sequence[NDArray[np.float64]]) -> list[float]:
        """Return the costs of several paths; each equals the result of `cost` to the last bit."""


@runtime_checkable
class ExplainedBudget(Budget, Protocol):
    """A budget that can say why the cost of a path is infinite."""

    def reason(self, path_xy_m: NDArray[np.float64]) -> str:
        """Return the reason why the vehicle cannot fly `path_xy_m` (as for `cost`), or "" if it can."""


@dataclass(frozen=True, slots=True)
class LengthBudget:
    """A budget of metres flown over ground.

    Parameters
    ----------
    limit_m : float
        Greatest length of approach, path and return together.
    return_to : tuple of float, optional
        End of the flight; the cost includes the leg to this position. None: the flight ends with the path.
    way : callable
        Maps a path including the return, float64[n, 2], to the line that the vehicle flies. Default: straight
        legs.

    Examples
    --------
    >>> LengthBudget(100.0, return_to=(0.0, 0.0)).cost([[0.0, 0.0], [3.0, 4.0]])
    10.0
    """

    unit: ClassVar[str] = "m"

    limit_m: float
    return_to: tuple[float, float] | None = None
    way: Way = _straight

    def __post_init__(self) -> None:
        check_limit(self.limit_m, "m")

    @property
    def limit(self) -> float:
        """Greatest length in metres."""
        return self.limit_m

    def cost(self, path_xy_m: ArrayLike) -> float:
        """Return the length from the start through the path and back to `return_to`."""
        return path_length(self.way(_with_return(path_xy_m, self.return_to)))


@dataclass(frozen=True, slots=True)
class StepBudget:
    """A budget of timesteps of the paper's robot, which moves at most one cell per timestep.

    The robot starts a new step at every waypoint. A leg therefore costs its length in cells, rounded up; a
    leg of zero length also costs one step.

    Parameters
    ----------
    limit_steps : float
        Greatest number of steps.
    step_m : float
        Length of a step: the width of a cell.
    return_to : tuple of float, optional
        End of the flight. None: the flight ends with the path, as in the paper.
    way : callable
        The flown line, as for `LengthBudget`.

    Examples
    --------
    >>> StepBudget(360, step_m=1.0).cost([[0.0, 0.0], [0.0, 0.0], [2.5, 0.0]])
    4.0
    """

    unit: ClassVar[str] = "steps"

    limit_steps: float
    step_m: float = FOOT_M
    return_to: tuple[float, float] | None = None
    way: Way = _straight

    def __post_init__(self) -> None:
        check_limit(self.limit_steps, "steps")
        if not (math.isfinite(self.step_m) and self.step_m > 0):
            msg = f"step of {self.step_m} m: the length of a step must be a finite number above zero"
            raise PlanningError(msg)

    @property
    def limit(self) -> float:
        """Greatest number of steps."""
        return self.limit_steps

    def cost(self, path_xy_m: ArrayLike) -> float:
        """Return the number of steps from the start through the path and back to `return_to`."""
        path = self.way(_with_return(path_xy_m, self.return_to))
        legs = np.hypot(*np.diff(path, axis=0).T) / self.step_m
        return float(np.maximum(np.ceil(legs - 1e-6), 1.0).sum())


def _with_return(path_xy_m: ArrayLike, return_to: tuple[float, float] | None) -> NDArray[np.float64]:
    path = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
    return path if return_to is None else np.vstack((path, np.asarray(return_to, dtype=np.float64)))


def check_limit(limit: float, unit: str) -> None:
    """Raise PlanningError unless the limit is a finite number above zero."""
    if not (math.isfinite(limit) and limit > 0):
        raise PlanningError(f"budget of {limit:g} {unit}: a budget must be a finite number above zero")


def parse_budget(text: str) -> tuple[float, str]:
    """Parse a budget such as ``8000m``.

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
        If the text is not a number with a known unit, or the number is not finite and positive.

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
        raise PlanningError(
            f"budget {shown!r} is not understood: write a positive number and a unit, for example "
            "8000m, 2.5km, 25min, 1500s, 1h, 360steps or 120Wh"
        )
    unit, factor = known
    value = float(match.group(1) + (match.group(2) or "")) * factor
    check_limit(value, unit)
    return value, unit
