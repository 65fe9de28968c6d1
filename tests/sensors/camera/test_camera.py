"""The leaf camera's optics and errors."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.camera.leaf_camera import LeafCamera, LeafCameraOptions, footprint_offsets
from sensors.errors import ObservationError

SHAPE = (40, 30)


class World:
    """A field whose values tell the cell; it refuses cells that do not exist."""

    def __init__(self, values=None):
        x, y = np.meshgrid(np.arange(40), np.arange(30), indexing="ij")
        self.values = np.stack([x, y, x * 100 + y]).astype(np.float32) if values is None else values

    def sample(self, day, ix, iy):
        assert day == 6
        assert ix.min() >= 0
        assert iy.min() >= 0
        return self.values[:, ix, iy].T


def camera(options=None, seed=None, **more):
    rng = None if seed is None else np.random.default_rng(seed)
    return LeafCamera(World(**more), SHAPE, 6, options, rng)


def flat_world(value):
    return World(np.full((3, *SHAPE), value, np.float32))


def test_cells_off_the_farm_give_no_value():
    values = camera().capture([-1, 40, 5, 5, 39, 0], [5, 5, -1, 30, 29, 0])[:, 0]
    assert values.dtype == np.float32
    assert np.isnan(values[:4]).all()
    assert values[4:].tolist() == [[39, 29, 3929], [0, 0, 0]]
    assert np.isnan(camera().capture([-7], [2**40])).all()


@pytest.mark.parametrize("side", [1, 2, 3, 6])
def test_footprints(side):
    values = camera(LeafCameraOptions(side)).capture([10, 0], [10, 0])
    assert values.shape == (2, side * side, 3)
    dx, dy = footprint_offsets(side)
    assert values[0, :, 0].tolist() == (10 + dx).tolist()
    assert values[0, :, 1].tolist() == (10 + dy).tolist()
    outside = (dx < 0) | (dy < 0)
    assert np.isnan(values[1]).all(axis=1).tolist() == outside.tolist()
    assert (dx.max() - dx.min() + 1, dy.max() - dy.min() + 1) == (side, side)
    assert (0, 0) in set(zip(dx.tolist(), dy.tolist(), strict=True))


def test_partial_suites():
    values = camera(LeafCameraOptions(sensed=["soil"])).capture([3], [4])[0, 0]
    assert np.isnan(values).tolist() == [True, True, False]
    assert LeafCameraOptions(sensed="ccr").sensed == ("ccr",)


def test_noise_is_gaussian_and_unbiased():
    options = LeafCameraOptions(noise_std=(0.1, 0.0, 0.3))
    seen = LeafCamera(flat_world(1.0), SHAPE, 6, options, np.random.default_rng(3))
    values = seen.capture([5] * 20000, [5] * 20000)[:, 0]
    assert values.mean(axis=0) == pytest.approx([1, 1, 1], abs=0.01)
    assert values.std(axis=0) == pytest.approx([0.1, 0.0, 0.3], rel=0.03)
    assert abs(np.corrcoef(values[:, 0], values[:, 2])[0, 1]) < 0.03


@pytest.mark.parametrize(("value", "wrong", "rate"), [(1.0, 0.5, 0.2), (0.5, 1.0, 0.3), (0.0, 1.0, 0.3)])
def test_false_readings(value, wrong, rate):
    options = LeafCameraOptions(false_positive_rate=0.2, false_negative_rate=0.3)
    seen = LeafCamera(flat_world(value), SHAPE, 6, options, np.random.default_rng(4))
    values = seen.capture([5] * 20000, [5] * 20000)[:, 0]
    assert set(np.unique(values[:, :2])) == {value, wrong}
    assert (values[:, :2] == wrong).mean(axis=0) == pytest.approx([rate, rate], abs=0.012)
    assert (values[:, 2] == np.float32(value)).all()
    both = ((values[:, 0] == wrong) & (values[:, 1] == wrong)).mean()
    assert both == pytest.approx(rate * rate, abs=0.012)


@given(cuts=st.lists(st.integers(0, 30), max_size=6), side=st.integers(1, 3))
@settings(max_examples=60, deadline=None)
def test_readings_do_not_depend_on_how_pictures_are_grouped(cuts, side):
    options = LeafCameraOptions(side, 0.1, 0.3, 0.3)
    x, y = list(range(30)), list(range(-5, 25))
    whole = camera(options, 9).capture(x, y)
    parted = camera(options, 9)
    edges = [0, *sorted(cuts), 30]
    parts = [parted.capture(x[a:b], y[a:b]) for a, b in itertools.pairwise(edges) if b > a]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"footprint_cells": 0}, "footprint"),
        ({"footprint_cells": 65}, "footprint"),
        ({"noise_std": -0.1}, "noise_std"),
        ({"noise_std": (0.1, 0.1)}, "noise_std"),
        ({"false_positive_rate": 1.01}, "false_positive_rate"),
        ({"false_negative_rate": float("nan")}, "false_negative_rate"),
        ({"sensed": ()}, "no field is sensed"),
        ({"sensed": ("tylcv", "rust")}, "unknown field 'rust'"),
    ],
)
def test_options_out_of_range(arguments, text):
    with pytest.raises(ObservationError, match=text):
        LeafCameraOptions(**arguments)


def test_errors_need_a_generator():
    with pytest.raises(ObservationError, match="need a random generator"):
        camera(LeafCameraOptions(noise_std=0.1))
