"""Cameras that number their readings: the numbers stand for what other cameras read in the same images."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from geo.farms import get_farm
from sensors.camera.leaf_camera import (
    MOST_READINGS,
    ImageList,
    LeafCamera,
    LeafCameraOptions,
    NumberingCamera,
)
from sensors.environment import generate_environment
from sensors.fields import PAPER_FIELDS

SHAPE = (10, 10)
CELLS = st.integers(-3, 12)
IMAGES = st.lists(st.tuples(st.integers(0, 1), CELLS, CELLS), min_size=1, max_size=30)


@pytest.fixture(scope="module")
def environment():
    return generate_environment(get_farm("miniberry-10").grid(), days=6, seed=3, keep_days=[6])


@pytest.mark.parametrize(
    "options",
    [
        LeafCameraOptions(),
        LeafCameraOptions(3, noise_std=(0.1, 0.2, 0.3)),
        LeafCameraOptions(2, false_positive_rate=0.3, false_negative_rate=0.2, sensed=("ccr",)),
    ],
)
@sweep(few=30, many=100)
@given(taken=IMAGES)
def test_numbers_stand_for_the_readings_of_cameras(environment, options, taken):
    def cameras():
        return [LeafCamera(environment, SHAPE, 6, options, np.random.default_rng(k)) for k in (0, 1)]

    images = ImageList(options.footprint_cells**2)
    numbering = [NumberingCamera(images, k, SHAPE, options) for k in (0, 1)]
    direct = cameras()
    told = [(numbering[k].capture([x], [y])[0], direct[k].capture([x], [y])[0]) for k, x, y in taken]
    assert len(images) == len(taken)
    readings = images.read(cameras())
    for numbers, expected in told:
        assert numbers.shape == expected.shape
        known = ~np.isnan(numbers[:, 0])
        assert (numbers[known] == numbers[known, :1]).all()
        np.testing.assert_array_equal(readings[numbers[known, 0].astype(int)], expected[known])
        # The others lie beyond the farm: what a camera gives for them is dropped on the ground.
        assert np.isnan(expected[~known]).all() or options.random


def test_beyond_the_farm_there_is_no_number():
    images = ImageList(4)
    camera = NumberingCamera(images, 0, SHAPE, LeafCameraOptions(2))
    numbers = camera.capture([3, 9], [3, 9])
    assert numbers[..., 0].tolist()[0] == [0.0, 1.0, 2.0, 3.0]
    assert numbers[1, 0].tolist() == [4.0] * len(PAPER_FIELDS)
    assert np.isnan(numbers[1, 1:]).all()


def test_numbers_are_exact_or_the_list_says_so():
    images = ImageList(64 * 64)
    images.add([0] * 4096, [0] * 4096, 0)
    assert images.is_exact and MOST_READINGS == 4096 * 4096
    images.add([0], [0], 0)
    assert not images.is_exact
