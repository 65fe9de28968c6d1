"""Where each field counts."""

import numpy as np

from geo.grid import FarmGrid
from sensors.fields import PAPER_FIELDS


def test_masks_are_the_owners_crops_only():
    crop = np.array([[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]], np.int8)
    owned = np.array([[1] * 5, [0] * 5], bool)
    tylcv, ccr, soil = PAPER_FIELDS.masks(FarmGrid((2, 5), 1.0, crop, owned))
    assert tylcv.tolist() == [[False, False, True, False, False], [False] * 5]
    assert ccr.tolist() == [[False, True, False, False, False], [False] * 5]
    assert soil.tolist() == [[False, True, True, False, False], [False] * 5]
