import numpy as np
import pytest
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
def test_the_budget_is_kept_and_nearly_used(order):
    vehicle = report(budget=LengthBudget(60.0, return_to=get_farm("miniberry-30").home_m))
    cost = vehicle.travel_cost.rest([_path(vehicle, order=order)])[0]
    assert 50.0 <= cost <= 60.0


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
