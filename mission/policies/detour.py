"""Detours: short routes through the plants beside sick ones that were found."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.planners.inside_routing import TOLERANCE_M, is_rectangle
from mission.planners.path import Area, Points
from mission.policies.acquisition import scored_cells
from mission.policies.observation import PolicyObservation, VehicleReport
from mission.policies.planning_grid import LegCosts
from mission.policies.route_search import COST, VALUE, leg_offsets, neighbour_shares, search_route

SICK_BELOW = 0.75
"""A plant with a smaller value is sick."""
_WINDOW = 24
_HORIZON = 20.0
_LONGEST_LEG = 10
_INTERVAL = 3.0
_BEAM = 4
_BESIDE, _NEAR = 1.5, 2.9
_NEAR_VALUE = 0.3
_OFFSETS = leg_offsets(_LONGEST_LEG)
_ALONE = neighbour_shares(0.0, 1.0, 1)


def detour(
    vehicle: VehicleReport, observation: PolicyObservation, promised: Iterable[Points], least_rate: float
) -> Points:
    """Find the route through plants beside sick ones, near a vehicle, that sees most of them early.

    A plant that was not observed today and could have a disease of which a sick plant was seen is worth 1
    beside that plant, and 0.3 at up to three cells from it.

    Parameters
    ----------
    promised : iterable of float64[n, 2]
        What other vehicles are going to fly, metres; what they will see counts as observed.
    least_rate : float
        Worth a cell of the way below which no route is worth while.

    Returns
    -------
    float64[n, 2]
        Metres; no points if there is nothing worth while.
    """
    cell_m, shape = observation.farm.cell_size_m, np.array(observation.model.shape)
    here = np.asarray(vehicle.position_m) / cell_m
    low = np.clip(np.floor(here).astype(int) - _WINDOW, 0, shape - 1)
    high = np.clip(np.floor(here).astype(int) + _WINDOW + 1, low + 1, shape)
    values = _beside_sick(observation, low, high)
    for path in promised:
        _take(values, path / cell_m - low)
    if not values.any():
        return np.empty((0, 2))
    costs = LegCosts.of(vehicle, cell_m)
    free = _free(vehicle.request.area, low, high, cell_m)
    per_cell = costs.per_cell
    horizon = min(_HORIZON * per_cell, vehicle.left)
    route = search_route(
        np.where(free, values, np.float32(0.0)), _ALONE, free, here[0] - low[0], here[1] - low[1], _OFFSETS,
        horizon, costs.turn, costs.slopes, _HORIZON * per_cell, max(1, int(_HORIZON / _INTERVAL)), _BEAM,
    )  # fmt: skip
    if not len(route):
        return np.empty((0, 2))
    rates = per_cell * route[:, VALUE] / np.maximum(route[:, COST], per_cell)
    good = np.flatnonzero(rates >= least_rate)
    if not len(good):
        return np.empty((0, 2))
    route = route[: good[-1] + 1]
    points: Points = (route[:, :2] + low) * cell_m
    return points


def _beside_sick(
    observation: PolicyObservation, low: NDArray[np.int_], high: NDArray[np.int_]
) -> NDArray[np.float32]:
    """Return what the plants of a window are worth, float32[w, h]."""
    grid, seen = observation.farm.grid(), observation.observations
    reach = math.ceil(_NEAR)
    near = (seen.x >= low[0] - reach) & (seen.x < high[0] + reach)
    near &= (seen.y >= low[1] - reach) & (seen.y < high[1] + reach) & (seen.day == observation.day)
    rows = np.flatnonzero(near)
    x, y, values = seen.x[rows] - low[0], seen.y[rows] - low[1], seen.values[rows]
    width, height = high - low
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    columns, lines = np.arange(width)[:, None], np.arange(height)[None, :]
    values = np.zeros((width, height), np.float32)
    for k, field in enumerate(observation.fields):
        if field.kind != "disease" or observation.weights.field[k] <= 0.0:
            continue
        with np.errstate(invalid="ignore"):
            sick = np.flatnonzero(values[:, k] < SICK_BELOW)
        if not len(sick):
            continue
        unknown = scored_cells(field, grid)[low[0] : high[0], low[1] : high[1]].copy()
        read = inside & np.isfinite(values[:, k])
        unknown[x[read], y[read]] = False
        away = np.full((width, height), np.inf)
        for i, j in zip(x[sick].tolist(), y[sick].tolist(), strict=True):
            part = slice(max(i - reach, 0), i + reach + 1), slice(max(j - reach, 0), j + reach + 1)
            there = (columns[part[0]] - i) ** 2 + (lines[:, part[1]] - j) ** 2
            np.minimum(away[part], there, out=away[part])
        values += unknown * np.where(away <= _BESIDE**2, 1.0, np.where(away <= _NEAR**2, _NEAR_VALUE, 0.0))
    return values


def _take(values: NDArray[np.float32], path: NDArray[np.float64]) -> None:
    """Take the cells that a path leads over from a window; the path in cells of it."""
    for begin, end in itertools.pairwise(path):
        steps = max(1, math.ceil(float(np.hypot(*(end - begin)))))
        cells = np.floor(begin + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - begin)).astype(int)
        cells = cells[((cells >= 0) & (cells < values.shape)).all(axis=1)]
        values[cells[:, 0], cells[:, 1]] = 0.0


def _free(area: Area, low: NDArray[np.int_], high: NDArray[np.int_], cell_m: float) -> NDArray[np.bool_]:
    """Return which cells of a window lie in the area whole, bool[w, h]."""
    x, y = np.meshgrid(*(np.arange(a, b) * cell_m for a, b in zip(low, high, strict=True)), indexing="ij")
    window = shapely.box(*(low * cell_m), *(high * cell_m))
    part = shapely.intersection(area, shapely.buffer(window, cell_m, join_style="mitre"))
    if is_rectangle(part):
        x_0, y_0, x_1, y_1 = part.bounds
        inside = (x >= x_0 - TOLERANCE_M) & (x + cell_m <= x_1 + TOLERANCE_M)
        free: NDArray[np.bool_] = inside & (y >= y_0 - TOLERANCE_M) & (y + cell_m <= y_1 + TOLERANCE_M)
        return free
    wide = shapely.buffer(part, TOLERANCE_M, join_style="mitre", mitre_limit=2.0)
    shapely.prepare(wide)
    covered: NDArray[np.bool_] = shapely.covers(wide, shapely.box(x, y, x + cell_m, y + cell_m))
    return covered
