"""Farms of one tile are painted and summed in numpy: to the last bit as compiled code does it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.estimators.disks import Strokes, centred_disk, paint_small
from sensors.estimators.painting import paint
from sensors.scoring.information import SUMS
from sensors.scoring.score import sum_tile, tile_extremes
from sensors.scoring.score_sums import find_extremes, sum_errors
from wbf_mission.addons.authors.adaptive_disk import misplaced_disk

pytestmark = pytest.mark.kernel


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([(1, 1), (30, 30), (5, 64), (64, 17), (64, 64)]),
    st.integers(0, 40),
    st.integers(1, 80),
    st.sampled_from([centred_disk, misplaced_disk]),
    st.booleans(),
    st.booleans(),
)
def test_disks_are_painted_alike(seed, shape, n, radius, stamp, reset, of_one_field):
    rng = np.random.default_rng(seed)
    fields = np.array([1] if of_one_field else [0, 1, 2])
    planes = fields if of_one_field else np.array([0])
    disk = stamp(radius)
    x, y = (rng.integers(0, side, n).astype(np.int32) for side in shape)
    table = rng.choice([0.0, 0.5, 1.0], (len(fields), n)).astype(np.float32)
    value = rng.choice([0.0, 0.5, 1.0], (3, *shape)).astype(np.float32)
    doubt = rng.choice([0.0, 1.0], (3 if of_one_field else 1, *shape)).astype(np.float32)
    unsure = rng.choice([0.0, 0.25], (len(planes), n)).astype(np.float32)
    defaults = np.ones(len(fields), np.float32)
    found = []
    for way in (paint, paint_small):
        arrays = value.copy(), doubt.copy(), np.zeros((1, 1), np.bool_)
        tiles = np.ones((1, 1), np.bool_)
        disks = tiles, reset, x, y, disk.first, disk.low, disk.high
        way(Strokes(*disks, table, unsure, defaults, fields, planes), *arrays)
        found.append(arrays)
    for compiled, plain in zip(*found, strict=True):
        np.testing.assert_array_equal(compiled, plain)


@given(st.integers(0, 2**32 - 1), st.sampled_from([(1, 1), (30, 30), (64, 17)]), st.floats(0.0, 1.0))
def test_errors_are_summed_alike(seed, shape, share):
    rng = np.random.default_rng(seed)
    mask = rng.random(shape) < share
    truth, estimate = rng.random((2, *shape)).astype(np.float32)
    estimate[rng.random(shape) < 0.02] = np.nan
    tiles, lines = np.ones((1, 1), np.bool_), np.count_nonzero(mask, axis=0)
    sums, above, below = np.zeros((1, 1, SUMS)), *np.zeros((2, 1, shape[1]))
    if mask.any():
        sum_errors(tiles, np.full((1, 1), mask.sum()), mask, truth, estimate, sums)
        find_extremes(tiles, lines, mask, truth, estimate, above, below)
        assert np.array_equal(sum_tile(mask, truth, estimate), sums[0, 0], equal_nan=True)
        with np.errstate(invalid="ignore"):
            plain = tile_extremes(mask, truth, estimate)
        assert np.array_equal(plain, np.stack([above[0], below[0]]), equal_nan=True)


@pytest.mark.parametrize("way", [paint, paint_small])
def test_nothing_is_painted_where_nothing_is_to_be(way):
    disk, value = centred_disk(2), np.zeros((3, 4, 4), np.float32)
    tiles = np.zeros((1, 1), np.bool_)
    disks = tiles, True, np.ones(1, np.int32), np.ones(1, np.int32), disk.first, disk.low, disk.high
    table, doubts, defaults = (
        np.ones((3, 1), np.float32),
        np.zeros((1, 1), np.float32),
        np.ones(3, np.float32),
    )
    strokes = Strokes(*disks, table, doubts, defaults, np.arange(3), np.array([0]))
    way(strokes, value, np.zeros((1, 4, 4), np.float32), np.zeros((1, 1), np.bool_))
    assert not value.any()
