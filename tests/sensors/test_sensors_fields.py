"""Where each field counts."""

import numpy as np
import pytest

from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.fields import PAPER_FIELDS


def test_masks_are_the_owners_crops_only():
    crop = np.array([[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]], np.int8)
    owned = np.array([[1] * 5, [0] * 5], bool)
    tylcv, ccr, soil = PAPER_FIELDS.masks(FarmGrid((2, 5), 1.0, crop, owned))
    assert tylcv.tolist() == [[False, False, True, False, False], [False] * 5]
    assert ccr.tolist() == [[False, True, False, False, False], [False] * 5]
    assert soil.tolist() == [[False, True, True, False, False], [False] * 5]


@pytest.mark.parametrize(
    ("name", "cells"), [("miniberry-10", 50), ("miniberry-30", 450), ("miniberry-100", 5000)]
)
def test_masks_of_the_small_farms(name, cells):
    masks = PAPER_FIELDS.masks(get_farm(name).grid())
    assert masks.dtype == bool
    assert masks.sum(axis=(1, 2)).tolist() == [cells, cells, 2 * cells]


def test_one_name_and_default_per_field():
    assert len(PAPER_FIELDS.names) == len(set(PAPER_FIELDS.names)) == len(PAPER_FIELDS.defaults) == 3
