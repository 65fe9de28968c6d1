from itertools import permutations

import numpy as np
import pytest

from wbf_mission.addons.authors.grid_limited_randomness import insert_by_detour, shorten

pytestmark = pytest.mark.kernel


def _length(start, places, order, returns):
    way = np.vstack((start, places[np.asarray(order)], *([start[None]] if returns else [])))
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


@pytest.mark.parametrize("returns", [True, False])
def test_ways_visit_every_place_once_and_are_short(returns):
    rng = np.random.default_rng(4)
    for _ in range(5):
        start, places = rng.random(2), rng.random((7, 2))
        inserted = insert_by_detour(start, places, returns=returns)
        shorter = shorten(start, places, inserted, returns=returns)
        assert sorted(inserted) == sorted(shorter) == list(range(7))
        best = min(_length(start, places, order, returns) for order in permutations(range(7)))
        lengths = [_length(start, places, order, returns) for order in (inserted, shorter)]
        assert best - 1e-9 <= lengths[1] <= lengths[0] and lengths[1] <= 1.25 * best
