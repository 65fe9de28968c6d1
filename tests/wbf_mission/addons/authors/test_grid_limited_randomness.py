import numpy as np
import pytest
import shapely
from policy_observations import observation, report

from geo.farms import get_farm
from mission.errors import PlanningError
from mission.planners import LengthBudget
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event
from wbf_mission.addons.authors.grid_limited_randomness import ORDERS, GridLimitedRandomness


def _path(vehicle, **parameters):
    return GridLimitedRandomness(**parameters).decide(observation(vehicle)).paths[vehicle.system_id]


def _cells(points, columns, rows):
    """Return in which cell of the grid over Miniberry-30 each point lies, counted row by row."""
    side = 30 * get_farm("miniberry-30").cell_size_m
    x, y = np.clip((points / side * (columns, rows)).astype(int), 0, (columns - 1, rows - 1)).T
    return (x + columns * y).tolist()


def test_every_round_visits_every_cell_once_to_and_fro():
    points = _path(report(), h_cells=3, v_cells=2, order="end")
    visited = _cells(points[:-1], 3, 2)
    assert len(visited) >= 12
    assert visited == [(0, 1, 2, 5, 4, 3)[k % 6] for k in range(len(visited))]


@pytest.mark.parametrize("order", ORDERS)
def test_places_are_spread_evenly_over_the_cells(order):
    points = _path(report(), order=order)
    if order == "end":  # its last leg is cut
        points = points[:-1]
    counts = np.bincount(_cells(points, 2, 2), minlength=4)
    assert counts.max() - counts.min() <= 1 and counts.sum() >= 10


def test_one_cell_is_a_random_walk_of_which_more_budget_is_a_continuation():
    short, long = (_path(report(steps=steps), h_cells=1, v_cells=1, order="end") for steps in (100, 200))
    assert np.array_equal(short[:-1], long[: len(short) - 1])


def test_better_orders_visit_more_places_for_the_budget():
    ends, detours, tours = (len(_path(report(steps=360), order=order)) for order in ORDERS)
    assert ends < 0.5 * detours and detours <= 1.02 * tours


@pytest.mark.parametrize("order", ORDERS)
def test_the_budget_is_kept_and_nearly_used(order):
    vehicle = report(budget=LengthBudget(60.0, return_to=get_farm("miniberry-30").home_m))
    cost = vehicle.travel_cost.rest([_path(vehicle, order=order)])[0]
    assert 50.0 <= cost <= 60.0


def test_paths_stay_out_of_a_pond():
    farm = get_farm("miniberry-30")
    pond = shapely.Point(4.5, 4.5).buffer(2.0)
    area = farm.owner_area - pond
    path = shapely.LineString(_path(report(area=area)))
    assert area.buffer(1e-6).covers(path)


def test_seeds_and_vehicles_draw_different_paths_and_equal_ones_the_same():
    first, again = _path(report(seed=5)), _path(report(seed=5))
    assert np.array_equal(first, again)
    for other in (report(seed=6), report(2, seed=5)):
        assert not np.array_equal(first[:5], _path(other)[:5])


def test_nothing_is_decided_in_flight():
    policy = GridLimitedRandomness()
    assert policy.decide(observation(report(), event=Event.LOST)) is NO_CHANGE


def test_parameters_out_of_range_are_refused():
    with pytest.raises(PlanningError, match="h_cells must be a whole number from 1 to 100, not 0"):
        GridLimitedRandomness(h_cells=0)
    with pytest.raises(PlanningError, match="order must be one of end, detour, tour, not 'ca'"):
        GridLimitedRandomness(order="ca")
