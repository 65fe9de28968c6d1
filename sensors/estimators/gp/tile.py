"""Tiles of the local Gaussian process, each solved from the observations around it.

There are two ways to the same posterior. With few observations, their covariance is factored. With more of
them than the field has degrees of freedom there, the process is written in sine functions on a box around the
tile (Solin & Särkkä 2020, "Hilbert space methods for reduced-rank Gaussian process regression"), and the
precision of their weights is factored. In both, with factor L, rows ``L^-1 c`` of each node's covariance c
with the observations (or its functions) give the mean by their products with the solved data, and the
variance by their squares.

Compiled are loops only, each in as few forms of arrays as can be: linear algebra and whole arrays within
compiled functions take ten seconds to compile, and no less time to run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.estimators.gp.threads import factor_in_place, outer_product

if TYPE_CHECKING:
    from sensors.estimators.gp.lattice import LatticeAxis
    from sensors.estimators.gp.rbf import RbfKernel

Floats = NDArray[np.floating]
Places = NDArray[np.int64]

_PANEL = 64
_BATCH = 256


@compiled(nogil=True)
def add_to_cells(
    index: NDArray[np.int32],
    cells: NDArray[np.int32],
    sums: Floats,
    used: int,
    x: NDArray[np.int32],
    y: NDArray[np.int32],
    values: Floats,
    weights: Floats,
) -> int:
    """Add observations to the sums of their cells; return how many observed cells there are now.

    Parameters
    ----------
    index : int32[W, H]
        One more than the row of each cell in `sums`; 0 where nothing was observed. Changed.
    cells, sums : int32[n, 2], float64[n, 2]
        Place, weight and sum of the weighted values, with room for the cells that are new. Changed.
    used : int
        Number of observed cells so far.
    x, y, values
        The observations.
    weights : float64[k]
        The part of an observation that each counts for; negative takes one away again.
    """
    for k in range(len(x)):
        row = index[x[k], y[k]] - 1
        if row < 0:
            row = used
            used += 1
            index[x[k], y[k]] = used
            cells[row, 0], cells[row, 1] = x[k], y[k]
            sums[row, :] = 0.0
        sums[row, 0] += weights[k]
        sums[row, 1] += weights[k] * values[k]
    return used


@compiled(nogil=True)
def gather(index: NDArray[np.int32], sums: Floats, x0: int, x1: int, y0: int, y1: int) -> Floats:
    """Return x, y, weight and mean value of the observed cells in a box, float64[4, n]."""
    found = 0
    for x in range(x0, x1):
        for y in range(y0, y1):
            found += index[x, y] > 0
    out = np.empty((4, found))
    found = 0
    for x in range(x0, x1):
        for y in range(y0, y1):
            row = index[x, y] - 1
            if row >= 0:
                out[0, found], out[1, found] = x, y
                out[2, found], out[3, found] = sums[row, 0], sums[row, 1] / sums[row, 0]
                found += 1
    return out


@compiled(nogil=True, fastmath=True)
def _subtract_products(rows: Floats, weights: Floats, i: int, columns: int) -> None:
    """Subtract ``weights[j] * rows[j]`` for all j < i from ``rows[i]``."""
    target = rows[i]
    j = 0
    while j + 4 <= i:
        a, b, c, d = weights[j], weights[j + 1], weights[j + 2], weights[j + 3]
        for p in range(columns):
            target[p] -= a * rows[j, p] + b * rows[j + 1, p] + c * rows[j + 2, p] + d * rows[j + 3, p]
        j += 4
    while j < i:
        a = weights[j]
        for p in range(columns):
            target[p] -= a * rows[j, p]
        j += 1


@compiled(nogil=True)
def substitute_forward(factor: Floats, right: Floats, columns: int) -> None:
    """Solve ``factor x = right`` for the first `columns` columns, in place."""
    for i in range(len(factor)):
        _subtract_products(right, factor[i], i, columns)
        inverse = 1.0 / factor[i, i]
        for p in range(columns):
            right[i, p] *= inverse


@compiled(nogil=True)
def fill_nodes(
    factor: Floats,
    weights: Floats,
    along_x: Floats,
    along_y: Floats,
    terms: Places,
    at_x: int,
    at_y: int,
    posterior: NDArray[np.float32],
) -> None:
    """Write the posterior at nodes next to each other.

    Parameters
    ----------
    factor : float64[n, n]
        Lower triangular.
    weights : float64[n, 2]
        The solved data: values, and a constant of one.
    along_x, along_y : float64[k, w], float64[l, h]
        Factors of the nodes' right-hand sides.
    terms : int64[n, 2]
        Row i of the right-hand side is the product of these rows of `along_x` and `along_y`.
    at_x, at_y : int
        The first of the nodes.
    posterior : float32[3, nodes along x, nodes along y]
        The posterior mean under a zero prior mean, the same for observations that are all one, and the sum of
        the squared rows. Changed at w times h nodes.
    """
    n = len(factor)
    width, height = along_x.shape[1], along_y.shape[1]
    rows = np.empty((n, _PANEL))
    sums = np.empty((3, _PANEL))
    for start in range(0, width * height, _PANEL):
        columns = min(_PANEL, width * height - start)
        for i in range(n):
            a, b = along_x[terms[i, 0]], along_y[terms[i, 1]]
            p, q = divmod(start, height)
            for t in range(columns):
                rows[i, t] = a[p] * b[q]
                q += 1
                if q == height:
                    p, q = p + 1, 0
        substitute_forward(factor, rows, columns)
        sums[:] = 0.0
        for i in range(n):
            for t in range(columns):
                known = rows[i, t]
                sums[0, t] += weights[i, 0] * known
                sums[1, t] += weights[i, 1] * known
                sums[2, t] += known * known
        for t in range(columns):
            p, q = divmod(start + t, height)
            for part in range(3):
                posterior[part, at_x + p, at_y + q] = sums[part, t]


@compiled(nogil=True)
def _bells(places: Floats, nodes: Floats, length: float) -> Floats:
    """Return the factors of the covariance along one axis, float64[places, nodes]."""
    out = np.empty((len(places), len(nodes)))
    scale = -0.5 / (length * length)
    for i in range(len(places)):
        for p in range(len(nodes)):
            d = nodes[p] - places[i]
            out[i, p] = np.exp(scale * d * d)
    return out


@compiled(nogil=True)
def _covariance(seen: Floats, length_x: float, length_y: float, noise: float, amplitude: float) -> Floats:
    """Return the covariance of observations of cells, each of them `gather`'s, float64[n, n]."""
    n = seen.shape[1]
    scale_x, scale_y = -0.5 / length_x**2, -0.5 / length_y**2
    covariance = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            dx, dy = seen[0, i] - seen[0, j], seen[1, i] - seen[1, j]
            covariance[i, j] = amplitude * np.exp(scale_x * dx * dx + scale_y * dy * dy)
            covariance[j, i] = covariance[i, j]
        covariance[i, i] += noise / seen[2, i]
    return covariance


@compiled(nogil=True)
def sines(places: Floats, low: float, high: float, roots: Floats) -> Floats:
    """Return sine functions of the box low .. high, times the roots of their variances, [k, places]."""
    out = np.empty((len(roots), len(places)))
    scale = np.sqrt(2.0 / (high - low))
    for i in range(len(roots)):
        frequency = np.pi * (i + 1) / (high - low)
        for p in range(len(places)):
            out[i, p] = roots[i] * scale * np.sin(frequency * (places[p] - low))
    return out


@compiled(nogil=True)
def _fill_batch(
    roots: Floats,
    values: Floats,
    along_x: Floats,
    along_y: Floats,
    terms: Places,
    batch: Floats,
    weights: Floats,
) -> None:
    """Write the functions at observations, times the roots of their precisions, and add to the data."""
    batch[:] = 0.0
    for p in range(len(roots)):
        root = roots[p]
        for i in range(len(terms)):
            batch[i, p] = root * along_x[terms[i, 0], p] * along_y[terms[i, 1], p]
            weights[i, 0] += batch[i, p] * root * values[p]
            weights[i, 1] += batch[i, p] * root


@dataclass(frozen=True, slots=True, eq=False)
class TileSolver:
    """Solves tiles of nodes.

    Parameters
    ----------
    kernel : RbfKernel
        The covariance.
    x, y : LatticeAxis
        The nodes, and the tiles that they are in.
    reach : tuple of two ints
        How far along each axis observations count for a tile, cells.
    touch : tuple of two ints
        How far along each axis an observation can move a node at all, cells.
    roots, sides, terms
        Of sine functions on a box with the tile in its middle (`sensors.estimators.gp.local.Spectrum`); they
        are used where there are more observed cells than functions.
    posterior : float32[3, nodes along x, nodes along y]
        See `fill_nodes`; the third part is the reduction of the variance. Changed.
    """

    kernel: RbfKernel
    x: LatticeAxis
    y: LatticeAxis
    reach: tuple[int, ...]
    touch: tuple[int, ...]
    roots: tuple[Floats, Floats]
    sides: tuple[float, float]
    terms: Places
    posterior: NDArray[np.float32]

    def solve(self, column: int, row: int, index: NDArray[np.int32], sums: Floats) -> None:
        """Solve a tile from the observations, which are `add_to_cells`'s."""
        axes = (self.x, column), (self.y, row)
        ends = [(int(axis.edges[tile]), int(axis.edges[tile + 1])) for axis, tile in axes]
        box = [
            limit
            for (axis, _), (first, end), reach in zip(axes, ends, self.reach, strict=True)
            for limit in (
                max(0, axis.first + first * axis.step - reach),
                min(axis.cells, axis.first + (end - 1) * axis.step + reach + 1),
            )
        ]
        seen = gather(index, sums, box[0], box[1], box[2], box[3])
        if not seen.shape[1]:
            return
        nodes: list[Floats] = []
        starts: list[int] = []
        for (axis, _), (first, end), places, touch in zip(axes, ends, seen[:2], self.touch, strict=True):
            # Nodes that no observation reaches keep the prior.
            low = max(first, -int((axis.first - places.min() + touch) // axis.step))
            high = min(end, int((places.max() + touch - axis.first) // axis.step) + 1)
            if low >= high:
                return
            nodes.append(axis.first + axis.step * np.arange(low, high).astype(np.float64))
            starts.append(low)
        at = starts[0], starts[1]
        if seen.shape[1] <= len(self.terms):
            self._solve_few(seen, nodes, at)
            return
        spans = [
            _centred(axis.first + 0.5 * (first + end - 1) * axis.step, side)
            for (axis, _), (first, end), side in zip(axes, ends, self.sides, strict=True)
        ]
        self._solve_many(seen, spans, nodes, at)

    def _solve_few(self, seen: Floats, nodes: list[Floats], at: tuple[int, int]) -> None:
        """Solve a tile by the covariance of the observations."""
        kernel = self.kernel
        lengths = kernel.length_x, kernel.length_y
        factor = factor_in_place(_covariance(seen, *lengths, kernel.noise, kernel.amplitude))
        weights = np.ones((len(factor), 2))
        weights[:, 0] = seen[3]
        substitute_forward(factor, weights, 2)
        along_x, along_y = (_bells(*of_axis) for of_axis in zip(seen[:2], nodes, lengths, strict=True))
        each = np.arange(len(factor))
        terms = np.stack([each, each], axis=1)
        fill_nodes(factor, weights, kernel.amplitude * along_x, along_y, terms, *at, self.posterior)

    def _solve_many(
        self, seen: Floats, spans: list[tuple[float, float]], nodes: list[Floats], at: tuple[int, int]
    ) -> None:
        """Solve a tile by the weights of sine functions."""
        terms, m = self.terms, len(self.terms)
        roots = np.sqrt(seen[2] / self.kernel.noise)
        precision, weights, batch = np.eye(m), np.zeros((m, 2)), np.empty((m, _BATCH))
        for start in range(0, seen.shape[1], _BATCH):
            part = slice(start, start + _BATCH)
            along_x, along_y = self._sines([seen[0, part], seen[1, part]], spans)
            _fill_batch(roots[part], seen[3, part], along_x, along_y, terms, batch, weights)
            precision += outer_product(batch)
        factor = factor_in_place(precision)
        substitute_forward(factor, weights, 2)
        along_x, along_y = self._sines(nodes, spans)
        fill_nodes(factor, weights, along_x, along_y, terms, *at, self.posterior)
        (i, j), (width, height) = at, map(len, nodes)
        reduced = self.posterior[2, i : i + width, j : j + height]
        reduced[:] = self.kernel.amplitude - reduced.astype(np.float64)

    def _sines(self, places: list[Floats], spans: list[tuple[float, float]]) -> list[Floats]:
        each = zip(places, spans, self.roots, strict=True)
        return [sines(where, low, high, roots) for where, (low, high), roots in each]


def _centred(middle: float, side: float) -> tuple[float, float]:
    return middle - 0.5 * side, middle + 0.5 * side
