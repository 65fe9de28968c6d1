"""What a day does to the belief in a smooth field: the prediction step of a Kalman filter.

Rain falls on whole stretches of land. So what a field changes by between two days is itself a smooth field,
and readings of the earlier day are wrong together, not each for itself: a thousand of them tell no more of
today than the change of a day leaves of them all. Written in functions whose weights w are standard normal
before anything is seen, the weights of the later day are ``w' = r w + sqrt(1 - r^2) e``, with e standard
normal and independent of w, and r the correlation of the days (a first-order autoregressive process;
Hartikainen & Särkkä 2010, "Kalman filtering and smoothing solutions to temporal Gaussian process regression
models").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_LEAST_CHANGE = 1e-6
_ALIKE_LENGTHS = 0.25


def pass_day(precision: _Floats, response: _Floats, correlation: float | _Floats) -> tuple[_Floats, _Floats]:
    """Return the precision of the weights on a later day, and it times their mean.

    Parameters
    ----------
    precision : float64[m, m]
        Of the weights on the earlier day; the identity before anything was seen.
    response : float64[m, ...]
        The precision times their mean.
    correlation : float or float64[m]
        Of each weight on the earlier day with that on the later one, 0..1.

    Returns
    -------
    precision : float64[m, m]
    response : float64[m, ...]
    """
    kept = np.broadcast_to(np.asarray(correlation, np.float64), len(precision))
    change = np.maximum(1.0 - kept**2, _LEAST_CHANGE)
    # Both days' weights together have this precision on the earlier one's; these are integrated out.
    together = precision.copy()
    together[np.diag_indices_from(together)] += kept**2 / change
    ratio = kept / change
    solved = np.linalg.solve(together, np.column_stack([np.diag(ratio), response.reshape(len(kept), -1)]))
    later = -ratio[:, None] * solved[:, : len(kept)]
    later[np.diag_indices_from(later)] += 1.0 / change
    return 0.5 * (later + later.T), (ratio[:, None] * solved[:, len(kept) :]).reshape(response.shape)


class Crowding:
    """How many readings each stretch of a farm has, and what a further one there counts for.

    What a process with one length does not say of a field, as that soaked soil takes no more rain, is the
    same for readings near each other. So the k-th one of a day in a box a quarter of a length wide counts for
    1 / k.

    Parameters
    ----------
    shape : tuple of int
        Width and height of the farm in cells.
    lengths : tuple of two floats
        Correlation lengths along x and y, cells.
    """

    def __init__(self, shape: tuple[int, int], lengths: tuple[float, float]) -> None:
        self._box = tuple(max(1.0, _ALIKE_LENGTHS * one) for one in lengths)
        self._rows = int(shape[1] / self._box[1]) + 1
        self._counts = np.zeros((int(shape[0] / self._box[0]) + 1) * self._rows, np.int64)

    def weights(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> _Floats:
        """Return what each of some further readings counts for, in their order, float64[n]."""
        box = (x / self._box[0]).astype(np.int64) * self._rows + (y / self._box[1]).astype(np.int64)
        order = np.argsort(box, kind="stable")
        first = np.searchsorted(box[order], box[order], side="left")
        rank = np.empty(len(box), np.int64)
        rank[order] = np.arange(len(box)) - first
        found: _Floats = 1.0 / (1 + rank + self._counts[box])
        self._counts += np.bincount(box, minlength=len(self._counts))
        return found
