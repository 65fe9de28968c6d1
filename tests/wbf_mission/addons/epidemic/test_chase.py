"""Paths that chase the disease are flights: each cell beside the one before, none outside the farm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbf_mission.addons.epidemic.chase import chasing_path

pytestmark = pytest.mark.kernel


@settings(deadline=None, max_examples=8)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(9, 12), (20, 6)]), st.integers(1, 80))
def test_a_path_goes_on_cell_by_cell_to_its_length(seed, shape, longest):
    rng = np.random.default_rng(seed)
    begun = np.column_stack((np.arange(5), np.full(5, 2)))
    path = chasing_path(begun, rng.random(shape) < 0.1, longest, rng)
    assert path.shape == (longest, 2)
    assert path[:5].tolist() == begun[:longest].tolist()
    assert (path >= 0).all() and (path < shape).all()
    assert (np.abs(np.diff(path, axis=0)).max(axis=1, initial=0) <= 1).all()


def test_it_looks_at_more_sick_plants_than_their_share_of_the_farm():
    sick = np.zeros((24, 24), np.bool_)
    sick[14:20, 3:9] = True
    begun = np.array([[10, y] for y in range(3)] + [[x, 4] for x in range(11, 16)])
    shares = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        path = chasing_path(begun, sick, 60, rng)[len(begun) :]
        cells = np.unique(path, axis=0)
        shares.append(sick[cells[:, 0], cells[:, 1]].mean())
    assert np.mean(shares) > 2 * sick.mean()


def test_it_is_the_same_for_the_same_seed():
    sick = np.random.default_rng(0).random((10, 10)) < 0.2
    first, again = (chasing_path(np.array([[0, 0]]), sick, 40, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
