"""A run's budget in the vehicle's own terms."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.model import Mission
from mission.planners import Budget, PlannedPath, StepBudget, parse_budget
from mission.planners.budget import LengthBudget
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.scenario import ScenarioError

PAPER_STEPS_PER_CELL = 0.4  # timesteps of a day for each of the owner's cells (Matloob et al., experiments)

Paths = Sequence[NDArray[np.float64]]

_MOST_KNOWN = 2000
# Of the battery's usable part: where paths are decided in flight, and where flights err (as much as they take
# longer with waypoints of two metres and short rows).
_SPARED = 0.02
_SPARED_FOR_ERRORS = 0.03


@dataclass(frozen=True, slots=True)
class FlightBudget:
    """A budget in seconds or watt hours, charged by flying the paths' missions in the vehicle's own model.

    Parameters
    ----------
    limit : float
        The most that the whole flight may take, from take-off to touch-down.
    unit : {"s", "Wh"}
    price : callable
        The predicted seconds or watt hours of each of several paths, float64[n, 2]; infinite for one that
        the vehicle cannot fly.
    explain : callable
        Why the vehicle cannot fly a path; empty if it can.
    """

    limit: float
    unit: str
    price: Callable[[Paths], list[float]]
    explain: Callable[[NDArray[np.float64]], str]

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the predicted seconds or watt hours; infinite when the vehicle cannot fly the path."""
        return self.costs([path_xy_m])[0]

    def costs(self, paths_xy_m: Paths) -> list[float]:
        """Return the `cost` of each path; they are flown together."""
        return self.price(paths_xy_m)

    def reason(self, path_xy_m: NDArray[np.float64]) -> str:
        """Return why the vehicle cannot fly the path; empty if it can."""
        return self.explain(path_xy_m)


def flight_budget(limit: float, unit: str, builder: MissionBuilder) -> FlightBudget:
    """Return a budget that is charged by predicted flights.

    Parameters
    ----------
    limit : float
    unit : {"s", "Wh"}
    builder : MissionBuilder
        Makes and predicts the mission of a path.
    """

    def mission_of(path_xy_m: NDArray[np.float64]) -> Mission:
        points = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
        return builder.mission(PlannedPath(points[1:] if len(points) > 1 else points, None, "candidate"))

    # The flights of many days are planned one after the other, mostly with the same candidates.
    known: dict[bytes, float] = {}

    def price(paths_xy_m: Paths) -> list[float]:
        keys = [np.asarray(path, dtype=np.float64).tobytes() for path in paths_xy_m]
        new = {key: path for key, path in zip(keys, paths_xy_m, strict=True) if key not in known}
        costs = {key: known[key] for key in keys if key in known}
        predictions = builder.price([mission_of(path) for path in new.values()]) if new else []
        costs |= zip(new, map(price_of, predictions), strict=True)
        if len(known) + len(new) > _MOST_KNOWN:
            known.clear()
        known.update(costs)
        return [costs[key] for key in keys]

    def price_of(prediction: Prediction) -> float:
        spent = prediction.duration_s if unit == "s" else prediction.energy_wh
        # A flight that goes over the budget before it fails is told by what it has spent.
        return spent if prediction.feasible or spent > limit else math.inf

    def explain(path_xy_m: NDArray[np.float64]) -> str:
        (prediction,) = builder.price([mission_of(path_xy_m)])
        return "" if prediction.feasible else str(prediction.reason)

    return FlightBudget(limit, unit, price, explain)


def make_budget(text: str | None, builder: MissionBuilder, *, steered: bool = False) -> tuple[Budget, str]:
    """Return a budget and how to say it.

    Parameters
    ----------
    text : str or None
        As of `mission.planners.parse_budget`; None: the vehicle's battery less its reserve, for the ideal
        vehicle 0.4 times the owner's cells in timesteps.
    builder : MissionBuilder
    steered : bool
        The path is decided in flight: of the battery's usable part a little is spared then, because the last
        decision is priced from what telemetry tells, which is rounded and a moment old. It is spared, too,
        when the vehicle's estimate errs: paths are priced with an exact one.

    Raises
    ------
    PlanningError
        If the budget is not understood.
    ScenarioError
        If the budget's unit does not fit the vehicle.
    """
    farm, vehicle = builder.farm, builder.vehicle
    home = None if vehicle.is_ideal else builder.home_m
    if text is None:
        if vehicle.is_ideal:
            steps = float(round(PAPER_STEPS_PER_CELL * farm.owner_cells))
            return StepBudget(steps, farm.cell_size_m), f"{steps:.0f} steps (0.4 x the owner's cells)"
        if vehicle.battery is None:
            msg = f"vehicle {vehicle.name} has no battery to budget by: give --budget, such as 8000m or 25min"
            raise ScenarioError(msg)
        usable = vehicle.battery.capacity_wh * (1.0 - vehicle.battery.reserve_fraction)
        less = f"{vehicle.battery.reserve_fraction:.0%} reserve"
        spared = max(_SPARED if steered else 0.0, _SPARED_FOR_ERRORS if builder.estimate_errors else 0.0)
        if spared > 0.0:
            usable *= 1.0 - spared
            less += f" and {spared:.0%} of the rest"
        words = f"{usable:.1f} Wh (the battery less {less})"
        return flight_budget(usable, "Wh", builder), words
    value, unit = parse_budget(text)
    if unit == "m":
        return LengthBudget(value, home, builder.flown_way), f"{value:g} m"
    if unit == "steps":
        return StepBudget(value, farm.cell_size_m, home, builder.flown_way), f"{value:g} steps"
    if unit == "Wh" and vehicle.power is None:
        msg = f"budget {text}: vehicle {vehicle.name} uses no energy; give metres, minutes or steps"
        raise ScenarioError(msg)
    return flight_budget(value, unit, builder), f"{value:g} {unit}"
