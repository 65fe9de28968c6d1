"""The adaptive-disk estimator of the authors' code, for comparison with their published data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.adaptive_disk import AdaptiveDiskEstimator
from sensors.estimators.disks import Disk, half_widths


def misplaced_disk(radius: int) -> Disk:
    """Return the authors' disk: its *corner* is at the observation, and it lacks the last row and column.

    The disk is therefore centred at (x + radius, y + radius) and does not cover the observed cell.

    >>> disk = misplaced_disk(2)
    >>> disk.first, disk.low.tolist(), disk.high.tolist()
    (0, [2, 1, 0, 1], [3, 4, 4, 4])
    """
    half = half_widths(radius, np.arange(-radius, radius))
    return Disk(0, radius - half, np.minimum(radius + half + 1, 2 * radius))


class AuthorsAdaptiveDiskEstimator(AdaptiveDiskEstimator):
    """Adaptive disk with the authors' misplaced mask and their default value 0 ("destroyed") for all fields.

    Old readings have the same weight as new readings.

    Use it only for comparison with the authors' published results; otherwise use ``adaptive-disk``.

    Parameters
    ----------
    default_values : sequence of float
        Value of each field outside all disks: 0, 0, 0 in the authors' first code, 1, 1, 0 in their second.
    radius : int, optional
        Fixed radius in cells; by default adaptive.
    """

    _carries = False

    def __init__(self, default_values: Sequence[float] = (0.0, 0.0, 0.0), radius: int | None = None) -> None:
        # No `fields` parameter: the authors' code knows only the benchmark's fields.
        self.default_values = default_values
        self.radius = radius

    @staticmethod
    def _stamp(radius: int) -> Disk:
        return misplaced_disk(radius)

    @staticmethod
    def _possible(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return values
