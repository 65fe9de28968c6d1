"""Fields that are read at each access: as the array that they stand for, and scored as it."""

import numpy as np
import pytest

from geo.grid import FarmGrid
from sensors import fields as sensors_fields
from sensors.environment import environment as environments
from sensors.environment import generate_environment
from sensors.fields import PAPER_FIELDS
from sensors.lazy_fields import LazyFields
from sensors.scoring.information import InformationModel, tile_shape
from sensors.scoring.score import RunningScore

SHAPE = (3, 150, 140)
WHOLE = np.random.default_rng(5).random(SHAPE, np.float32)
LAZY = LazyFields(SHAPE, lambda field, columns: WHOLE[field, columns])
KEYS = (
    1,
    -1,
    (0, slice(3, 9)),
    (2, slice(None, None, 7)),
    (2, 5, 6),
    slice(1, 3),
    (..., slice(4, 6), slice(None)),
)


@pytest.mark.parametrize("key", [*KEYS, (slice(None), np.array([3, 5]), np.array([7, 8])), ...])
def test_a_part_is_that_of_the_array(key):
    np.testing.assert_array_equal(LAZY[key], WHOLE[key])


def test_it_counts_and_computes_as_an_array():
    assert (LAZY.shape, LAZY.dtype, LAZY.ndim, len(LAZY), LAZY.size) == (SHAPE, np.float32, 3, 3, WHOLE.size)
    assert LAZY.mean() == WHOLE.mean()
    np.testing.assert_array_equal(1.0 - LAZY, 1.0 - WHOLE)
    for read, whole in zip(LAZY, WHOLE, strict=True):
        np.testing.assert_array_equal(read, whole)
    with pytest.raises(IndexError, match="field 3: the array has 3 fields"):
        LAZY[3]


def test_only_the_wanted_field_and_columns_are_read():
    asked = []

    def read(field, columns):
        asked.append((field, columns))
        return WHOLE[field, columns]

    lazy = LazyFields(SHAPE, read)
    assert lazy[1, 20:30, 4].shape == (10,)
    assert asked == [(1, slice(20, 30))]


def test_truth_and_masks_of_a_large_farm_are_lazy_and_score_alike(monkeypatch):
    monkeypatch.setattr(environments, "LARGE_FROM_CELLS", 1000)
    monkeypatch.setattr(sensors_fields, "LARGE_FROM_CELLS", 1000)
    crop = np.full(SHAPE[1:], 2, np.int8)
    crop[:, 60:] = 1
    owned = np.ones(SHAPE[1:], np.bool_)
    owned[:20] = False
    grid = FarmGrid((150, 140), 0.3048, crop, owned)
    environment = generate_environment(grid, days=6, seed=7)
    truth, masks = environment.truth(6), PAPER_FIELDS.scored(grid)
    assert isinstance(truth, LazyFields)
    assert isinstance(masks, LazyFields)
    np.testing.assert_array_equal(truth, environment.values(6))
    np.testing.assert_array_equal(masks, PAPER_FIELDS.masks(grid))
    lazy, whole = RunningScore(truth, masks), RunningScore(environment.values(6), PAPER_FIELDS.masks(grid))
    value, rng = WHOLE.copy(), np.random.default_rng(6)
    for revision in range(3):
        changed = rng.random((3, *tile_shape(SHAPE[1:]))) < 0.5
        for k, i, j in np.argwhere(changed):
            value[k, 64 * i : 64 * (i + 1), 64 * j : 64 * (j + 1)] *= 0.9
        model = InformationModel(value, value, changed if revision else None, revision)
        assert lazy.add(model) == whole.add(model)


# Where each field counts


def test_masks_are_the_owners_crops_only():
    crop = np.array([[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]], np.int8)
    owned = np.array([[1] * 5, [0] * 5], bool)
    tylcv, ccr, soil = PAPER_FIELDS.masks(FarmGrid((2, 5), 1.0, crop, owned))
    assert tylcv.tolist() == [[False, False, True, False, False], [False] * 5]
    assert ccr.tolist() == [[False, True, False, False, False], [False] * 5]
    assert soil.tolist() == [[False, True, True, False, False], [False] * 5]
