"""The three fields that are sensed, and the cells where each of them counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geo.grid import FarmGrid

FIELDS = ("tylcv", "ccr", "soil")
"""Tomato yellow leaf curl virus, charcoal rot of strawberries, soil humidity: the order of all arrays."""

DEFAULT_VALUES = (1.0, 1.0, 0.0)
"""The value assumed where nothing is known: healthy, healthy, dry."""


def relevance_masks(grid: FarmGrid) -> NDArray[np.bool_]:
    """Mark the cells whose error costs the farm's owner something.

    TYLCV counts on the owner's tomatoes, CCR on the owner's strawberries, soil humidity on the owner's
    planted land; the neighbours' land spreads disease but is never scored.

    Parameters
    ----------
    grid : FarmGrid
        The rasterised farm.

    Returns
    -------
    bool[3, W, H]
        One mask per field, in the order of `FIELDS`.
    """
    return np.stack([grid.tomato, grid.strawberry, grid.planted])
