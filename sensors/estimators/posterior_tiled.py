"""A local posterior for farms too large for the exact one: tile by tile, from the observations around.

Each tile of the farm gets the exact Gaussian process of the observations in it and within the kernel's reach
of it (four length scales), at most a given number of the nearest. Cells with no observation in reach keep the
prior; an update computes only the tiles that a new observation reaches.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.posterior_exact import merge_repeated
from sensors.estimators.rbf import Cells, Floats, RbfKernel, solve_lower

TILE_CELLS = 32


class TiledPosterior:
    """Mean and variance over the tiles that observations reach.

    Parameters
    ----------
    shape : tuple of int
        Width and height of the farm in cells.
    kernel : RbfKernel
        The covariance.
    max_points : int
        The largest number of distinct observed cells that one tile uses.

    Attributes
    ----------
    tiles : dict
        By the tile's (column, row): float32[3, w, h], the response to the values, the response to a constant
        of one (see `ExactPosterior`), and the variance of the smooth part.
    """

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel, max_points: int) -> None:
        self.shape = shape
        self.kernel = kernel
        self.max_points = max_points
        self.tiles: dict[tuple[int, int], NDArray[np.float32]] = {}
        self._rows = -(-shape[1] // TILE_CELLS)

    def condition(self, x: Cells, y: Cells, values: Floats, new: int) -> None:
        """Compute the tiles that the last `new` of all observations (x, y, values) reach."""
        dirty = self._reached(x[len(x) - new :], y[len(y) - new :])
        x, y, values, noise = merge_repeated(x, y, values, self.kernel.noise)
        order = np.argsort(self._tile_of(x, y), kind="stable")
        x, y, values, noise = x[order], y[order], values[order], noise[order]
        tiles = self._tile_of(x, y)
        for tile in dirty:
            near = self._near(tile, x, y, tiles)
            self.tiles[tile] = self._solve(tile, x[near], y[near], values[near], noise[near])

    def area(self, tile: tuple[int, int]) -> tuple[slice, slice]:
        """Return the tile's cells as slices of a farm array."""
        x, y = (i * TILE_CELLS for i in tile)
        width, height = self.shape
        return slice(x, min(x + TILE_CELLS, width)), slice(y, min(y + TILE_CELLS, height))

    def _tile_of(self, x: Cells, y: Cells) -> NDArray[np.int64]:
        tiles: NDArray[np.int64] = (x // TILE_CELLS).astype(np.int64) * self._rows + y // TILE_CELLS
        return tiles

    def _reached(self, x: Cells, y: Cells) -> Iterator[tuple[int, int]]:
        reach = self.kernel.reach
        hit = np.zeros((-(-self.shape[0] // TILE_CELLS), self._rows), np.bool_)
        spans = [
            (np.clip(a - reach, 0, n - 1) // TILE_CELLS, np.clip(a + reach, 0, n - 1) // TILE_CELLS)
            for a, n in ((x, self.shape[0]), (y, self.shape[1]))
        ]
        for x0, x1, y0, y1 in np.unique(np.stack([*spans[0], *spans[1]], axis=1), axis=0).tolist():
            hit[x0 : x1 + 1, y0 : y1 + 1] = True
        return ((i, j) for i, j in np.argwhere(hit).tolist())

    def _near(self, tile: tuple[int, int], x: Cells, y: Cells, tiles: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return the indices of the observations in reach of the tile, the nearest if there are too many."""
        reach = self.kernel.reach
        rings = -(-reach // TILE_CELLS)
        i, j = tile
        columns = np.arange(max(0, i - rings), i + rings + 1) * self._rows
        first = np.searchsorted(tiles, columns + max(0, j - rings))
        last = np.searchsorted(tiles, columns + min(self._rows - 1, j + rings), side="right")
        candidates = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
        (x0, x1), (y0, y1) = ((s.start, s.stop - 1) for s in self.area(tile))
        away_x = np.maximum(np.maximum(x0 - x[candidates], x[candidates] - x1), 0)
        away_y = np.maximum(np.maximum(y0 - y[candidates], y[candidates] - y1), 0)
        away = np.maximum(away_x, away_y)
        near: NDArray[np.intp] = candidates[away <= reach]
        if len(near) > self.max_points:
            near = near[np.argsort(away[away <= reach], kind="stable")[: self.max_points]]
        return near

    def _solve(
        self, tile: tuple[int, int], x: Cells, y: Cells, values: Floats, noise: Floats
    ) -> NDArray[np.float32]:
        columns, rows = (np.arange(s.start, s.stop) for s in self.area(tile))
        factor = np.linalg.cholesky(self.kernel.between(x, y) + np.diag(noise))
        factor_x = self.kernel.along_x(x, columns) * self.kernel.amplitude
        factor_y = self.kernel.along_y(y, rows)
        known = solve_lower(factor, (factor_x[:, :, None] * factor_y[:, None, :]).reshape(len(x), -1))
        weights = solve_lower(factor, np.stack([values, np.ones_like(values)], axis=1))
        out = np.empty((3, len(columns), len(rows)), np.float32)
        out[:2] = (weights.T @ known).reshape(2, *out.shape[1:])
        out[2] = (self.kernel.amplitude - np.einsum("ij,ij->j", known, known)).reshape(out.shape[1:])
        return out
