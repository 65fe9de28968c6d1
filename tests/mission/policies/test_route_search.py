import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.policies.route_search import leg_offsets, leg_values, neighbour_shares, search_route, take_leg
from mission.policies.steering import affordable

pytestmark = pytest.mark.kernel
ALONE = neighbour_shares(0.0, 1.0, 1)
FLAT = np.ones(8)


def _search(values, x, y, horizon, free=None, beam=6, patience=1e9, shares=ALONE):
    free = np.ones(values.shape, np.bool_) if free is None else free
    return search_route(
        values,
        shares,
        free,
        x,
        y,
        leg_offsets(10),
        horizon,
        0.0,
        FLAT,
        patience,
        max(1, int(horizon) // 3),
        beam,
    )


def test_a_leg_takes_what_it_sees_and_a_share_of_what_lies_beside():
    values = np.ones((9, 7), np.float32)
    take_leg(values, neighbour_shares(0.5, 1e9, 1), 0.5, 3.5, 4.5, 3.5)
    assert (values[1:5, 3] == 0).all() and values[0, 3] == 0.5
    assert values[3, 2] == pytest.approx(0.125) and values[3, 5] == 1.0 and values[7, 3] == 1.0


def test_the_route_goes_where_the_value_is_and_counts_it_once():
    values = np.zeros((12, 12), np.float32)
    values[8, 2] = values[8, 9] = 1.0
    route = _search(values, 2.5, 2.5, 15.0)
    assert route[-1, 3] == pytest.approx(2.0)
    seen = values.copy()
    for a, b in itertools.pairwise([(2.5, 2.5), *map(tuple, route[:, :2])]):
        take_leg(seen, ALONE, *a, *b)
    assert seen.sum() == 0.0


@pytest.mark.parametrize("begin", [(-3.5, 5.5), (5.5, -3.5), (13.5, 5.5), (5.5, 13.5)])
def test_a_leg_from_beside_the_map_sees_nothing_before_it_is_on_it(begin):
    x, y = np.indices((10, 10)) + 0.5
    far = (np.hypot(x - begin[0], y - begin[1]) > 8.0).astype(np.float32)
    assert len(_search(far, *begin, 6.0)) == 0, "the legs end before they reach it"
    offsets = leg_offsets(6)
    values, costs = np.empty((2, len(offsets)))
    leg_values(far, np.ones(far.shape, np.bool_), *begin, offsets, 0.0, FLAT, values, costs)
    assert values.max() == 0.0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.floats(1.0, 25.0))
def test_routes_keep_their_horizon_and_promise_what_they_see(seed, horizon):
    rng = np.random.default_rng(seed)
    values = rng.random((10, 9)).astype(np.float32)
    x, y = rng.integers(0, 9, 2) + 0.5
    route = _search(values, x, y, horizon)
    path = np.vstack(([[x, y]], route[:, :2]))
    assert np.hypot(*np.diff(path, axis=0).T).sum() <= np.ceil(horizon) + 1e-6
    left = values.copy()
    for a, b in itertools.pairwise(path):
        take_leg(left, ALONE, *a, *b)
    assert route[-1, 3] <= (values - left).sum() + 1e-4


@given(st.lists(st.floats(0.0, 20.0), min_size=2, max_size=11))
def test_the_longest_payable_part_is_kept_even_if_a_shorter_one_costs_more(costs):
    # The cost of the path's first n points, for n from 0; a part of a leg costs as much as the whole leg.
    points = np.column_stack((np.arange(1.0, len(costs)), np.zeros(len(costs) - 1)))

    def rest(paths):
        return [costs[math.ceil(path[-1, 0])] if len(path) else costs[0] for path in paths]

    vehicle = SimpleNamespace(left=10.0, position_m=(0.0, 0.0), travel_cost=SimpleNamespace(rest=rest))
    payable = [count for count, cost in enumerate(costs) if cost <= 10.0]
    kept = affordable(vehicle, points)
    assert kept.tolist() == points[: payable[-1] if payable else 0].tolist()
