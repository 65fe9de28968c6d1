"""A tile of the local Gaussian process that takes further observations without being solved again.

The tile's sine functions (`sensors.estimators.gp.tile`) have weights, whose means and covariance are held. By
Woodbury's identity, k further observations change the covariance by a product of matrices with k columns, so
that the cost grows with k. To solve the tile again costs the same for one observation as for hundreds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra_kernels import add_product, factor_of, inverse_of_factor, substitute_forward
from sensors.estimators.gp.lattice import NodeLattice
from sensors.estimators.gp.tile import Floats, Places, precision_of, sines

_MOST_ADDED = 256  # More observations than this cost about as much as a new solution
_ROWS = 48  # As many rows of the covariance as stay in the cache
_ONE = np.float32(1.0)


class HeldTile:
    """Means and covariance of the functions' weights of a tile, given the observations around it.

    `seen` has the observed cells, from `gather`; `frame` is from `frame_of`, and `place` from
    `NodeLattice.places_of`. `noise`, `spectrum` and `terms` are as in `solve_tiles`.
    """

    def __init__(
        self,
        seen: Floats,
        frame: Any,
        place: Places,
        lattice: NodeLattice,
        noise: float,
        spectrum: Any,
        terms: Places,
    ) -> None:
        (i0, i1, j0, j1), self._box, span_x, span_y = frame
        slot, a, b = place
        self._place = slot, slice(None), slice(i0 - a, i1 - a), slice(j0 - b, j1 - b)
        self._at_nodes = (
            sines(lattice.x.places[i0:i1], span_x[0], span_x[1], spectrum[0]),
            sines(lattice.y.places[j0:j1], span_y[0], span_y[1], spectrum[1]),
        )
        self._functions = noise, spectrum, terms, span_x, span_y
        self._weights = _weights_given(seen, self._functions)

    def add(self, seen: Floats, sign: float, posterior: NDArray[np.float32]) -> bool:
        """Add observations to the tile and to the posterior of the lattice; return False if this fails.

        Each row of `seen` has x, y, weight and value. A `sign` of -1 removes observations that were added.
        """
        x, y = seen[:, 0], seen[:, 1]
        x0, x1, y0, y1 = self._box
        near = seen[(x0 <= x) & (x < x1) & (y0 <= y) & (y < y1)]
        part = posterior[self._place]
        return len(near) <= _MOST_ADDED and bool(
            _add(near, sign, self._weights, self._functions, self._at_nodes, part)
        )


@compiled(nogil=True)
def _weights_given(seen: Floats, functions: Any) -> Any:
    """Return covariance, float32[m, m], and means, float64[m, 2], of the weights of m functions."""
    noise, spectrum, terms, span_x, span_y = functions
    m = len(terms)
    response, means = np.zeros((m, 2)), np.zeros((m, 2))
    precision = precision_of(seen, noise, spectrum, terms, span_x, span_y, response)
    covariance = inverse_of_factor(factor_of(precision))
    add_product(1.0, covariance, response, means, 0, m, 0, m, 0, 2)
    return covariance.astype(np.float32), means


@compiled(nogil=True)
def _add(
    seen: Floats, sign: float, weights: Any, functions: Any, at_nodes: Any, posterior: NDArray[np.float32]
) -> bool:
    covariance, means = weights
    noise, spectrum, terms, span_x, span_y = functions
    nodes_x, nodes_y = at_nodes
    k, m = len(seen), len(terms)
    sines_x = sines(seen[:, 0].copy(), span_x[0], span_x[1], spectrum[0])
    sines_y = sines(seen[:, 1].copy(), span_y[0], span_y[1], spectrum[1])
    at_seen = np.empty((k, m), np.float32)
    for i in range(m):
        for p in range(k):
            at_seen[p, i] = sines_x[terms[i, 0], p] * sines_y[terms[i, 1], p]
    products, expected = np.zeros((k, m), np.float32), np.zeros((k, k), np.float32)
    add_product(_ONE, at_seen, covariance, products, 0, k, 0, m, 0, m)
    add_product(_ONE, products, at_seen.T.copy(), expected, 0, k, 0, m, 0, k)
    surprise, variance = np.ones((k, 2)), sign * expected.astype(np.float64)
    for p in range(k):
        surprise[p, 0] = seen[p, 3]
        variance[p, p] += noise / seen[p, 2]
    add_product(-1.0, at_seen.astype(np.float64), means, surprise, 0, k, 0, m, 0, 2)
    factor = factor_of(variance)
    if not factor[0, 0] > 0.0:
        return False
    rows = products.astype(np.float64)
    substitute_forward(factor, rows, m)
    substitute_forward(factor, surprise, 2)
    columns, gains = rows.T.copy(), rows.astype(np.float32)
    turned = gains.T.copy()
    for i in range(0, m, _ROWS):
        add_product(np.float32(-sign), turned, gains, covariance, i, min(i + _ROWS, m), 0, k, 0, m)
    add_product(sign, columns, surprise, means, 0, m, 0, k, 0, 2)
    width, height = nodes_x.shape[1], nodes_y.shape[1]
    across = nodes_x.T.copy()
    for p in range(k):
        # The functions are products, so that the sum over all of them is a sum along y, then along x.
        along, known = np.zeros((len(nodes_x), height)), np.zeros((width, height))
        for i in range(m):
            for q in range(height):
                along[terms[i, 0], q] += rows[p, i] * nodes_y[terms[i, 1], q]
        add_product(1.0, across, along, known, 0, width, 0, len(along), 0, height)
        for i in range(width):
            for j in range(height):
                posterior[0, i, j] += sign * known[i, j] * surprise[p, 0]
                posterior[1, i, j] += sign * known[i, j] * surprise[p, 1]
                posterior[2, i, j] += sign * known[i, j] ** 2
    return True
