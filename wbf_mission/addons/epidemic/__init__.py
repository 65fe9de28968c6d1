"""The estimator ``epidemic``, based on a model of how diseases spread."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sensors.fields import PAPER_FIELDS

if TYPE_CHECKING:
    from geo.farm import Farm

DEFAULT_CELLS = 128 * 128
"""Largest farm (cells) on which `epidemic` is the default: on larger farms it takes too long."""


def is_default(farm: Farm, fields: tuple[str, ...]) -> bool:
    """Return whether `epidemic` is the default: for the paper's fields, on farms of up to 128 x 128 cells.

    >>> from geo.farms import get_farm
    >>> [is_default(get_farm(name), PAPER_FIELDS.names) for name in ("miniberry-30", "waterberry")]
    [True, False]
    >>> is_default(get_farm("miniberry-30"), ("tylcv", "ccr", "soil", "nitrogen"))
    False
    """
    return farm.width_cells * farm.height_cells <= DEFAULT_CELLS and fields == PAPER_FIELDS.names
