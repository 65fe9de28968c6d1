"""Grid of pixels and blocks for reports and pictures, and sums by numpy for pixels of one cell.

On farms whose pixels are single cells, loading compiled code would take longer than the sums, so numpy
computes the sums. The results equal those of `wbf_mission.maps.block_sums` to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo import Farm

Floats = NDArray[np.float64]

SICK_BELOW = 0.75
"""A plant counts as sick below this value: it is nearer to infected (0.5) or lost (0) than to healthy (1)."""
CELL_BY_CELL = 240
"""Maximum number of pixels along a side; a farm with no more cells along a side has pixels of one cell."""
_BLOCKS = 24
_LEAST_BLOCK_CELLS = 5

COUNT, ILLNESS, SPREAD, SICK = range(4)


@dataclass(frozen=True, slots=True)
class MapGrid:
    """Grid of pixels and blocks; blocks have columns A, B, C, ... along x and rows 1, 2, 3, ... along y.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> grid = MapGrid.of(get_farm("waterberry"))
    >>> grid.pixel, grid.block, grid.blocks, grid.name(1, 0), grid.name(27, 4)
    (25, 250, (24, 20), 'B1', 'AB5')
    """

    shape: tuple[int, int]  # Width and height of the farm, in cells.
    cell_size_m: float  # Side of a cell.
    pixel: int  # Side of a pixel, in cells.
    pixels_a_block: int  # Pixels on a side of a block.

    @classmethod
    def of(cls, farm: Farm) -> MapGrid:
        """Return the grid of a farm, with at most 24 blocks along the farm's longer side."""
        longest = max(farm.width_cells, farm.height_cells)
        pixel = -(-longest // CELL_BY_CELL)
        side = max(-(-longest // (_BLOCKS * pixel)), -(-_LEAST_BLOCK_CELLS // pixel))
        return cls((farm.width_cells, farm.height_cells), farm.cell_size_m, pixel, side)

    @property
    def block(self) -> int:
        """Side of a block, in cells."""
        return self.pixel * self.pixels_a_block

    @property
    def pixels(self) -> tuple[int, int]:
        """Number of pixels along x and y."""
        return -(-self.shape[0] // self.pixel), -(-self.shape[1] // self.pixel)

    @property
    def blocks(self) -> tuple[int, int]:
        """Number of blocks along x and y."""
        return -(-self.shape[0] // self.block), -(-self.shape[1] // self.block)

    @staticmethod
    def name(column: int, row: int) -> str:
        """Return the name of a block: the letters of its column, then its row number, as on a road map."""
        letters = ""
        column += 1
        while column:
            column, rest = divmod(column - 1, 26)
            letters = chr(ord("A") + rest) + letters
        return f"{letters}{row + 1}"

    def by_block(self, pixels: Floats) -> Floats:
        """Return the sum over each block of `pixels`, float64[pixels along x, pixels along y]."""
        columns = np.arange(0, pixels.shape[0], self.pixels_a_block)
        rows = np.arange(0, pixels.shape[1], self.pixels_a_block)
        return np.add.reduceat(np.add.reduceat(pixels, columns, axis=0), rows, axis=1)


def sum_pixels(
    mask: NDArray[np.bool_],
    value: NDArray[np.float32],
    pixel: int,  # noqa: ARG001
    sums: Floats,
    least: Floats,
) -> None:
    """Add the sums of each pixel as `wbf_mission.maps.block_sums.sum_pixels` does, for pixels of one cell."""
    v = value[mask].astype(np.float64)
    terms = np.empty((len(v), sums.shape[2]))
    terms[:, COUNT], terms[:, ILLNESS], terms[:, SPREAD] = 1.0, 1.0 - v, v * (1.0 - v)
    terms[:, SICK] = v < SICK_BELOW
    sums[mask] += terms
    least[mask] = np.fmin(least[mask], v)


def sum_squares(
    mask: NDArray[np.bool_],
    deviation: NDArray[np.float32],
    pixel: int,  # noqa: ARG001
    sums: Floats,
) -> None:
    """Add the squares as `wbf_mission.maps.block_sums.sum_squares` does, for pixels of one cell."""
    d = deviation[mask].astype(np.float64)
    sums[mask] += d * d
