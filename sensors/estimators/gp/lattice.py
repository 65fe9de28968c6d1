"""Lattice of nodes that have the posterior of a Gaussian process; cells between nodes are interpolated.

Nodes are a quarter of a lengthscale apart. If that is below two cells along both axes, every cell is a node.
Between nodes, mean and variance are interpolated by polynomials of degree five through six nodes along each
axis. For a field of unit variance, the interpolation error is 2e-5 in the mean and 1e-4 in the variance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.system import in_parallel
from sensors.estimators.gp.rbf import RbfKernel
from sensors.observations import GrowingArray
from sensors.scoring.information import tile_shape, tiles_of_boxes

POINTS = 6
MARGIN = POINTS // 2

Values = NDArray[np.float32]
Mask = NDArray[np.bool_]


def lagrange_weights(step: int) -> Values:
    """Return the weights of six nodes for each cell from one node to the next, float32[6, step].

    The six nodes are the last three nodes up to the cell and the next three nodes after the cell.

    Examples
    --------
    >>> lagrange_weights(2)[:, 1].astype(float).round(4).tolist()
    [0.0117, -0.0977, 0.5859, 0.5859, -0.0977, 0.0117]
    """
    place = np.arange(step) / step
    nodes = np.arange(1 - MARGIN, MARGIN + 1)
    weights = np.ones((POINTS, step))
    for i, node in enumerate(nodes):
        for other in nodes[nodes != node]:
            weights[i] *= (place - other) / (node - other)
    return weights.astype(np.float32)


@compiled(nogil=True)
def write_from_nodes(
    posterior: Values,
    weights_x: Values,
    weights_y: Values,
    box: Any,
    prior: Any,
    limits: Any,
    value: Values,
    uncertainty: Values,
) -> None:
    """Interpolate between nodes, and write value and uncertainty of the cells in a box.

    Parameters
    ----------
    posterior : float32[3, w, h]
        Posterior at the nodes: response to the values, response to a constant, and reduction of the variance.
        Along each axis, the third node is at cell 0.
    weights_x, weights_y : float32[6, step]
        Interpolation weights from `lagrange_weights`.
    box : tuple of four ints
        Half-open ranges of cells along x and along y: x0, x1, y0, y1.
    prior : tuple of three floats
        Mean, variance of the latent function, variance of the noise.
    limits : tuple of two floats
        Bounds to which the value is clipped.
    value, uncertainty : float32[W, H]
        Maps that are changed in the box.
    """
    step_x, step_y = weights_x.shape[1], weights_y.shape[1]
    x0, x1, y0, y1 = box
    mean, amplitude, noise = np.float32(prior[0]), np.float32(prior[1]), np.float32(prior[2])
    low, high = np.float32(limits[0]), np.float32(limits[1])
    zero = np.float32(0.0)
    j0, j1 = y0 // step_y, (y1 - 1) // step_y + POINTS
    between = np.empty((2, j1 - j0), np.float32)
    for x in range(x0, x1):
        i, phase = divmod(x, step_x)
        between[:] = zero
        for k in range(POINTS):
            weight = weights_x[k, phase]
            for j in range(j0, j1):
                between[0, j - j0] += weight * (posterior[0, i + k, j] - mean * posterior[1, i + k, j])
                between[1, j - j0] += weight * posterior[2, i + k, j]
        for j in range(j0, j1 - POINTS + 1):
            first, last = max(y0, j * step_y), min(y1, (j + 1) * step_y)
            a0, a1, a2, a3, a4, a5 = between[0, j - j0 : j - j0 + POINTS]
            b0, b1, b2, b3, b4, b5 = between[1, j - j0 : j - j0 + POINTS]
            t0, t1 = first - j * step_y, last - j * step_y
            w0, w1, w2 = weights_y[0, t0:t1], weights_y[1, t0:t1], weights_y[2, t0:t1]
            w3, w4, w5 = weights_y[3, t0:t1], weights_y[4, t0:t1], weights_y[5, t0:t1]
            values, deviations = value[x, first:last], uncertainty[x, first:last]
            # Because the sums are written out, the compiler uses vector instructions for this loop.
            for t in range(len(values)):
                shift = w0[t] * a0 + w1[t] * a1 + w2[t] * a2 + w3[t] * a3 + w4[t] * a4 + w5[t] * a5
                known = w0[t] * b0 + w1[t] * b1 + w2[t] * b2 + w3[t] * b3 + w4[t] * b4 + w5[t] * b5
                values[t] = min(high, max(low, mean + (zero + shift)))
                deviations[t] = np.sqrt(max(zero, amplitude - known) + noise)


@compiled(nogil=True)
def write_cells(
    posterior: Values,
    tiles: NDArray[np.int64],
    prior: Any,
    limits: Any,
    value: Values,
    uncertainty: Values,
) -> None:
    """Write value and uncertainty of tiles whose cells are all nodes; see `write_from_nodes`.

    Parameters
    ----------
    posterior : float32[slots, 3, w, h]
        Posterior of each slot; the slot's array begins at the first node of its tile.
    tiles : int64[n, 5]
        Slot of each tile, and half-open ranges of cells along x and along y: x0, x1, y0, y1.
    """
    mean, amplitude, noise = np.float32(prior[0]), np.float32(prior[1]), np.float32(prior[2])
    low, high = np.float32(limits[0]), np.float32(limits[1])
    for k in range(len(tiles)):
        slot, x0, x1, y0, y1 = tiles[k]
        for x in range(x0, x1):
            for y in range(y0, y1):
                i, j = x - x0, y - y0
                shifted = mean + posterior[slot, 0, i, j] - mean * posterior[slot, 1, i, j]
                value[x, y] = min(high, max(low, shifted))
                left = max(np.float32(0.0), amplitude - posterior[slot, 2, i, j])
                uncertainty[x, y] = np.sqrt(left + noise)


NODES_PER_LENGTH = 4
_COLUMNS_AT_ONCE = 256
_STRIP_COLUMNS = 32

Box = tuple[int, int, int, int]
Strip = tuple[slice, slice, NDArray[np.bool_] | None]
Then = Callable[[slice, slice, NDArray[np.bool_] | None], None]


class LatticeAxis:
    """The nodes along one axis, which are grouped into tiles.

    With `single`, each cell is a node. Otherwise further nodes outside the farm serve the interpolation at
    the border. `edges` holds the first node of each tile and the end of the last tile. `first` is the
    position of the first node, in cells.
    """

    def __init__(self, cells: int, step: int, *, single: bool, tile_cells: float) -> None:
        self.cells = cells
        self.step = step
        self.single = single
        self.nodes = cells if single else -(-cells // step) + POINTS - 1
        self.first = 0 if single else -(MARGIN - 1) * step
        self.tiles = max(1, round(cells / tile_cells))
        self.edges = np.linspace(0, self.nodes, self.tiles + 1).round().astype(np.int64)
        self.weights = lagrange_weights(step)

    @property
    def places(self) -> NDArray[np.float64]:
        """Positions of the nodes, in cells."""
        return self.first + self.step * np.arange(self.nodes, dtype=np.float64)

    def reached(self, cells: NDArray[np.integer], reach: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return, for each cell, the first and the last tile that has a node within `reach` of the cell."""
        places = cells.astype(np.int64)
        low = -((self.first - places + reach) // self.step)
        high = (places + reach - self.first) // self.step
        a, b = (
            np.clip(np.searchsorted(self.edges, node, side="right") - 1, 0, self.tiles - 1)
            for node in (low, high)
        )
        return a, b

    def span(self, first: int, last: int) -> tuple[int, int]:
        """Return the half-open range of cells that depend on the nodes of tiles `first` to `last`."""
        low, high = int(self.edges[first]), int(self.edges[last + 1])
        if self.single:
            return low, high
        # A cell depends on the last three nodes up to the cell and on the three nodes after it.
        return max(0, (low - POINTS + 1) * self.step), min(self.cells, high * self.step)


class NodeLattice:
    """Posterior at nodes, in tiles, and a record of the tiles still to be written to the cells.

    The posterior of a node has three parts: the mean under a prior mean of zero, this mean if all
    observations were 1, and the reduction of the variance. `posterior` is float32[slots, 3, w, h]. If every
    cell is a node, each solved tile has a slot; otherwise slot 0 holds all nodes. Whoever changes `posterior`
    must call `changed`.
    """

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel, tile_cells: tuple[float, float]) -> None:
        self.shape = shape
        self.kernel = kernel
        steps = [max(1, int(length / NODES_PER_LENGTH)) for length in (kernel.length_x, kernel.length_y)]
        self._single = max(steps) == 1
        self.x, self.y = (
            LatticeAxis(cells, step, single=self._single, tile_cells=tile)
            for cells, step, tile in zip(shape, steps, tile_cells, strict=True)
        )
        self._touched = np.zeros((self.x.tiles, self.y.tiles), np.bool_)
        self._unwritten = self._touched.copy()
        self._slots = np.zeros(self._touched.shape, np.int64)
        if self._single:
            widest, highest = (int(np.diff(axis.edges).max()) for axis in (self.x, self.y))
            self._tiles = GrowingArray((3, widest, highest), np.float32)
        else:
            self._tiles = GrowingArray((3, self.x.nodes, self.y.nodes), np.float32)
            self._tiles.append(np.zeros((1, 3, self.x.nodes, self.y.nodes), np.float32))

    @property
    def posterior(self) -> Values:
        """Posterior of all slots; after a call of `places_of` this may be another array."""
        return self._tiles.array

    def places_of(self, tiles: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the slot of each tile, and the slot's first node along x and along y, int64[n, 3].

        `tiles` is int64[n, 2]. A tile that has no slot yet gets a slot filled with zeros.
        """
        i, j = tiles.T
        if not self._single:
            return np.zeros((len(tiles), 3), np.int64)
        new = ~self._touched[i, j]
        self._slots[i[new], j[new]] = len(self._tiles) + np.arange(np.count_nonzero(new))
        self._touched[i, j] = True
        self._tiles.append(np.zeros((np.count_nonzero(new), *self._tiles.array.shape[1:]), np.float32))
        return np.column_stack([self._slots[i, j], self.x.edges[i], self.y.edges[j]])

    def tiles_of(self, hosts: Callable[[Any], Mask]) -> Mask:
        """Return the tiles whose nodes any cell of a mask depends on; `hosts` returns parts of the mask."""
        starts, ends = np.array([self.y.span(j, j) for j in range(self.y.tiles)]).T
        tiles = np.empty((self.x.tiles, self.y.tiles), np.bool_)
        for i in range(self.x.tiles):
            rows = np.flatnonzero(hosts((slice(*self.x.span(i, i)), slice(None))).any(axis=0))
            tiles[i] = np.searchsorted(rows, starts) < np.searchsorted(rows, ends)
        return tiles

    def changed(self, tiles: NDArray[np.bool_]) -> None:
        """Mark the tiles at whose nodes the posterior has changed."""
        self._touched |= tiles
        self._unwritten |= tiles

    def write(
        self,
        mean: float,
        *,
        clip: bool,
        whole: bool,
        value: NDArray[np.float32],
        uncertainty: NDArray[np.float32],
        then: Then | None = None,
    ) -> NDArray[np.bool_]:
        """Write value and standard deviation (noise included) of cells; return the written tiles.

        Cells that have changed since the last call are written, or with `whole` all cells. At the end, `then`
        is called with columns, rows and a mask of written cells (None: all); calls do not overlap.
        """
        kernel = self.kernel
        limits = (0.0, 1.0) if clip else (-math.inf, math.inf)
        prior = mean, kernel.amplitude, kernel.noise
        if whole:
            value[:] = min(max(mean, limits[0]), limits[1])
            uncertainty[:] = math.sqrt(kernel.amplitude + kernel.noise)
        wanted = self._touched if whole else self._unwritten
        tiles, boxes = np.argwhere(wanted), list(self._boxes(wanted))
        self._unwritten[:] = False
        posterior = self.posterior

        def work(part: Sequence[Box]) -> None:
            weights = self.x.weights, self.y.weights
            for box in part:
                write_from_nodes(posterior[0], *weights, box, prior, limits, value, uncertainty)

        def work_of_cells(numbers: Sequence[int]) -> None:
            part = cells[numbers[0] : numbers[-1] + 1]
            write_cells(posterior, part, prior, limits, value, uncertainty)

        if self._single:
            i, j = tiles.T
            ends = [self.x.edges[i], self.x.edges[i + 1], self.y.edges[j], self.y.edges[j + 1]]
            cells = np.column_stack([self._slots[i, j], *ends])
            in_parallel(work_of_cells, range(len(cells)))
        else:
            in_parallel(work, boxes)
        if then is not None:

            def finish(parts: Sequence[Strip]) -> None:
                for part in parts:
                    then(*part)

            starts = range(0, self.shape[0], _STRIP_COLUMNS)
            all_cells: list[Strip] = [(slice(x, x + _STRIP_COLUMNS), slice(None), None) for x in starts]
            in_parallel(finish, all_cells if whole else list(_apart(boxes)))
        if whole:
            return np.ones(tile_shape(self.shape), np.bool_)
        return tiles_of_boxes(self.shape, *np.array(boxes, np.int64).reshape(-1, 4).T)

    def _boxes(self, tiles: NDArray[np.bool_]) -> Iterator[Box]:
        """Yield boxes of cells that depend on nodes of the masked tiles."""
        for i in np.flatnonzero(tiles.any(axis=1)).tolist():
            x0, x1 = self.x.span(i, i)
            # `ends` has the start and end of each run of neighbouring tiles.
            ends = np.flatnonzero(np.diff(tiles[i].astype(np.int8), prepend=0, append=0))
            for first, end in ends.reshape(-1, 2).tolist():
                y0, y1 = self.y.span(first, end - 1)
                for start in range(x0, x1, _COLUMNS_AT_ONCE):
                    yield start, min(start + _COLUMNS_AT_ONCE, x1), y0, y1


def _apart(boxes: Sequence[Box]) -> Iterator[Strip]:
    """Yield the cells of boxes, which may overlap, as strips that do not overlap."""
    strips: dict[int, list[Box]] = {}
    for box in boxes:
        for strip in range(box[0] // _STRIP_COLUMNS, -(-box[1] // _STRIP_COLUMNS)):
            strips.setdefault(strip, []).append(box)
    for strip, inside in strips.items():
        x0, x1 = strip * _STRIP_COLUMNS, min((strip + 1) * _STRIP_COLUMNS, max(box[1] for box in inside))
        y0, y1 = min(box[2] for box in inside), max(box[3] for box in inside)
        written = np.zeros((x1 - x0, y1 - y0), np.bool_)
        for box in inside:
            written[max(box[0] - x0, 0) : max(box[1] - x0, 0), box[2] - y0 : box[3] - y0] = True
        yield slice(x0, x1), slice(y0, y1), written
