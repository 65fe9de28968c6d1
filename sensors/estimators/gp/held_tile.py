"""A tile of the local Gaussian process that takes further observations without being solved again.

The tile's sine functions (`sensors.estimators.gp.tile`) have weights, whose means and covariance are held. By
Woodbury's identity, k further observations change the covariance by a product of matrices with k columns, so
that the cost grows with k. To solve the tile again costs the same for one observation as for hundreds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import cholesky, inverse_of_factor, product, solve_lower
from sensors.estimators.gp.lattice import NodeLattice
from sensors.estimators.gp.tile import Floats, Places, precision_of, sines

_MOST_ADDED = 256  # More observations than this cost about as much as a new solution


class HeldTile:
    """Means and covariance of the functions' weights of a tile, given the observations around it.

    `seen` has the observed cells, from `gather`; `frame` is from `frame_of`, and `place` from
    `NodeLattice.places_of`. `noise` and `functions`, spectrum and terms, are as in `solve_tiles`.
    """

    def __init__(
        self, seen: Floats, frame: Any, place: Places, lattice: NodeLattice, noise: float, functions: Any
    ) -> None:
        spectrum, terms = functions
        (i0, i1, j0, j1), self._box, *self._spans = frame
        slot, a, b = place
        self._place = slot, slice(None), slice(i0 - a, i1 - a), slice(j0 - b, j1 - b)
        self._roots, self._terms, self._noise = spectrum, terms, noise
        self._at_nodes = self._sines(lattice.x.places[i0:i1], 0), self._sines(lattice.y.places[j0:j1], 1)
        response = np.zeros((len(terms), 2))
        precision = precision_of(seen, noise, spectrum, terms, self._spans[0], self._spans[1], response)
        covariance = inverse_of_factor(cholesky(precision))
        self._means = product(covariance, response)
        self._covariance = covariance.astype(np.float32)

    def _sines(self, places: Floats, axis: int) -> Floats:
        low, high = self._spans[axis]
        return sines(np.ascontiguousarray(places), low, high, self._roots[axis])

    def add(self, seen: Floats, sign: float, posterior: NDArray[np.float32]) -> bool:
        """Add observations to the tile and to the posterior of the lattice; return False on failure.

        Each row of `seen` has x, y, weight and value. A `sign` of -1 removes observations that were added.
        """
        x0, x1, y0, y1 = self._box
        x, y, weights, values = near = seen[
            (x0 <= seen[:, 0]) & (seen[:, 0] < x1) & (y0 <= seen[:, 1]) & (seen[:, 1] < y1)
        ].T
        if near.shape[1] > _MOST_ADDED:
            return False
        of_x, of_y = self._terms.T
        functions = self._sines(x, 0)[of_x] * self._sines(y, 1)[of_y]
        products = product(self._covariance, functions.astype(np.float32)).T.astype(np.float64)
        variance = sign * product(products, functions) + np.diag(self._noise / weights)
        surprise = np.stack([values, np.ones_like(values)], axis=1) - product(functions.T, self._means)
        try:
            factor = cholesky(variance)
        except np.linalg.LinAlgError:
            return False
        rows = solve_lower(factor, np.ascontiguousarray(products))
        surprise = sign * solve_lower(factor, surprise)
        gains = rows.astype(np.float32)
        self._covariance -= np.float32(sign) * product(gains.T, gains)
        self._means += product(rows.T, surprise)
        # The functions are products, so that the sum over all of them is a sum along y, then along x.
        by_axes = np.zeros((len(rows), len(self._roots[0]), len(self._roots[1])))
        by_axes[:, of_x, of_y] = rows
        along_y = product(by_axes, self._at_nodes[1])
        known = product(along_y.transpose(0, 2, 1), self._at_nodes[0]).transpose(0, 2, 1)
        part = posterior[self._place]
        part[:2] += product(surprise.T, known.reshape(len(rows), -1)).reshape(part[:2].shape)
        part[2] += sign * np.square(known).sum(axis=0)
        return True
