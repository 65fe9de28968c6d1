"""The cells of a farm: what grows on them and whose they are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from geo.errors import FarmError
from geo.raster import cell_runs, polygon_edges

if TYPE_CHECKING:
    import shapely
    from numpy.typing import NDArray

STRAWBERRY = 1
TOMATO = 2


@dataclass(frozen=True, eq=False)
class FarmGrid:
    """The crop map of a farm, one value a cell.

    Parameters
    ----------
    shape : tuple of int
        Width and height in cells; arrays are indexed ``[x, y]``.
    cell_size_m : float
        Side of a cell, metres.
    crop : int8[W, H]
        `geo.farm.Crop` of each cell.
    owned : bool[W, H]
        Whether the cell is the owner's.

    The arrays and the masks are shared and not writable.
    """

    shape: tuple[int, int]
    cell_size_m: float
    crop: NDArray[np.int8]
    owned: NDArray[np.bool_]

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
        """The owner's tomatoes, bool[W, H]."""
        return self._owned_crop(TOMATO)

    @cached_property
    def strawberry(self) -> NDArray[np.bool_]:
        """The owner's strawberries, bool[W, H]."""
        return self._owned_crop(STRAWBERRY)

    @cached_property
    def planted(self) -> NDArray[np.bool_]:
        """The owner's planted land, bool[W, H]."""
        mask = self.tomato | self.strawberry
        mask.flags.writeable = False
        return mask

    def _owned_crop(self, crop: int) -> NDArray[np.bool_]:
        mask: NDArray[np.bool_] = self.crop == crop
        mask &= self.owned
        mask.flags.writeable = False
        return mask


def rasterise(
    patches: Iterable[tuple[shapely.Polygon, int, bool]], shape: tuple[int, int], cell_size_m: float
) -> FarmGrid:
    """Paint patches in order onto a grid of cells.

    A cell belongs to the last patch that covers its centre. The test is made in cells with vertices rounded
    to a millionth of a cell, so that borders through centres fall the same way on every machine.

    Patches are (polygon, crop, owned), polygons in metres from the grid's corner, holes allowed.
    """
    crop_map = np.zeros(shape, np.int8)
    owned_map = np.zeros(shape, np.bool_)
    for polygon, crop, owned in patches:
        for runs in cell_runs(polygon_edges(polygon, cell_size_m), *shape):
            for x, first, stop in zip(*(array.tolist() for array in runs), strict=True):
                crop_map[x, first:stop] = crop
                owned_map[x, first:stop] = owned
    return FarmGrid(shape, cell_size_m, crop_map, owned_map)
