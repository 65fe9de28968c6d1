"""The compiled part of the local Gaussian process that writes the farm's cells from the nodes.

Between nodes, mean and variance are interpolated by polynomials of degree five through six nodes along each
axis. With nodes a quarter of a length scale apart, what that loses of a field with unit variance is 2e-5 of
the mean and 1e-4 of the variance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

POINTS = 6
MARGIN = POINTS // 2

Values = NDArray[np.float32]


def lagrange_weights(step: int) -> Values:
    """Return the weights of the six nodes around each of the cells between the middle two.

    Parameters
    ----------
    step : int
        Distance of the nodes, cells.

    Returns
    -------
    float32[6, step]
        Weights of the nodes two before the cell's own to three after it.

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


@compiled(nogil=True, fastmath=True)
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
    """Write value and uncertainty in a box of cells, interpolated between nodes.

    Parameters
    ----------
    posterior : float32[3, w, h]
        At the nodes, of which the third along each axis is at cell 0: response to the values and to a
        constant, and reduction of the variance.
    weights_x, weights_y : float32[6, step]
        See `lagrange_weights`.
    box : tuple of four ints
        First and last-plus-one cell along x, and along y.
    prior : tuple of three floats
        Mean, variance of the smooth part, variance of the noise.
    limits : tuple of two floats
        Where the value is cut off.
    value, uncertainty : float32[W, H]
        Changed in the box.
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
            a = between[:, j - j0 : j - j0 + POINTS]
            for y in range(first, last):
                t = y - j * step_y
                shift, known = zero, zero
                for k in range(POINTS):
                    shift += weights_y[k, t] * a[0, k]
                    known += weights_y[k, t] * a[1, k]
                value[x, y] = min(high, max(low, mean + shift))
                uncertainty[x, y] = np.sqrt(max(zero, amplitude - known) + noise)


@compiled(nogil=True)
def write_cells(
    posterior: Values, box: Any, prior: Any, limits: Any, value: Values, uncertainty: Values
) -> None:
    """Write value and uncertainty in a box of cells that are nodes themselves; see `write_from_nodes`."""
    x0, x1, y0, y1 = box
    mean, amplitude, noise = np.float32(prior[0]), np.float32(prior[1]), np.float32(prior[2])
    low, high = np.float32(limits[0]), np.float32(limits[1])
    for x in range(x0, x1):
        for y in range(y0, y1):
            shifted = mean + posterior[0, x, y] - mean * posterior[1, x, y]
            value[x, y] = min(high, max(low, shifted))
            left = max(np.float32(0.0), amplitude - posterior[2, x, y])
            uncertainty[x, y] = np.sqrt(left + noise)
