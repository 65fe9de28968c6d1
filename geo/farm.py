"""A farm: patches of land, each with a crop and an owner, on a georeferenced plane."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
import shapely

from geo.errors import FarmError
from geo.grid import MAX_CROPS, NOT_GROWN, Crop, FarmGrid, rasterise
from geo.texts import FOOT_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geo.frame import LocalFrame

Land: TypeAlias = shapely.Polygon | shapely.MultiPolygon

MAX_CELLS = 200_000_000
"""Largest number of cells of a farm: six times as many as Waterberry has. A map of this size takes 0.4 GB."""
_NOT_SEEN = "not scouted, because no field concerns this crop; name a field that concerns it"
_SNAP_M = 1e-6  # Borders are rounded to this step, so that adjacent borders coincide.
_ARC_SEGMENTS = 16  # With this many segments per quarter circle the error is 0.1 % of the radius.
_EDGE_CELLS = 1e-9  # Larger than the rounding error of a multiple of the cell size.


def united(areas: Sequence[Land]) -> Land:
    """Return the union of areas (m), without GEOS's losses (see `_overlay`)."""
    return _overlay(shapely.union_all, areas)


def _overlay(operation: Callable[..., Land], *areas: Land | Sequence[Land]) -> Land:
    """Return the exact result of a set operation, or the result on a grid if they differ beyond rounding.

    If borders differ only by rounding, GEOS can lose whole areas without an error: GEOS 3.14 lost two of the
    five parts of a field. Operations on a grid do not have this fault.
    """
    exact, on_grid = operation(*areas), operation(*areas, grid_size=_SNAP_M)
    border_m = sum(float(np.sum(shapely.length(area))) for area in areas)
    return exact if abs(exact.area - on_grid.area) <= _SNAP_M * border_m else on_grid


@dataclass(frozen=True, slots=True)
class Patch:
    """A polygon of land with one crop and one owner, in metres of the farm's frame.

    `crop` is a value of `geo.grid.Crop` or any other lower-case name.
    """

    name: str
    crop: str
    owner: str
    polygon: shapely.Polygon


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An obstacle or a no-fly zone.

    Parameters
    ----------
    polygon : shapely.Polygon
        Outline, metres of the farm's frame.
    height_m : float or None
        Height above the ground; flights higher by the margin pass over. None: no flight passes over.
    margin_m : float or None
        Distance that flights keep from the obstacle; None takes the flight's default margin.
    name : str
        Name in messages.
    """

    polygon: shapely.Polygon
    height_m: float | None = None
    margin_m: float | None = None
    name: str = ""

    def margin(self, default_m: float) -> float:
        """Return the distance (m) that flights keep from the obstacle: `margin_m`, or else `default_m`."""
        return default_m if self.margin_m is None else self.margin_m

    def widened(self, margin_m: float, more_m: float = 0.0) -> shapely.Polygon:
        """Return the outline, buffered by `more_m` plus the obstacle's margin (default: `margin_m`)."""
        return shapely.buffer(self.polygon, self.margin(margin_m) + more_m, quad_segs=_ARC_SEGMENTS)

    def bars(self, altitude_m: float, margin_m: float) -> bool:
        """Return whether a flight at this altitude above the ground has to go round the obstacle.

        Examples
        --------
        >>> shed = Obstacle(shapely.box(0, 0, 10, 10), height_m=6.0)
        >>> shed.bars(7.0, 2.0), shed.bars(8.0, 2.0)
        (True, False)
        """
        return self.height_m is None or altitude_m < self.height_m + self.margin(margin_m)


@dataclass(frozen=True)
class Farm:
    """A farm and its neighbours' land.

    Parameters
    ----------
    name : str
        Name in tables and file names.
    frame : LocalFrame
        Georeference; the corner of cell (0, 0) is the frame's origin.
    width_cells, height_cells : int
        Size of the grid along x and y.
    patches : tuple of Patch
        Patches in painting order: a later patch covers earlier patches.
    owner : str
        Owner of the land that is scouted and scored.
    home_m : tuple of float
        Start of flights, metres of the frame.
    cell_size_m : float
        Side of a cell, metres; one foot in the benchmark.
    obstacles : tuple of Obstacle
        Obstacles and no-fly zones.
    scouted : tuple of str
        Crops to be scouted; if empty, all crops of the owner.
    rally_m : tuple of tuple of float
        Rally points, where a vehicle may land if it cannot return home, metres of the frame.
    degrees : float64[n, 2]
        Longitude and latitude of corners, home and rally points as in the farm's file, for `geo.save_farm`. A
        comparison by ``==`` ignores these positions.
    notes : tuple of str
        Notes on assumptions and repairs made in reading the farm's file. ``==`` ignores the notes.

    Raises
    ------
    FarmError
        If the grid is empty or too large, or no patch belongs to `owner`.
    """

    name: str
    frame: LocalFrame
    width_cells: int
    height_cells: int
    patches: tuple[Patch, ...]
    owner: str
    home_m: tuple[float, float]
    cell_size_m: float = FOOT_M
    obstacles: tuple[Obstacle, ...] = ()
    rally_m: tuple[tuple[float, float], ...] = ()
    scouted: tuple[str, ...] = ()
    degrees: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)), compare=False, repr=False)
    notes: tuple[str, ...] = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell_size_m) and self.cell_size_m > 0):
            raise FarmError(f"farm {self.name!r}: cell size {self.cell_size_m} m is not positive")
        if self.width_cells < 1 or self.height_cells < 1:
            msg = f"farm {self.name!r}: a grid of {self.width_cells} x {self.height_cells} cells has no cells"
            raise FarmError(msg)
        if self.width_cells * self.height_cells > MAX_CELLS:
            raise FarmError(
                f"farm {self.name!r}: a grid of {self.width_cells} x {self.height_cells} has more "
                f"than {MAX_CELLS} cells; choose cells larger than {self.cell_size_m:g} m"
            )
        if len(self.crops) > MAX_CROPS:
            raise FarmError(f"farm {self.name!r}: {len(self.crops)} crops; give at most {MAX_CROPS} crops")
        if not any(patch.owner == self.owner for patch in self.patches):
            raise FarmError(f"farm {self.name!r}: no patch belongs to the owner {self.owner!r}")

    @cached_property
    def owner_area(self) -> Land:
        """The owner's land including ponds and wetlands, in metres of the frame."""
        return self.crop_area(*self.crops)

    @cached_property
    def crops(self) -> tuple[str, ...]:
        """Crop names in the order of the grid's crop indices: the benchmark's crops, then other crops."""
        return tuple(dict.fromkeys((*map(str, Crop), *(str(patch.crop) for patch in self.patches))))

    @cached_property
    def grown(self) -> tuple[str, ...]:
        """Names of the crops that the owner grows; ponds, wetlands and unpainted land are not crops."""
        own = dict.fromkeys(str(patch.crop) for patch in self.patches if patch.owner == self.owner)
        return tuple(crop for crop in own if crop not in NOT_GROWN)

    def scouting(self, crops: Iterable[str]) -> Farm:
        """Return the farm with only `crops` scouted, or with all crops if the owner grows none of `crops`."""
        wanted = set(crops)
        scouted = tuple(crop for crop in self.grown if crop in wanted)
        if len(scouted) in (0, len(self.grown)):
            scouted = ()
        if scouted == self.scouted:
            return self
        notes = [note for note in self.notes if not note.endswith(_NOT_SEEN)]
        if scouted:
            others = ", ".join(crop for crop in self.grown if crop not in scouted)
            notes.append(f"{others}: {_NOT_SEEN}")
        return replace(self, scouted=scouted, notes=tuple(notes))

    @cached_property
    def scouted_area(self) -> Land:
        """The owner's land with scouted crops, minus the obstacles, in metres of the frame."""
        return self.without_obstacles(self.crop_area(*(self.scouted or self.grown)))

    def without_obstacles(self, area: Land) -> Land:
        """Return an area (metres) minus the outlines of all obstacles, regardless of their heights."""
        if not self.obstacles:
            return area
        barred = united([obstacle.polygon for obstacle in self.obstacles])
        return _overlay(shapely.difference, area, barred)

    @property
    def scouted_cells(self) -> NDArray[np.bool_]:
        """A new mask of the cells to be scouted, bool[W, H]."""
        return self.scouted_in(...)

    def scouted_in(self, where: Any) -> NDArray[np.bool_]:
        """Return the part `where` of the mask of the cells to be scouted."""
        grid = self.grid()
        cells = grid.of_crops(self.scouted or self.grown, where) & grid.owned[where]
        if self.obstacles:
            under = ((obstacle.polygon, 0, True) for obstacle in self.obstacles)
            cells &= ~rasterise(under, grid.shape, self.cell_size_m).owned[where]
        return cells

    @cached_property
    def scouted_count(self) -> int:
        """The number of cells to be scouted."""
        return int(np.count_nonzero(self.scouted_cells))

    def crop_area(self, *crops: str) -> Land:
        """Return the owner's land with these crops (m), or an empty polygon if there is no such land."""
        shapes = np.array([patch.polygon for patch in self.patches])
        wanted = np.array([patch.owner == self.owner and patch.crop in crops for patch in self.patches])
        # Later patches are cut out of each patch. Joining the pieces one by one would take quadratic time.
        tree = shapely.STRtree(shapes)
        pieces = []
        for number in np.nonzero(wanted)[0]:
            piece = shapely.set_precision(shapes[number], _SNAP_M)
            near = np.sort(tree.query(shapes[number]))
            for over in near[(near > number) & ~wanted[near]]:
                piece = shapely.difference(piece, shapes[over], grid_size=_SNAP_M)
            pieces.append(piece)
        land = pieces[0] if len(pieces) == 1 else shapely.union_all(pieces, grid_size=_SNAP_M)
        # With a precision, GEOS would also round shapes made from this land, even narrow buffers: reset it.
        land = shapely.set_precision(shapely.simplify(land, _SNAP_M), 0.0)
        parts = [part for part in shapely.get_parts(land) if part.geom_type == "Polygon" and part.area > 0]
        if len(parts) == 1:
            return parts[0]
        return shapely.MultiPolygon(parts) if parts else shapely.Polygon()

    @cached_property
    def owner_cells(self) -> int:
        """The number of cells that belong to the owner."""
        return int(np.count_nonzero(self.grid().owned))

    def grid(self) -> FarmGrid:
        """Return the farm's crop map, which is made at the first call and kept."""
        return self._grid

    @cached_property
    def _grid(self) -> FarmGrid:
        return rasterise(
            (
                (patch.polygon, self.crops.index(patch.crop), patch.owner == self.owner)
                for patch in self.patches
            ),
            (self.width_cells, self.height_cells),
            self.cell_size_m,
            self.crops,
        )

    @overload
    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]: ...

    @overload
    def cell_of(
        self, x_m: NDArray[Any], y_m: NDArray[Any]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]: ...

    def cell_of(self, x_m: Any, y_m: Any) -> tuple[Any, Any]:
        """Return the cell of a point in metres: ints for scalars, int64 arrays for arrays.

        The cell may be outside the grid; a coordinate that is not finite gives index -1. A point up to 1e-9
        cells below an edge belongs to the cell above it, so that rounding never puts a multiple of the cell
        size into the cell below.
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
        """Return the x and y of a cell's centre, metres (scalars or arrays)."""
        return (ix + 0.5) * self.cell_size_m, (iy + 0.5) * self.cell_size_m
