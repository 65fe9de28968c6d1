"""Farms: patches of crops and their owners on a georeferenced plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import shapely

from geo.errors import FarmError
from geo.grid import FarmGrid, rasterise
from geo.units import FOOT_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geo.frame import LocalFrame

MAX_CELLS = 200_000_000
"""The largest grid that is accepted: six times Waterberry; a map of it takes 0.4 GB."""
_SNAP_M = 1e-6
_EDGE_CELLS = 1e-9


class Crop(IntEnum):
    """What a cell is; `NONE` is unpainted land."""

    NONE = 0
    STRAWBERRY = 1
    TOMATO = 2
    POND = 3
    WETLAND = 4


@dataclass(frozen=True, slots=True)
class Patch:
    """A piece of land with one crop and one owner; the polygon is in metres of the farm's frame."""

    name: str
    crop: Crop
    owner: str
    polygon: shapely.Polygon


@dataclass(frozen=True)
class Farm:
    """A farm and its neighbours.

    Parameters
    ----------
    name : str
        Name in tables and file names.
    frame : LocalFrame
        Georeference; the corner of cell (0, 0) is the frame's origin.
    width_cells, height_cells : int
        Size of the grid along x and y.
    patches : tuple of Patch
        In order of painting: where patches overlap, the later one counts.
    owner : str
        Whose farm it is: the land that is scouted and scored.
    home_m : tuple of float
        Where flights start, metres of the frame.
    cell_size_m : float
        Side of a cell, metres; one foot in the benchmark.
    obstacles : tuple of shapely.Polygon
        Where no flight may pass, metres of the frame.

    Raises
    ------
    FarmError
        If the size is not positive or too large, or the owner has no patch.
    """

    name: str
    frame: LocalFrame
    width_cells: int
    height_cells: int
    patches: tuple[Patch, ...]
    owner: str
    home_m: tuple[float, float]
    cell_size_m: float = FOOT_M
    obstacles: tuple[shapely.Polygon, ...] = ()

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell_size_m) and self.cell_size_m > 0):
            raise FarmError(f"farm {self.name!r}: cell size {self.cell_size_m} m is not positive")
        if self.width_cells < 1 or self.height_cells < 1:
            msg = f"farm {self.name!r}: a grid of {self.width_cells} x {self.height_cells} cells has no cells"
            raise FarmError(msg)
        if self.width_cells * self.height_cells > MAX_CELLS:
            raise FarmError(
                f"farm {self.name!r}: a grid of {self.width_cells} x {self.height_cells} cells is larger "
                f"than {MAX_CELLS} cells; choose larger cells than {self.cell_size_m:g} m"
            )
        if not any(patch.owner == self.owner for patch in self.patches):
            raise FarmError(f"farm {self.name!r}: no patch belongs to the owner {self.owner!r}")

    @cached_property
    def owner_area(self) -> shapely.Polygon | shapely.MultiPolygon:
        """The owner's land, ponds and wetlands included, metres."""
        return self._land(frozenset(Crop))

    def crop_area(self, crop: Crop) -> shapely.Polygon | shapely.MultiPolygon:
        """Return the owner's land of one crop, metres; an empty polygon where there is none."""
        return self._land(frozenset({crop}))

    def _land(self, crops: frozenset[Crop]) -> shapely.Polygon | shapely.MultiPolygon:
        shapes = np.array([patch.polygon for patch in self.patches])
        wanted = np.array([patch.owner == self.owner and patch.crop in crops for patch in self.patches])
        # Each patch less what is painted over it, then all at once: one after the other takes time that
        # grows with the square of their number.
        tree = shapely.STRtree(shapes)
        pieces = []
        for number in np.nonzero(wanted)[0]:
            piece = shapely.set_precision(shapes[number], _SNAP_M)
            near = np.sort(tree.query(shapes[number]))
            for over in near[(near > number) & ~wanted[near]]:
                piece = shapely.difference(piece, shapes[over], grid_size=_SNAP_M)
            pieces.append(piece)
        land = pieces[0] if len(pieces) == 1 else shapely.union_all(pieces, grid_size=_SNAP_M)
        land = shapely.simplify(land, _SNAP_M)
        parts = [part for part in shapely.get_parts(land) if part.geom_type == "Polygon" and part.area > 0]
        if len(parts) == 1:
            return parts[0]
        return shapely.MultiPolygon(parts) if parts else shapely.Polygon()

    @cached_property
    def owner_cells(self) -> int:
        """The number of the owner's cells."""
        return int(np.count_nonzero(self.grid().owned))

    def grid(self) -> FarmGrid:
        """Return the crop map; it is made at the first call and kept."""
        return self._grid

    @cached_property
    def _grid(self) -> FarmGrid:
        return rasterise(
            ((patch.polygon, int(patch.crop), patch.owner == self.owner) for patch in self.patches),
            (self.width_cells, self.height_cells),
            self.cell_size_m,
        )

    @overload
    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]: ...

    @overload
    def cell_of(
        self, x_m: NDArray[Any], y_m: NDArray[Any]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]: ...

    def cell_of(self, x_m: Any, y_m: Any) -> tuple[Any, Any]:
        """Return the cell of a point in metres: ints for scalars, int64 arrays for arrays.

        The cell may lie outside the grid; a point that is not finite has the cell -1. A point within 1e-9
        cells below an edge is on it, so that multiples of the cell size fall into the cell that they begin.
        """
        return self._index(x_m), self._index(y_m)

    def _index(self, metres: Any) -> Any:
        if isinstance(metres, np.ndarray):
            cells = np.floor(metres / self.cell_size_m + _EDGE_CELLS)
            return np.where(np.abs(cells) < 2**62, cells, -1.0).astype(np.int64)
        cell = metres / self.cell_size_m + _EDGE_CELLS
        return math.floor(cell) if math.isfinite(cell) else -1

    @overload
    def cell_centre(self, ix: int, iy: int) -> tuple[float, float]: ...

    @overload
    def cell_centre(
        self, ix: NDArray[Any], iy: NDArray[Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

    def cell_centre(self, ix: Any, iy: Any) -> tuple[Any, Any]:
        """Return the centre of a cell, metres (scalars or arrays)."""
        return (ix + 0.5) * self.cell_size_m, (iy + 0.5) * self.cell_size_m
