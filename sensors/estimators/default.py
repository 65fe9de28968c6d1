"""The estimator that a farm gets when none is named."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sensors.fields import PAPER_FIELDS

if TYPE_CHECKING:
    from geo.farm import Farm

SMALL_FARM_CELLS = 128 * 128
"""On farms of more cells, what `epidemic` gains over `gp` is not worth its time and memory."""


def default_estimator(farm: Farm, fields: Sequence[str] = PAPER_FIELDS.names) -> str:
    """Return the name of the estimator of least loss that a farm can afford.

    That is ``epidemic`` on farms of up to 128 x 128 cells and ``gp`` on larger ones, by the figures in
    ``docs/decisions/0013-default-estimator.md``. Fields other than the paper's three are left to ``gp`` on
    any farm: ``epidemic`` knows no others.

    Parameters
    ----------
    farm : Farm
        Where is flown.
    fields : sequence of str, optional
        The fields that are sensed.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> [default_estimator(get_farm(name)) for name in ("miniberry-30", "waterberry")]
    ['epidemic', 'gp']
    >>> default_estimator(get_farm("miniberry-30"), ("tylcv", "ccr", "soil", "nitrogen"))
    'gp'
    """
    small = farm.width_cells * farm.height_cells <= SMALL_FARM_CELLS
    return "epidemic" if small and tuple(fields) == PAPER_FIELDS.names else "gp"
