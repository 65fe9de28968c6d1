"""Fixed plans of fleets: parts of the land, and what becomes of a lost vehicle's part."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from geo import get_farm
from geo.named import ParameterError
from mission.planners import PlanningRequest, StepBudget
from mission.policies.allocation import PARTITION_NAMES, _pieces, reach_m, shared
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, GeometricTravelCost, PolicyObservation, Status, VehicleReport
from mission.policies.policy import FixedPlan
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import PAPER_WEIGHTS
from wbf_mission.scenario.parts import PARTITIONS

FARM = get_farm("miniberry-30")


def vehicle(number, steps=200.0, *, status=Status.READY, position=(0.0, 0.0), spent=0.0, rest=()):
    budget = StepBudget(steps)
    request = PlanningRequest(FARM.owner_area, (0.0, 0.0), budget)
    travel_cost = GeometricTravelCost(budget, position)
    return VehicleReport(
        number, request, status, position, (0.0, 0.0), 0.0, spent, np.array(rest), travel_cost
    )


def observation(vehicles, event=Event.START):
    model = InformationModel.uniform(FARM.grid().shape, value=(1, 1, 0.4), uncertainty=1)
    seen = Observations.empty(PAPER_FIELDS.names)
    return PolicyObservation(
        event, 0.0, 6, FARM, PAPER_FIELDS, PAPER_WEIGHTS, model, seen, tuple(vehicles), compute_s=1.0
    )


def seen_by(path, width):
    return shapely.LineString(path).buffer(0.5 * width, cap_style="square")


def test_the_option_knows_the_partitions():
    assert PARTITIONS == PARTITION_NAMES


def test_a_single_vehicle_has_everything():
    assert shared([vehicle(1)], "strips") == {1: FARM.owner_area}
    assert shared([vehicle(1), vehicle(2)], "none") == {1: FARM.owner_area, 2: FARM.owner_area}
    halves = [vehicle(1), vehicle(2)]
    west = replace(halves[0].request, area=shapely.box(0.0, 0.0, 4.0, 9.0))
    halves[0] = replace(halves[0], request=west)
    assert shared(halves, "strips") == {1: west.area, 2: FARM.owner_area}
    alone = FixedPlan("spiral", "voronoi").decide(observation([vehicle(1)])).paths[1]
    assert alone.tolist() == FixedPlan("spiral").decide(observation([vehicle(1)])).paths[1].tolist()
    with pytest.raises(ParameterError, match="partition 'halves': give strips, voronoi or none"):
        FixedPlan("spiral", "halves")


@pytest.mark.parametrize(("partition", "counts"), [("strips", (2, 3, 5, 10)), ("voronoi", (2, 5))])
def test_each_vehicle_keeps_to_its_part(partition, counts):
    for count in counts:
        vehicles = [vehicle(number) for number in range(1, count + 1)]
        parts = shared(vehicles, partition)
        paths = FixedPlan("lawnmower", partition).decide(observation(vehicles)).paths
        for number, path in paths.items():
            assert parts[number].buffer(1e-6).covers(shapely.LineString(path))


def test_a_vehicle_that_flies_farther_gets_more():
    vehicles = [vehicle(1, 400.0), vehicle(2, 100.0)]
    assert reach_m(vehicles[0]) == pytest.approx(400 * 0.3048, rel=0.02)
    for partition in ("strips", "voronoi"):
        parts = shared(vehicles, partition)
        assert 3.0 < parts[1].area / parts[2].area < 6.0


def fly(policy, lost_after, *, steps=360.0, lost=2):
    """Return the paths of three robots, where they are when one of them fails, and the answer to that."""
    vehicles = [vehicle(number, steps) for number in (1, 2, 3)]
    paths = policy.decide(observation(vehicles)).paths
    now = [
        vehicle(
            number,
            steps,
            status=Status.LOST if number == lost else Status.FLYING,
            position=tuple(paths[number][lost_after]),
            spent=StepBudget(steps).cost(np.vstack(((0.0, 0.0), paths[number][: lost_after + 1]))),
            rest=paths[number][lost_after + 1 :],
        )
        for number in paths
    ]
    return paths, now, policy.decide(observation(now, Event.LOST))


def test_the_rest_of_a_lost_vehicle_is_seen_by_the_others():
    policy = FixedPlan("lawnmower")
    paths, now, answer = fly(policy, 5)
    assert set(answer.paths) == {1, 3} and "lost vehicle 2 is taken over" in answer.reason
    flown = [seen_by(np.vstack(paths[number][:6]), 0.62) for number in (1, 2, 3)]
    flown += [
        seen_by(np.vstack((one.position_m, answer.paths[one.system_id])), 0.62)
        for one in now
        if one.system_id != 2
    ]
    assert shapely.union_all(flown).intersection(FARM.owner_area).area > 0.97 * FARM.owner_area.area
    for one in now:
        if one.system_id != 2:
            assert one.travel_cost.rest([answer.paths[one.system_id]])[0] <= one.left
    # The same vehicle is not handed over again when another one fails.
    third = [
        now[0],
        now[1],
        vehicle(3, 360.0, status=Status.LOST, position=now[2].position_m, rest=answer.paths[3]),
    ]
    again = policy.decide(observation(third, Event.LOST))
    assert set(again.paths) == {1} and "lost vehicle 2, 3" not in again.reason


def test_little_left_is_spread_more_thinly():
    paths, now, answer = fly(FixedPlan("lawnmower"), 5, steps=140.0)
    assert answer.paths
    for one in now:
        if one.system_id in answer.paths:
            assert one.travel_cost.rest([answer.paths[one.system_id]])[0] <= one.left
    lost = shapely.LineString(paths[2][6:]).buffer(0.1)
    assert any(shapely.LineString(path).intersects(lost) for path in answer.paths.values())


def test_nobody_takes_over_what_nobody_shares_or_can_pay():
    _, _, answer = fly(FixedPlan("lawnmower", "none"), 5)
    assert answer is NO_CHANGE
    policy = FixedPlan("lawnmower")
    _, now, _ = fly(policy, 5)
    gone = [vehicle(one.system_id, status=Status.LOST, position=one.position_m) for one in now]
    assert policy.decide(observation(gone, Event.LOST)) is NO_CHANGE
    assert policy.decide(observation([vehicle(1)], Event.PERIOD)) is NO_CHANGE


class Fleet:
    """Robots that fly what a fixed plan answers, and fail one after the other."""

    def __init__(self, policy, steps):
        self.policy, self.steps = policy, steps
        self.paths = policy.decide(observation([vehicle(number, steps) for number in (1, 2, 3)])).paths
        self.rest = dict(self.paths)
        self.flown = {number: np.zeros((1, 2)) for number in self.paths}
        self.lost = set()

    def fly(self, points):
        for number in set(self.rest) - self.lost:
            self.flown[number] = np.vstack((self.flown[number], self.rest[number][:points]))
            self.rest[number] = self.rest[number][points:]

    def lose(self, number):
        self.lost.add(number)
        reports = [
            vehicle(
                one,
                self.steps,
                status=Status.LOST if one in self.lost else Status.FLYING,
                position=tuple(self.flown[one][-1]),
                spent=StepBudget(self.steps).cost(self.flown[one]),
                rest=self.rest[one],
            )
            for one in self.rest
        ]
        answer = self.policy.decide(observation(reports, Event.LOST))
        for one in reports:
            if one.system_id in answer.paths:
                assert one.travel_cost.rest([answer.paths[one.system_id]])[0] <= one.left
        self.rest.update(answer.paths)
        return answer

    def unseen(self):
        """Return the part of the land that nobody has seen, or will see."""
        ways = [self.flown[one] for one in self.lost]
        ways += [np.vstack((self.flown[one], self.rest[one])) for one in set(self.rest) - self.lost]
        seen = shapely.union_all([seen_by(way, 0.62) for way in ways if len(way) > 1])
        return 1.0 - seen.intersection(FARM.owner_area).area / FARM.owner_area.area


@pytest.mark.parametrize("order", [(1, 2), (1, 3), (2, 1), (2, 3), (3, 1), (3, 2)])
@pytest.mark.parametrize("partition", ["strips", "voronoi"])
def test_land_that_was_taken_over_is_handed_on_when_its_taker_is_lost_too(order, partition):
    """The last one of three sees what two others leave, as far as they came between."""
    fleet = Fleet(FixedPlan("lawnmower", partition), 900.0)
    assert fleet.unseen() < 0.05
    fleet.fly(3)
    assert set(fleet.lose(order[0]).paths) == {1, 2, 3} - {order[0]}
    assert fleet.unseen() < 0.05
    fleet.fly(2)
    (last,) = {1, 2, 3} - set(order)
    second = fleet.lose(order[1])
    assert set(second.paths) == {last} and f"lost vehicle {order[1]} is" in second.reason
    assert fleet.unseen() < 0.05
    fleet.fly(500)
    assert fleet.lose(last) is NO_CHANGE


def test_who_flew_its_path_to_the_end_leaves_nothing_and_takes_over_what_others_leave():
    fleet = Fleet(FixedPlan("lawnmower"), 900.0)
    before = {number: len(path) for number, path in fleet.rest.items()}
    fleet.fly(before[1])
    assert fleet.lose(1) is NO_CHANGE
    fleet = Fleet(FixedPlan("lawnmower"), 900.0)
    fleet.flown[1], fleet.rest[1] = np.vstack((fleet.flown[1], fleet.rest[1])), fleet.rest[1][:0]
    assert 1 in fleet.lose(2).paths
    assert fleet.unseen() < 0.05


def test_who_has_more_to_spare_takes_over_more():
    land = shapely.box(0.0, 0.0, 8.0, 4.0)
    rich, poor = vehicle(1, 400.0), vehicle(2, 400.0, spent=300.0, rest=[(20.0, 0.0)])
    pieces = _pieces(land, [rich, poor])
    assert pieces[0].area > 1.5 * pieces[1].area
    alike = _pieces(land, [rich, vehicle(2, 400.0)])
    assert alike[0].area == pytest.approx(alike[1].area, rel=0.05)
    # What is too little to be divided is one vehicle's.
    sliver = shapely.box(0.0, 0.0, 1e-9, 1e-9)
    shares = _pieces(sliver, [rich, vehicle(2, position=(5.0, 5.0))])
    assert sum(not one.is_empty for one in shares) == 1 and not shares[0].is_empty
