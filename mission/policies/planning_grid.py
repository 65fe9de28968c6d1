"""The planning grid: square blocks of cells, few enough for a route search."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.linear_algebra import cos, sin
from geo.system import in_parallel
from mission.planners.path import Area, Points
from mission.planners.terrain import TOLERANCE_M, is_rectangle
from mission.policies.acquisition import AcquisitionValues, SummedMap, ValueMap
from mission.policies.observation import VehicleReport

MOST_CELLS = 128
"""Longest side of a planning grid, in blocks."""
DIRECTIONS = 64
_PROBE_CELLS = (8.0, 24.0)  # `LegCosts` is fitted to the costs of legs of these lengths (blocks)


@dataclass(frozen=True, slots=True, eq=False)
class PlanningGrid:
    """The area of a vehicle, divided into square blocks of farm cells."""

    free: NDArray[np.bool_]  # Blocks entirely inside the area, bool[w, h].
    cell_m: float  # Side of a block, metres.
    block: int  # Side of a block, in farm cells.
    convex: bool  # Whether the area is a rectangle, which no leg between two of its points leaves.
    area: Area  # The area, widened slightly against rounding.

    @classmethod
    def of(cls, area: Area, shape: tuple[int, int], cell_size_m: float, footprint_m: float) -> PlanningGrid:
        """Return the planning grid of an area on a farm with `shape` cells.

        Blocks are as small as `MOST_CELLS` and the camera's footprint allow.
        """
        seen = max(1, math.floor(footprint_m / cell_size_m + 1e-6))
        block = max(seen, math.ceil(max(shape) / MOST_CELLS))
        cell_m = block * cell_size_m
        width, height = (math.ceil(side / block) for side in shape)
        x, y = np.meshgrid(np.arange(width) * cell_m, np.arange(height) * cell_m, indexing="ij")
        wide = shapely.buffer(area, TOLERANCE_M, join_style="mitre", mitre_limit=2.0)
        shapely.prepare(wide)
        free = shapely.covers(wide, shapely.box(x, y, x + cell_m, y + cell_m))
        if not free.any():
            free = shapely.covers(wide, shapely.points(x + 0.5 * cell_m, y + 0.5 * cell_m))
        return cls(free, cell_m, block, is_rectangle(area), wide)

    def pooled(self, values: AcquisitionValues) -> ValueMap:
        """Return the sum of the cell values of each block, float32[w, h]; 0 in blocks that are not free."""
        if self.block == 1:
            return np.where(self.free, values[:], np.float32(0.0)).astype(np.float32)
        width, height = self.free.shape
        sums = np.empty((width, height), np.float32)

        def work(numbers: Sequence[int]) -> None:
            column = np.empty((self.block, height * self.block), np.float32)
            for number in numbers:
                first, column[:] = number * self.block, 0.0
                if isinstance(values, SummedMap):
                    values.add_columns(first, column)
                else:
                    part = values[first : first + self.block]
                    column[: len(part), : part.shape[1]] = part
                blocks = column.reshape(self.block, height, self.block)
                sums[number] = blocks.sum(axis=(0, 2), dtype=np.float32)

        in_parallel(work, range(width))
        return np.where(self.free, sums, np.float32(0.0)).astype(np.float32)

    def shares(self, fine: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the neighbour shares of blocks, from `fine`, the neighbour shares of single cells.

        The share is the fraction of a block that a crossing vehicle observes: a strip as in `strip_width`.
        """
        if self.block == 1:
            return fine
        return np.array([[min(1.0, strip_width(fine) / self.block)]], np.float32)

    def inside(self, start_m: tuple[float, float], points_m: Points) -> Points:
        """Return the points before the first leg that leaves the area; the first leg may enter the area."""
        if self.convex or not len(points_m):
            return points_m
        path = np.vstack((np.asarray(start_m)[None], points_m))
        good = shapely.covers(self.area, shapely.linestrings(np.stack((path[:-1], path[1:]), axis=1)))
        if not shapely.covers(self.area, shapely.Point(start_m)):
            good[0] = True
        return points_m if good.all() else points_m[: int(np.argmin(good))]


def strip_width(shares: NDArray[np.float32]) -> float:
    """Return the width (cells) of the strip whose value is as large as the value that a long leg removes."""
    # A long leg removes this fraction of the value of a cell, by the cell's distance from the leg.
    beside = 1.0 - np.prod(1.0 - shares.astype(np.float64), axis=0)
    beside[len(shares) // 2] = 1.0
    return float(beside.sum())


@dataclass(frozen=True, slots=True, eq=False)
class LegCosts:
    """Linear model of the costs of legs, in the budget's unit: `turn` + slope * length in blocks."""

    turn: float  # Constant cost of a leg.
    # Cost per block of length, by direction from the x-axis towards y, float64[directions]
    slopes: NDArray[np.float64]

    @classmethod
    def of(cls, vehicle: VehicleReport, cell_m: float) -> LegCosts:
        """Fit the model to the vehicle's travel costs of legs of two lengths in each direction."""
        angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        rays = np.stack((cos(angle), sin(angle)), axis=1) * cell_m
        here = np.asarray(vehicle.position_m)
        short, long = (vehicle.travel_cost.legs(here[None], here + rays * cells)[0] for cells in _PROBE_CELLS)
        slopes = np.maximum((long - short) / (_PROBE_CELLS[1] - _PROBE_CELLS[0]), 1e-9)
        return cls(float(np.maximum(np.mean(short - _PROBE_CELLS[0] * slopes), 0.0)), slopes)

    @property
    def per_cell(self) -> float:
        """Mean cost per block of length."""
        return float(self.slopes.mean())
