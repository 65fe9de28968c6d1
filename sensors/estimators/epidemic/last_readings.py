"""What was read last of every cell, kept up to date: of exact readings nothing else counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.epidemic.decision import CLASS_VALUES
from sensors.estimators.epidemic.training import classes_of

EXACT = 1e-3
"""A reading that differs less from the value of a class shows this class without doubt."""

_UNREAD = -1


class LastReadings:
    """The class and the day of the last reading of every cell.

    Parameters
    ----------
    hosts : bool[W, H]
        Cells with the disease's crop; those of others are left out.

    Attributes
    ----------
    exact : bool
        Whether all readings so far had the value of a class.

    Examples
    --------
    >>> last = LastReadings(np.ones((2, 3), np.bool_))
    >>> last.follow(np.array([[1, 0], [0, 2], [1, 0]]), np.array([6, 6, 7]), np.array([1.0, 0.5, 0.0]))
    >>> [part.tolist() for part in last.known()], last.exact
    ([[2, 3], [1, 2], [6, 7]], True)
    """

    def __init__(self, hosts: NDArray[np.bool_]) -> None:
        self.exact = True
        self._hosts = hosts
        self._classes = np.full(hosts.size, _UNREAD, np.int8)
        self._days = np.zeros(hosts.size, np.int32)
        self._followed = 0

    def follow(
        self, cells: NDArray[np.integer], days: NDArray[np.integer], values: NDArray[np.float64]
    ) -> None:
        """Take what is new among the readings; once one was not exact, nothing is followed any more.

        Parameters
        ----------
        cells : int[n, 2]
            Of all readings so far, in the order in which they came.
        days : int[n]
            When.
        values : float64[n]
            NaN where the disease was not sensed.
        """
        new = slice(self._followed, None)
        self._followed = len(values)
        if not self.exact:
            return
        x, y = cells[new].T
        classes = classes_of(values[new])
        sensed = (classes >= 0) & self._hosts[x, y]
        x, y, classes = x[sensed], y[sensed], classes[sensed]
        self.exact = not (np.abs(values[new][sensed] - CLASS_VALUES[classes]) > EXACT).any()
        flat = x.astype(np.int64) * self._hosts.shape[1] + y
        # Of several readings of a cell the last one stays.
        self._classes[flat] = classes
        self._days[flat] = days[new][sensed]

    def known(self) -> tuple[NDArray[np.int64], NDArray[np.int8], NDArray[np.int32]]:
        """Return the cells that were read, ascending in C order, and class and day of the last reading."""
        flat = np.flatnonzero(self._classes != _UNREAD)
        return flat, self._classes[flat], self._days[flat]
