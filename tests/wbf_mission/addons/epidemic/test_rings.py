"""Sums over rings of neighbours, against a walk over all neighbours of each cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbf_mission.addons.epidemic.features import REACH, Rings, local_features
from wbf_mission.addons.epidemic.features import RINGS as OF_CODES

pytestmark = pytest.mark.kernel

RINGS = Rings.that_end_at((1, 4, 25, 2 * REACH**2))


def _walk(rings, plane, x, y):
    """Return the scaled sum of a map with a margin over each ring around a cell."""
    out = np.zeros(len(rings.scales))
    for i in range(-REACH, REACH + 1):
        for j in range(-REACH, REACH + 1):
            if (i, j) != (0, 0):
                out[rings.number[abs(i), abs(j)]] += plane[x + REACH + i, y + REACH + j]
    return out * rings.scales


cells_of_a_farm = st.lists(
    st.tuples(st.integers(0, 4), st.integers(0, 6)), min_size=1, max_size=12, unique=True
).map(sorted)


@settings(deadline=None, max_examples=10)
@given(cells_of_a_farm, st.integers(0, 2**32 - 1))
def test_rings_hold_what_lies_around_a_cell(cells, seed):
    rng = np.random.default_rng(seed)
    shape = (5 + 2 * REACH, 7 + 2 * REACH)
    codes = rng.integers(0, 5, shape).astype(np.uint8)
    planes = rng.random((2, *shape)).astype(np.float32)
    x, y = np.array(cells, np.intp).T
    counts = local_features(codes, x, y).reshape(len(x), 4, -1)
    sums = RINGS.sums(planes, x, y).reshape(2, len(RINGS.scales), -1)
    for k, (i, j) in enumerate(cells):
        for code in range(1, 5):
            np.testing.assert_allclose(counts[k, code - 1], _walk(OF_CODES, codes == code, i, j), rtol=1e-5)
        for plane in range(2):
            np.testing.assert_allclose(sums[plane, :, k], _walk(RINGS, planes[plane], i, j), rtol=1e-4)
