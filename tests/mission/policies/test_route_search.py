import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.planners.budget import LengthBudget, StepBudget
from mission.planners.request import PlanningRequest
from mission.policies.observation import GeometricTravelCost, Status, VehicleReport
from mission.policies.planning_grid import LegCosts, PlanningGrid
from mission.policies.route_search import (
    candidate_places,
    leg_offsets,
    leg_values,
    neighbour_shares,
    search_route,
    search_tour,
    take_leg,
)
from mission.policies.steering import affordable

pytestmark = pytest.mark.kernel
ALONE = neighbour_shares(0.0, 1.0, 1)
FLAT = np.ones(8)


def _vehicle(budget, here=(0.0, 0.0), spent=0.0):
    request = PlanningRequest(shapely.box(0, 0, 50, 50), (0.0, 0.0), budget, 0.0)
    travel_cost = GeometricTravelCost(budget, here)
    return VehicleReport(
        1, request, Status.FLYING, here, (0.0, 0.0), 0.0, spent, np.empty((0, 2)), travel_cost
    )


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


def test_looking_ahead_beats_the_best_single_leg():
    values = np.zeros((15, 15), np.float32)
    values[7, 8] = 1.0
    values[7, 1:6] = 0.6  # the other way, worth more altogether
    values[1:7, 1] = 0.6
    assert _search(values, 7.5, 7.5, 13.0)[-1, 3] > 6.0


def test_legs_do_not_lead_through_what_is_not_free():
    free = np.ones((12, 12), np.bool_)
    free[5, :5] = False
    values = np.zeros((12, 12), np.float32)
    values[9, 2] = 1.0
    route = _search(values, 1.5, 2.5, 40.0, free, beam=20)
    path = np.vstack(([[1.5, 2.5]], route[:, :2]))
    for a, b in itertools.pairwise(path):
        cells = np.floor(a + np.linspace(0, 1, 200)[:, None] * (b - a)).astype(int)
        assert np.count_nonzero(~free[cells[:, 0], cells[:, 1]]) <= 20  # at most the corner of a cell
    assert route[-1, 3] == pytest.approx(1.0)


@pytest.mark.parametrize("begin", [(-3.5, 5.5), (5.5, -3.5), (13.5, 5.5), (5.5, 13.5)])
def test_a_leg_from_beside_the_map_sees_nothing_before_it_is_on_it(begin):
    x, y = np.indices((10, 10)) + 0.5
    far = (np.hypot(x - begin[0], y - begin[1]) > 8.0).astype(np.float32)
    assert len(_search(far, *begin, 6.0)) == 0, "the legs end before they reach it"
    offsets = leg_offsets(6)
    values, costs = np.empty((2, len(offsets)))
    leg_values(far, np.ones(far.shape, np.bool_), *begin, offsets, 0.0, FLAT, values, costs)
    assert values.max() == 0.0


def test_legs_end_in_all_cells_nearby_and_in_fewer_far_away():
    length = np.hypot(*leg_offsets(40).T)
    cells = np.hypot(*np.mgrid[-40:41, -40:41])
    assert (length < 12.0).sum() == ((cells >= 1.0) & (cells < 12.0)).sum()
    assert (length >= 12.0).sum() < 0.3 * ((cells >= 12.0) & (cells <= 40.0)).sum()


def test_nothing_to_be_seen_gives_no_route():
    assert len(_search(np.zeros((6, 6), np.float32), 1.5, 1.5, 8.0)) == 0


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


def test_a_tour_visits_what_pays_and_keeps_what_the_way_home_takes():
    pooled = np.zeros((20, 20), np.float32)
    pooled[3, 10] = pooled[10, 10] = 1.0
    pooled[19, 0] = 0.5
    goals = candidate_places(pooled, 0.5, 10.5, 6, 49)
    places = np.vstack(([[0.5, 10.5]], goals))
    costs = np.hypot(*np.moveaxis(places[:, None] - places[None], -1, 0))
    order, value = search_tour(places, costs, costs[:, 0].copy(), pooled, 1e9, 20.0, 3, 40)
    assert [tuple(place) for place in places[order]] == [(3.5, 10.5), (10.5, 10.5)]
    assert value == pytest.approx(2.0)
    order, _ = search_tour(places, costs, costs[:, 0].copy(), pooled, 1e9, 8.0, 3, 40)
    assert [tuple(place) for place in places[order]] == [(3.5, 10.5)]


def test_planning_grids_of_large_farms_have_few_blocks_and_keep_the_values():
    values = np.random.default_rng(0).random((600, 500)).astype(np.float32)
    planning_grid = PlanningGrid.of(shapely.box(0, 0, 600, 500), values.shape, 1.0, 1.0)
    assert planning_grid.block == 5 and planning_grid.free.shape == (120, 100) and planning_grid.free.all()
    assert planning_grid.pooled(values).sum() == pytest.approx(values.sum(), rel=1e-5)
    fine = neighbour_shares(0.12, 4.5, 3)
    assert 1 / 5 < planning_grid.shares(fine)[0, 0] < 1.0


def test_blocks_lie_in_the_area_whole_and_legs_that_leave_it_are_cut_off():
    area = shapely.box(0, 0, 10, 10) - shapely.box(4.5, -1, 5.5, 8)
    planning_grid = PlanningGrid.of(area, (10, 10), 1.0, 1.0)
    assert (
        not planning_grid.free[4, 0]
        and not planning_grid.free[5, 7]
        and planning_grid.free[3, 0]
        and planning_grid.free[5, 8]
    )
    points = np.array([[1.0, 9.0], [9.0, 9.0], [9.0, 1.0], [1.0, 1.0]])
    assert planning_grid.inside((1.0, 1.0), points).tolist() == points[:3].tolist()
    assert len(planning_grid.inside((1.0, 1.0), np.array([[9.0, 1.0]]))) == 0


def test_costs_of_legs_come_from_the_fares():
    costs = LegCosts.of(_vehicle(LengthBudget(100.0)), 2.0)
    assert costs.turn == pytest.approx(0.0) and np.allclose(costs.slopes, 2.0)
    assert LegCosts.of(_vehicle(StepBudget(100, 2.0)), 2.0).per_cell == pytest.approx(1.0)


def test_what_cannot_be_paid_is_cut_off():
    points = np.array([[10.0, 0.0], [10.0, 20.0]])
    there = _vehicle(LengthBudget(100.0, return_to=(0.0, 0.0)))
    assert affordable(there, points).tolist() == points.tolist()
    short = _vehicle(LengthBudget(40.0, return_to=(0.0, 0.0)))
    cut = affordable(short, points)
    assert len(cut) == 2 and 0.0 < cut[1, 1] < 20.0 and short.travel_cost.rest([cut])[0] <= 40.0
    shorter = _vehicle(LengthBudget(22.0, return_to=(0.0, 0.0)))  # Pays for a sixteenth of the second leg
    assert affordable(shorter, points).tolist() == [[10.0, 0.0], [10.0, 1.25]]
    assert len(affordable(_vehicle(LengthBudget(5.0), (30.0, 0.0), spent=5.0), points)) == 0


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
