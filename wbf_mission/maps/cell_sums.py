"""The sums by pixels in numpy, for farms shown cell by cell: loading compiled code takes longer than that.

The same as `wbf_mission.maps.block_sums` to the last bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wbf_mission.maps.blocks import COUNT, ILLNESS, SICK, SICK_BELOW, SPREAD

__all__ = ["sum_pixels", "sum_squares"]

Floats = NDArray[np.float64]


def sum_pixels(
    mask: NDArray[np.bool_],
    value: NDArray[np.float32],
    pixel: int,  # noqa: ARG001
    sums: Floats,
    least: Floats,
) -> None:
    """Sum values over pixels of one cell: see `wbf_mission.maps.block_sums.sum_pixels`."""
    v = value[mask].astype(np.float64)
    terms = np.empty((len(v), sums.shape[2]))
    terms[:, COUNT], terms[:, ILLNESS], terms[:, SPREAD] = 1.0, 1.0 - v, v * (1.0 - v)
    terms[:, SICK] = v < SICK_BELOW
    sums[mask] += terms
    least[mask] = np.fmin(least[mask], v)


def sum_squares(
    mask: NDArray[np.bool_],
    deviation: NDArray[np.float32],
    pixel: int,  # noqa: ARG001
    sums: Floats,
) -> None:
    """Add squares over pixels of one cell: see `wbf_mission.maps.block_sums.sum_squares`."""
    d = deviation[mask].astype(np.float64)
    sums[mask] += d * d
