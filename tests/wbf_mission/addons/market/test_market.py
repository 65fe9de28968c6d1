from dataclasses import replace

import numpy as np
import pytest
import shapely
from policy_observations import observation, report

from geo.farms import get_farm
from mission.errors import PlanningError
from mission.planners import LengthBudget
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, Status
from sensors.observations import Observations
from wbf_mission.addons.market.market import Market

FARM = get_farm("miniberry-30")
CELL = FARM.cell_size_m
SIDE = 30 * CELL


def _fleet(count, **known):
    return [report(k + 1, **known) for k in range(count)]


def _flown(vehicle, path, points):
    """Return a vehicle that has passed the first `points` points of its path."""
    here = tuple(path[points - 1].tolist())
    spent = vehicle.travel_cost.rest([path[:points]])[0]
    status = Status.FLYING
    known = report(vehicle.system_id, steps=vehicle.request.budget.limit, here=here, status=status)
    return replace(known, spent=spent, rest_m=path[points:])


def _seen(cells, value=0.0, begin=0, field=0, day=6):
    values = np.ones((len(cells), 3))
    values[:, field] = value
    x, y = np.array(cells).T
    return Observations(x, y, np.arange(begin, begin + len(cells)), np.full(len(cells), day), values)


def _passes(path, low, high, start=(0.0, 0.0)):
    """Length of the path in a box of cells, in cells."""
    line = shapely.LineString(np.vstack((start, path)))
    return (
        shapely.intersection(line, shapely.box(*np.array(low) * CELL, *np.array(high) * CELL)).length / CELL
    )


def _asked(policy, vehicles, seen):
    """Show detections, then that there are no more; return the decision."""
    policy.decide(observation(*vehicles, event=Event.OBSERVATIONS, seen=seen))
    healthy = _seen([(1, 1)], 1.0, begin=100)
    both = Observations.concatenate([seen, healthy])
    return policy.decide(observation(*vehicles, event=Event.OBSERVATIONS, seen=both))


def _rows(path):
    """Return the long legs along an axis: the rows of segments, as lines."""
    legs = np.stack((path[:-1], path[1:]), axis=1)
    extent = np.abs(legs[:, 1] - legs[:, 0]) / CELL
    kept = (extent.min(axis=1) < 1e-6) & (extent.max(axis=1) > 3.0)
    return list(shapely.linestrings(legs[kept]))


def _covered(rows, paths):
    """Return how many of the rows are flown by the paths."""
    flown = shapely.union_all([shapely.LineString(path) for path in paths]).buffer(0.1)
    return sum(flown.covers(row) for row in rows)


def test_the_first_look_is_divided_among_the_vehicles():
    decision = Market().decide(observation(*_fleet(3)))
    spacing = decision.spacing_m[1]
    # Half of 3 times 200 steps of a cell.
    assert spacing == pytest.approx(SIDE**2 / (0.5 * 600 * CELL), rel=0.2)
    rows = {k: _rows(path) for k, path in decision.paths.items()}
    seen = shapely.union_all([row.buffer(0.5 * spacing) for own in rows.values() for row in own])
    assert seen.intersection(shapely.box(0, 0, SIDE, SIDE)).area > 0.9 * SIDE**2
    for k, own in rows.items():
        assert len(own) >= 4
        assert _covered(own, [path for other, path in decision.paths.items() if other != k]) <= 1


def _begun(policy, vehicles, points=2):
    """Return the vehicles after the first `points` points of their first paths, and these paths."""
    paths = policy.decide(observation(*vehicles)).paths
    return [_flown(one, paths[one.system_id], points) for one in vehicles], paths


def _with_detections(policy, seen):
    flying, paths = _begun(policy, _fleet(3))
    return flying, paths, _asked(policy, flying, seen)


def test_about_finds_a_contractor_flies_fine_rows():
    detections = _seen([(20, 20), (21, 20)])
    flying, paths, decision = _with_detections(Market(), detections)
    low, high = (17, 17), (25, 24)
    where = {one.system_id: one.position_m for one in flying}
    gains = {
        k: _passes(path, low, high, where[k]) - _passes(paths[k][2:], low, high, where[k])
        for k, path in decision.paths.items()
    }
    # Rows 2 cells apart over 8 x 7 cells.
    assert max(gains.values()) > 16 and max(gains, key=gains.get) != 1


def test_a_run_of_finds_is_waited_for():
    policy = Market()
    flying, _ = _begun(policy, _fleet(2))
    detections = _seen([(20, 20), (21, 20)])
    assert policy.decide(observation(*flying, event=Event.OBSERVATIONS, seen=detections)) is NO_CHANGE
    more = Observations.concatenate([detections, _seen([(22, 20)], begin=2)])
    assert policy.decide(observation(*flying, event=Event.OBSERVATIONS, seen=more)) is NO_CHANGE
    assert policy.decide(observation(*flying, event=Event.OBSERVATIONS, seen=more)).changes


def test_what_is_a_find():
    infected, other = _seen([(20, 20)], 0.5), _seen([(20, 20)], field=1)
    for detections in (infected, other):
        assert _with_detections(Market(), detections)[2] is NO_CHANGE
    assert _with_detections(Market(below=0.75), infected)[2].changes
    assert _with_detections(Market(field="ccr"), other)[2].changes
    assert _with_detections(Market(field="all"), other)[2].changes
    with pytest.raises(PlanningError, match="no scored disease is named 'soil'; give one of tylcv, ccr, all"):
        _with_detections(Market(field="soil"), infected)


def test_finds_are_offered_once():
    policy = Market()
    detections = _seen([(20, 20)])
    flying, _, first = _with_detections(policy, detections)
    assert first.changes
    on = [replace(one, rest_m=first.paths.get(one.system_id, one.rest_m)) for one in flying]
    again = Observations.concatenate([detections, _seen([(1, 1)], 1.0, 100), _seen([(21, 21)], 0.0, 101)])
    for _ in range(3):
        assert policy.decide(observation(*on, event=Event.OBSERVATIONS, seen=again)) is NO_CHANGE


def test_what_a_lost_vehicle_has_not_flown_is_sold_to_the_others():
    policy = Market()
    flying, paths = _begun(policy, _fleet(3, steps=300), points=4)
    lost = replace(flying[0], status=Status.LOST)
    decision = policy.decide(observation(lost, *flying[1:], event=Event.LOST))
    assert set(decision.paths) <= {2, 3} and decision.changes
    rows = _rows(paths[1][4:])
    before = [one.rest_m for one in flying[1:]]
    after = [decision.paths.get(one.system_id, one.rest_m) for one in flying[1:]]
    assert len(rows) > 3 and _covered(rows, before) <= 1
    assert _covered(rows, after) > 0.7 * len(rows)


def test_a_vehicle_that_did_not_take_its_path_has_its_segments_sold_again():
    policy = Market()
    flying, _ = _begun(policy, _fleet(2))
    astray = replace(flying[0], rest_m=np.array([[3.0, 3.0]]))
    decision = policy.decide(observation(astray, flying[1], event=Event.OBSERVATIONS))
    assert 1 in decision.paths and len(decision.paths[1]) > 3


def test_a_path_that_is_about_to_end_goes_on_while_something_is_left_of_the_budget():
    policy = Market()
    vehicle = report(steps=4000.0)
    path = policy.decide(observation(vehicle)).paths[1]
    ending = _flown(vehicle, path, len(path) - 1)
    assert ending.left > 100.0
    on = policy.decide(observation(ending, event=Event.ENDING)).paths[1]
    assert len(on) > 5 and ending.travel_cost.rest([on])[0] <= ending.left
    spent = replace(ending, spent=4000.0)
    assert policy.decide(observation(spent, event=Event.ENDING)) is NO_CHANGE


def test_runs_are_alike_and_vehicles_wander_apart():
    first, second = (Market().decide(observation(*_fleet(3))).paths for _ in range(2))
    assert all(np.array_equal(first[k], second[k]) for k in first)
    other = Market().decide(observation(*_fleet(3, seed=4))).paths
    assert not np.array_equal(first[1][-3:], other[1][-3:])
    assert not np.array_equal(first[1][-3:], first[2][-3:])


def test_the_way_home_is_kept():
    budget = LengthBudget(60.0, return_to=FARM.home_m)
    vehicles = _fleet(2, budget=budget)
    for k, path in Market().decide(observation(*vehicles)).paths.items():
        assert 40.0 < vehicles[k - 1].travel_cost.rest([path])[0] <= 60.0


def _about_detections(policy, vehicles, day, seen):
    """Fly and show detections; return the first paths, whether fine segments were sold, and what was seen."""
    first = policy.decide(replace(observation(*vehicles, seen=seen), day=day)).paths
    flying = [_flown(one, first[one.system_id], 2) for one in vehicles]
    detections = Observations.concatenate([seen, _seen([(20, 20), (21, 20)], begin=200, day=day)])
    healthy = Observations.concatenate([detections, _seen([(1, 1)], 1.0, begin=300, day=day)])
    for now in (detections, healthy):
        answer = policy.decide(replace(observation(*flying, event=Event.OBSERVATIONS, seen=now), day=day))
    return first, answer.reason == "segments around detections", healthy


def test_each_flight_begins_with_a_first_look_and_each_day_with_finds_of_its_own():
    policy, vehicles = Market(), _fleet(3)
    first, sold, seen = _about_detections(policy, vehicles, 6, Observations.empty())
    assert sold
    again, sold, seen = _about_detections(policy, vehicles, 6, seen)
    assert not sold, "they were offered on this day"
    # What is left of the fine segment is flown, too; of the first look nothing is sold twice.
    rows = [row for path in again.values() for row in _rows(path)]
    assert len({row.wkb for row in rows}) == len(rows)
    later, sold, _ = _about_detections(policy, vehicles, 7, seen)
    assert sold
    for k, path in first.items():
        assert [row.wkb for row in _rows(later[k])][:3] == [row.wkb for row in _rows(path)][:3]


def test_parameters_out_of_range_are_refused():
    with pytest.raises(PlanningError, match=r"explore must be between 0 and 1, not 1\.5"):
        Market(explore=1.5)
    with pytest.raises(PlanningError, match="step must be above zero, not 0"):
        Market(step=0)
