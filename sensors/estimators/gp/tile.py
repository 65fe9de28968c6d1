"""Compiled code that solves a tile of the local Gaussian process from observations around the tile.

With few observations, the observations' covariance is factored. With more observed cells than functions, the
process is approximated by sine functions on a box around the tile (Solin & Särkkä 2020, "Hilbert space
methods for reduced-rank Gaussian process regression"), and the precision of the functions' weights is
factored. Let L be the factor in either case, and c a node's covariance with the observations, or the
functions' values at the node. Products of ``L^-1 c`` with the solved data give the mean, and the square of
``L^-1 c`` the variance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra_kernels import add_product, factor_of, substitute_forward

Floats = NDArray[np.floating]
Places = NDArray[np.int64]

_PANEL = 128  # Of 64 to 256 nodes at a time, the fastest that fit the cache


@compiled(nogil=True)
def frame_of(tile: Places, geometry: Any) -> Any:
    """Return a tile's ranges of nodes, its box of cells with observations, and the spans of its functions.

    `geometry` has the first node of each column of tiles and the end of the last one, int64[columns + 1]; the
    same for the rows; the position of the first node along x and y and the spacing of the nodes along x and
    y, in cells; width and height of the farm; the greatest distance along x and y, in cells, from a tile to
    an observation that is used for it; and the lengths of the spans along x and y, centred on the tile.
    """
    edges_x, edges_y, (first_x, first_y, step_x, step_y), shape, reach, sides = geometry
    i0, i1, j0, j1 = edges_x[tile[0]], edges_x[tile[0] + 1], edges_y[tile[1]], edges_y[tile[1] + 1]
    box = (
        max(0, first_x + i0 * step_x - reach[0]),
        min(shape[0], first_x + (i1 - 1) * step_x + reach[0] + 1),
        max(0, first_y + j0 * step_y - reach[1]),
        min(shape[1], first_y + (j1 - 1) * step_y + reach[1] + 1),
    )
    x, y = first_x + 0.5 * (i0 + i1 - 1) * step_x, first_y + 0.5 * (j0 + j1 - 1) * step_y
    spans = (x - 0.5 * sides[0], x + 0.5 * sides[0]), (y - 0.5 * sides[1], y + 0.5 * sides[1])
    return (i0, i1, j0, j1), box, *spans


@compiled(nogil=True)
def gather(cells: Places, sums: Floats, height: int, box: Any) -> Floats:
    """Return x, y, weight, mean and newness of the observed cells in a box, float64[n, 5], by x, then y."""
    x0, x1, y0, y1 = box
    spans = np.empty((x1 - x0, 2), np.int64)
    count = 0
    for x in range(x0, x1):
        first = np.searchsorted(cells, x * height + y0)
        spans[x - x0, 0] = spans[x - x0, 1] = first
        while spans[x - x0, 1] < len(cells) and cells[spans[x - x0, 1]] < x * height + y1:
            spans[x - x0, 1] += 1
        count += spans[x - x0, 1] - first
    out = np.empty((count, 5))
    count = 0
    for x in range(x0, x1):
        for row in range(spans[x - x0, 0], spans[x - x0, 1]):
            out[count, 0], out[count, 1] = x, cells[row] - x * height
            out[count, 2], out[count, 3] = sums[row, 0], sums[row, 1] / sums[row, 0]
            out[count, 4] = sums[row, 2]
            count += 1
    return out


@compiled(nogil=True)
def fill_nodes(
    factor: Floats,
    weights: Floats,
    along_x: Floats,
    along_y: Floats,
    terms: Places,
    posterior: NDArray[np.float32],
) -> None:
    """Write the posterior at the nodes of a tile.

    Parameters
    ----------
    factor : float64[n, n]
        Lower triangular factor L.
    weights : float64[n, 2]
        Solved data: first for the observed values, then as if all observed values were 1.
    along_x, along_y : float64[k, w], float64[l, h]
        Factors along each axis whose products are the right-hand sides.
    terms : int64[n, 2]
        For each row of the right-hand side, the indices of the rows of `along_x` and `along_y` to multiply.
    posterior : float32[3, w, h]
        Posterior mean under a prior mean of zero, this mean if all observed values were 1, and sum of the
        squared rows. Changed in place.
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
        substitute_forward(factor, rows, columns, False)
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
                posterior[part, p, q] = sums[part, t]


@compiled(nogil=True)
def _fill_means(
    factor: Floats,
    weights: Floats,
    along_x: Floats,
    along_y: Floats,
    terms: Places,
    posterior: NDArray[np.float32],
) -> None:
    """Write the two means at the nodes of a tile; the parameters are as in `fill_nodes`."""
    n, width, height = len(factor), along_x.shape[1], along_y.shape[1]
    solved = weights.copy()  # Overwritten by the solution of L^T x = weights
    for i in range(n - 1, -1, -1):
        for part in range(2):
            solved[i, part] /= factor[i, i]
            for j in range(i):
                solved[j, part] -= factor[i, j] * solved[i, part]
    for part in range(2):
        means = np.zeros((width, height))
        for i in range(n):
            b = along_y[terms[i, 1]]
            for p in range(width):
                scale = solved[i, part] * along_x[terms[i, 0], p]
                for q in range(height):
                    means[p, q] += scale * b[q]
        for p in range(width):
            for q in range(height):
                posterior[part, p, q] = means[p, q]


@compiled(nogil=True)
def _bounds_of(seen: Floats, newer_than: float) -> Any:
    """Return the bounds along x and y of the observations that are newer; they are infinite if none is."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for p in range(len(seen)):
        if seen[p, 4] > newer_than:
            low_x, high_x = min(low_x, seen[p, 0]), max(high_x, seen[p, 0])
            low_y, high_y = min(low_y, seen[p, 1]), max(high_y, seen[p, 1])
    return low_x, high_x, low_y, high_y


@compiled(nogil=True)
def _changed_by(bounds: Any, nodes: Any, lattice: Any, touch: Any) -> Any:
    """Return the part of a range of nodes (i0, i1, j0, j1) that observations change; it may be empty."""
    first_x, first_y, step_x, step_y = lattice
    low_x, high_x, low_y, high_y = bounds
    i0, i1, j0, j1 = nodes
    if low_x > high_x:
        return i0, i0, j0, j0
    return (
        max(i0, -int((first_x - low_x + touch[0]) // step_x)),
        min(i1, int((high_x + touch[0] - first_x) // step_x) + 1),
        max(j0, -int((first_y - low_y + touch[1]) // step_y)),
        min(j1, int((high_y + touch[1] - first_y) // step_y) + 1),
    )


@compiled(nogil=True)
def _bells(places: Floats, axis: int, nodes: Floats, length: float, amplitude: float) -> Floats:
    """Return the kernel's factor along one axis between places and nodes, float64[places, nodes]."""
    out = np.empty((len(places), len(nodes)))
    scale = -0.5 / (length * length)
    for i in range(len(places)):
        for p in range(len(nodes)):
            d = nodes[p] - places[i, axis]
            out[i, p] = amplitude * np.exp(scale * d * d)
    return out


@compiled(nogil=True)
def _covariance(seen: Floats, kernel: Any) -> Floats:
    """Return the covariance of the observations, float64[n, n]."""
    length_x, length_y, noise, amplitude = kernel
    covariance = np.empty((len(seen), len(seen)))
    scale_x, scale_y = -0.5 / length_x**2, -0.5 / length_y**2
    for i in range(len(seen)):
        for j in range(i + 1):
            dx, dy = seen[i, 0] - seen[j, 0], seen[i, 1] - seen[j, 1]
            covariance[i, j] = amplitude * np.exp(scale_x * dx * dx + scale_y * dy * dy)
            covariance[j, i] = covariance[i, j]
        covariance[i, i] += noise / seen[i, 2]
    return covariance


@compiled(nogil=True)
def sines(places: Floats, low: float, high: float, roots: Floats) -> Floats:
    """Return orthonormal sines on low..high, times `roots`, at `places`: float64[functions, places]."""
    out = np.empty((len(roots), len(places)))
    scale = np.sqrt(2.0 / (high - low))
    for i in range(len(roots)):
        frequency = np.pi * (i + 1) / (high - low)
        for p in range(len(places)):
            out[i, p] = roots[i] * scale * np.sin(frequency * (places[p] - low))
    return out


@compiled(nogil=True)
def _cosines(places: Floats, low: float, high: float, count: int) -> Floats:
    """Return cosines with 0, 1, ... half-waves between low and high, at `places`: float64[count, places]."""
    out = np.empty((count, len(places)))
    for k in range(count):
        for p in range(len(places)):
            out[k, p] = np.cos(np.pi * k / (high - low) * (places[p] - low))
    return out


@compiled(nogil=True)
def precision_of(
    seen: Floats, noise: float, spectrum: Any, terms: Places, span_x: Any, span_y: Any, weights: Floats
) -> NDArray[np.float64]:
    """Return the precision of the m sine functions' weights, float64[m, m]; add the data to `weights`.

    Only the upper triangle is set. A product of two sines is half the difference of two cosines, so that sums
    of products of cosines over the observations give all m^2 sums of products of functions.
    """
    m, along_x, along_y = len(terms), len(spectrum[0]), len(spectrum[1])
    low_x, high_x, low_y, high_y = _bounds_of(seen, -np.inf)
    rows, columns = np.arange(low_y, high_y + 1.0), np.arange(low_x, high_x + 1.0)
    cosines_y = np.ascontiguousarray(_cosines(rows, span_y[0], span_y[1], 2 * along_y + 1).T)
    sines_y = np.ascontiguousarray(sines(rows, span_y[0], span_y[1], spectrum[1]).T)
    # The observations of one x are added first. Loops compile in a third of the time of numpy's expressions.
    by_column = np.zeros((len(columns), 2 * along_y + 1))
    data = np.zeros((2, len(columns), along_y))
    for p in range(len(seen)):
        column, row = int(seen[p, 0] - low_x), int(seen[p, 1] - low_y)
        weight = seen[p, 2] / noise
        for k in range(2 * along_y + 1):
            by_column[column, k] += weight * cosines_y[row, k]
        for k in range(along_y):
            data[0, column, k] += weight * seen[p, 3] * sines_y[row, k]
            data[1, column, k] += weight * sines_y[row, k]
    sums = np.zeros((2 * along_x + 1, 2 * along_y + 1))
    cosines_x = _cosines(columns, span_x[0], span_x[1], 2 * along_x + 1)
    add_product(1.0, cosines_x, by_column, sums, 0, len(sums), 0, len(columns), 0, 2 * along_y + 1)
    sines_x = sines(columns, span_x[0], span_x[1], spectrum[0])
    for part in range(2):
        totals = np.zeros((along_x, along_y))
        add_product(1.0, sines_x, data[part], totals, 0, along_x, 0, len(columns), 0, along_y)
        for i in range(m):
            weights[i, part] += totals[terms[i, 0], terms[i, 1]]
    scale = 1.0 / np.sqrt((span_x[1] - span_x[0]) * (span_y[1] - span_y[0]))
    precision = np.zeros((m, m))
    for i in range(m):
        x, y = terms[i, 0], terms[i, 1]
        size = scale * spectrum[0][x] * spectrum[1][y]
        for j in range(i, m):
            other_x, other_y = terms[j, 0], terms[j, 1]
            lower, upper = sums[abs(x - other_x)], sums[x + other_x + 2]
            left, right = abs(y - other_y), y + other_y + 2
            total = (lower[left] - lower[right]) - (upper[left] - upper[right])
            precision[i, j] = size * scale * spectrum[0][other_x] * spectrum[1][other_y] * total
        precision[i, i] += 1.0
    return precision


@compiled(nogil=True)
def solve_tiles(
    tiles: Places,
    places: Places,
    geometry: Any,
    cells: Places,
    sums: Floats,
    touch: Any,
    kernel: Any,
    spectrum: Any,
    terms: Places,
    posterior: NDArray[np.float32],
) -> None:
    """Compute the posterior at the nodes of some tiles of the lattice.

    Parameters
    ----------
    tiles : int64[n, 2]
        Column and row of each tile.
    places : int64[n, 3]
        Slot of each tile in `posterior`, and the first node of the slot along x and y.
    geometry
        As in `frame_of`.
    cells : int64[n]
        Observed cells, x * H + y in ascending order.
    sums : float64[n, 3]
        Total weight and weighted sum of the values of each observed cell, and a positive number if the cell
        was observed after its tiles were last solved. Only near such cells are variances computed.
    touch : tuple of two ints
        Greatest distance along each axis at which an observation changes the variance at a node, in cells.
    kernel : tuple of four floats
        The two lengthscales (cells), the variance of the noise and the variance of the latent function.
    spectrum : tuple of float64[k], float64[l]
        Square roots of the variances of the sine functions along each axis.
    terms : int64[m, 2]
        Pairs of indices of sine functions to multiply, used if there are more observed cells than functions.
    posterior : float32[slots, 3, w, h]
        Result as in `fill_nodes`, but the third part is the reduction of the variance. Changed in place.
    """
    lattice, (_, height) = geometry[2:4]
    first_x, first_y, step_x, step_y = lattice
    for k in range(len(tiles)):
        nodes, box, span_x, span_y = frame_of(tiles[k], geometry)
        seen = gather(cells, sums, height, box)
        n, m = len(seen), len(terms)
        if n == 0:
            continue
        # Nodes that no observation reaches keep the prior.
        i0, i1, j0, j1 = nodes = _changed_by(_bounds_of(seen, -np.inf), nodes, lattice, touch)
        if i0 >= i1 or j0 >= j1:
            continue
        node_x, node_y = np.empty(i1 - i0), np.empty(j1 - j0)
        for p in range(len(node_x)):
            node_x[p] = first_x + step_x * float(i0 + p)
        for p in range(len(node_y)):
            node_y[p] = first_y + step_y * float(j0 + p)
        if n <= m:
            weights, products = np.empty((n, 2)), np.empty((n, 2), np.int64)
            for p in range(n):
                weights[p, 0], weights[p, 1] = seen[p, 3], 1.0
                products[p, 0] = products[p, 1] = p
            matrix = _covariance(seen, kernel)
            along_x = _bells(seen, 0, node_x, kernel[0], kernel[3])
            along_y = _bells(seen, 1, node_y, kernel[1], 1.0)
        else:
            weights, products = np.zeros((m, 2)), terms
            matrix = precision_of(seen, kernel[2], spectrum, terms, span_x, span_y, weights)
            along_x = sines(node_x, span_x[0], span_x[1], spectrum[0])
            along_y = sines(node_y, span_y[0], span_y[1], spectrum[1])
        factor = factor_of(matrix)
        if not factor[0, 0] > 0.0:
            raise np.linalg.LinAlgError("the covariance of the observations is singular")
        substitute_forward(factor, weights, 2, False)
        slot, a, b = places[k]
        near = _changed_by(_bounds_of(seen, 0.0), nodes, lattice, touch)
        if near != nodes:
            # New observations change means farther away than variances.
            part = posterior[slot, :, i0 - a : i1 - a, j0 - b : j1 - b]
            _fill_means(factor, weights, along_x, along_y, products, part)
        i, end_i, j, end_j = near
        if i >= end_i or j >= end_j:
            continue
        along_x, along_y = along_x[:, i - i0 : end_i - i0].copy(), along_y[:, j - j0 : end_j - j0].copy()
        part = posterior[slot, :, i - a : end_i - a, j - b : end_j - b]
        fill_nodes(factor, weights, along_x, along_y, products, part)
        if n > m:
            for p in range(end_i - i):
                for q in range(end_j - j):
                    part[2, p, q] = kernel[3] - part[2, p, q]
