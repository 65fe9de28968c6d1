"""The crop map of a farm: the crop of each cell, and whether the cell is the owner's."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from geo.errors import FarmError

if TYPE_CHECKING:
    import shapely
    from numpy.typing import NDArray


class Crop(StrEnum):
    """Kinds of land in the benchmark; `NONE` is unpainted land. A farm may have other crops too."""

    NONE = "none"
    STRAWBERRY = "strawberry"
    TOMATO = "tomato"
    POND = "pond"
    WETLAND = "wetland"


NOT_GROWN = frozenset({Crop.NONE, Crop.POND, Crop.WETLAND})
"""Kinds of land that bear no crop and are not scouted."""
_CELLS_AT_ONCE = 320_000
MAX_CROPS = 100  # A crop index has to fit into int8
CROP_NAMES = "names of crops are up to 40 lower-case letters, digits, spaces, hyphens and underscores"
_CROP_NAME = re.compile(r"[^\W\d_][\w -]{0,39}")


def is_crop_name(name: str) -> bool:
    """Return whether a text is a valid crop name.

    >>> is_crop_name("sweet potato"), is_crop_name("Potato"), is_crop_name("")
    (True, False, False)
    """
    return bool(_CROP_NAME.fullmatch(name)) and name == name.lower()


@dataclass(frozen=True, eq=False)
class FarmGrid:
    """Crop map of a farm, with one value per cell. Arrays and masks are shared and not writable.

    Parameters
    ----------
    shape : tuple of int
        Width and height in cells; arrays are indexed ``[x, y]``.
    cell_size_m : float
        Side of a cell, metres.
    crop : int8[W, H]
        Crop of each cell, as an index of `crops`.
    owned : bool[W, H]
        Whether the cell is the owner's.
    crops : tuple of str
        Crop names: those of the benchmark, then further crops of this farm.
    """

    shape: tuple[int, int]
    cell_size_m: float
    crop: NDArray[np.int8]
    owned: NDArray[np.bool_]
    crops: tuple[str, ...] = tuple(Crop)

    def __post_init__(self) -> None:
        if self.crop.shape != self.shape or self.owned.shape != self.shape:
            msg = f"farm grid: arrays of {self.crop.shape} and {self.owned.shape} do not fit {self.shape}"
            raise FarmError(msg)
        for name in ("crop", "owned"):
            view = getattr(self, name).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    @cached_property
    def tomato(self) -> NDArray[np.bool_]:
        """Mask bool[W, H] of the owner's tomato cells."""
        return self._owned([Crop.TOMATO])

    @cached_property
    def strawberry(self) -> NDArray[np.bool_]:
        """Mask of the owner's strawberry cells, bool[W, H]."""
        return self._owned([Crop.STRAWBERRY])

    @cached_property
    def planted(self) -> NDArray[np.bool_]:
        """Mask of the owner's cells with a crop, bool[W, H]."""
        return self._owned([crop for crop in self.crops if crop not in NOT_GROWN])

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of all owners' cells with each crop."""
        return {name: int(np.count_nonzero(self.of_crops([name]))) for name in self.crops}

    @property
    def further_crops(self) -> str:
        """Names of this farm's crops that are not in the benchmark, as one text for digests."""
        return "".join(f"{name};" for name in self.crops[len(Crop) :])

    def of_crops(self, names: Iterable[str], where: Any = ...) -> NDArray[np.bool_]:
        """Return a new mask of all owners' cells with these crops: bool[W, H], or its part `where`."""
        crop = self.crop[where]
        mask = np.zeros(crop.shape, np.bool_)
        numbers = [self.crops.index(name) for name in names if name in self.crops]
        # np.isin would take eight bytes per cell. Strips of rows stay in the processor's cache.
        rows = max(1, _CELLS_AT_ONCE * len(crop) // max(1, crop.size))
        for first in range(0, len(crop), rows):
            part = slice(first, first + rows)
            for number in numbers:
                mask[part] |= crop[part] == number
        return mask

    def _owned(self, names: Iterable[str]) -> NDArray[np.bool_]:
        mask = self.of_crops(names)
        mask &= self.owned
        mask.flags.writeable = False
        return mask


def rasterise(
    patches: Iterable[tuple[shapely.Polygon, int, bool]],
    shape: tuple[int, int],
    cell_size_m: float,
    crops: tuple[str, ...] = tuple(Crop),
) -> FarmGrid:
    """Paint patches in order onto a grid of cells.

    A cell belongs to the last patch that covers its centre. Vertices are rounded to a millionth of a cell, so
    that every machine gives a cell whose centre is on a border to the same patch.

    A patch is the tuple (polygon, index of the crop in `crops`, whether the owner owns it). Polygons are in
    metres from the grid's corner and may have holes.
    """
    crop_map = np.zeros(shape, np.int8)
    owned_map = np.zeros(shape, np.bool_)
    for polygon, crop, owned in patches:
        for runs in _cell_runs(_edges(polygon, cell_size_m), *shape):
            for x, first, stop in zip(*(array.tolist() for array in runs), strict=True):
                crop_map[x, first:stop] = crop
                owned_map[x, first:stop] = owned
    return FarmGrid(shape, cell_size_m, crop_map, owned_map, crops)


_TIE_CELLS = 1e-9  # A centre closer to an edge counts as on the edge; rounding errors are below 1e-11.
_CROSSINGS_AT_ONCE = 2_000_000  # Arrays for a batch of this many crossings take 200 MB.

Runs = tuple["NDArray[np.int64]", "NDArray[np.int64]", "NDArray[np.int64]"]


def _edges(polygon: shapely.Polygon, cell_size_m: float) -> NDArray[np.float64]:
    """Return the edges of a polygon's rings, float64[n, 4] x1, y1, x2, y2 in cells, rounded to 1e-6."""
    edges = []
    for ring in (polygon.exterior, *polygon.interiors):
        xy = np.round(shapely.get_coordinates(ring) / cell_size_m, 6)
        edges.append(np.hstack([xy[:-1], xy[1:]]))
    return np.concatenate(edges)


def _cell_runs(edges: NDArray[np.float64], width: int, height: int) -> Iterator[Runs]:
    """Yield the cells whose centre is inside a polygon, as runs ``first <= y < stop`` in a column x.

    The fill rule is even-odd over all rings. Outer boundaries and boundaries of holes belong to the polygon.
    Runs in one column may overlap. Parts outside the grid are cut off.
    """
    flip = edges[:, 0] > edges[:, 2]
    edges = np.where(flip[:, None], edges[:, [2, 3, 0, 1]], edges)
    # An edge crosses the columns first..stop-1, the columns at its two ends included.
    first = np.clip(np.ceil(edges[:, 0] - 0.5 - _TIE_CELLS), 0, width).astype(np.int64)
    stop = np.clip(np.floor(edges[:, 2] - 0.5 + _TIE_CELLS) + 1, first, width).astype(np.int64)
    yield from _runs_between(edges, first, stop, 0, width, height)


def _runs_between(
    edges: NDArray[np.float64],
    first: NDArray[np.int64],
    stop: NDArray[np.int64],
    column: int,
    end: int,
    height: int,
) -> Iterator[Runs]:
    low = np.maximum(first, column)
    count = np.maximum(np.minimum(stop, end) - low, 0)
    total = int(count.sum())
    if total == 0:
        return
    if total > _CROSSINGS_AT_ONCE and end - column > 1:
        middle = (column + end) // 2
        yield from _runs_between(edges, first, stop, column, middle, height)
        yield from _runs_between(edges, first, stop, middle, end, height)
        return
    edge = np.repeat(np.arange(len(edges)), count)
    x = np.arange(total) - np.repeat(np.cumsum(count) - count, count) + low[edge]
    x1, y1, x2, y2 = edges[edge].T
    centre = x + 0.5
    low_y, high_y = np.minimum(y1, y2), np.maximum(y1, y2)
    upright = x1 == x2
    slope = np.divide(y2 - y1, x2 - x1, out=np.zeros(total), where=~upright)
    y = np.clip(y1 + (centre - x1) * slope, low_y, high_y)
    # The boundary has the cells with centres on an edge; an edge along a centre line has a run of such cells.
    reach = np.where(upright, np.inf, _TIE_CELLS * np.abs(slope))
    yield _clipped(x, np.maximum(y - reach, low_y), np.minimum(y + reach, high_y), height)
    # The interior is between pairs of crossings; the half-open interval counts a vertex once.
    inside = (centre >= x1) & (centre < x2)
    x, y = x[inside], y[inside]
    order = np.lexsort((y, x))
    x, y = x[order], y[order]
    yield _clipped(x[::2], y[::2], y[1::2], height)


def _clipped(
    x: NDArray[np.int64], bottom: NDArray[np.float64], top: NDArray[np.float64], height: int
) -> Runs:
    first = np.clip(np.ceil(bottom - 0.5 - _TIE_CELLS), 0, height).astype(np.int64)
    stop = np.clip(np.floor(top - 0.5 + _TIE_CELLS) + 1, 0, height).astype(np.int64)
    some = stop > first
    return x[some], first[some], stop[some]
