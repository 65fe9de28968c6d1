"""Fixed plans of fleets: parts of the land, and what becomes of a lost vehicle's part."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from policy_observations import observation, report

from geo import get_farm
from geo.named import ParameterError
from mission.planners import StepBudget
from mission.policies.allocation import _pieces, reach_m, shared
from mission.policies.decision import NO_CHANGE
from mission.policies.observation import Event, Status
from mission.policies.policy import FixedPlan

FARM = get_farm("miniberry-30")


def seen_by(path, width):
    return shapely.LineString(path).buffer(0.5 * width, cap_style="square")


def test_a_single_vehicle_has_everything():
    assert shared([report(1)], "strips") == {1: FARM.owner_area}
    assert shared([report(1), report(2)], "none") == {1: FARM.owner_area, 2: FARM.owner_area}
    halves = [report(1), report(2)]
    west = replace(halves[0].request, area=shapely.box(0.0, 0.0, 4.0, 9.0))
    halves[0] = replace(halves[0], request=west)
    assert shared(halves, "strips") == {1: west.area, 2: FARM.owner_area}
    alone = FixedPlan("spiral", "voronoi").decide(observation(report(1))).paths[1]
    assert alone.tolist() == FixedPlan("spiral").decide(observation(report(1))).paths[1].tolist()
    with pytest.raises(ParameterError, match="partition 'halves': give strips, voronoi or none"):
        FixedPlan("spiral", "halves")


@pytest.mark.parametrize(("partition", "counts"), [("strips", (2, 3, 5, 10)), ("voronoi", (2, 5))])
def test_each_vehicle_keeps_to_its_part(partition, counts):
    for count in counts:
        vehicles = [report(number) for number in range(1, count + 1)]
        parts = shared(vehicles, partition)
        paths = FixedPlan("lawnmower", partition).decide(observation(*vehicles)).paths
        for number, path in paths.items():
            assert parts[number].buffer(1e-6).covers(shapely.LineString(path))


def test_a_vehicle_that_flies_farther_gets_more():
    vehicles = [report(1, steps=400.0), report(2, steps=100.0)]
    assert reach_m(vehicles[0]) == pytest.approx(400 * 0.3048, rel=0.02)
    for partition in ("strips", "voronoi"):
        parts = shared(vehicles, partition)
        assert 3.0 < parts[1].area / parts[2].area < 6.0


class Fleet:
    """Robots that fly what a fixed plan answers, and fail one after the other."""

    def __init__(self, policy, steps):
        self.policy, self.steps = policy, steps
        self.paths = policy.decide(observation(*(report(number, steps=steps) for number in (1, 2, 3)))).paths
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
            report(
                one,
                steps=self.steps,
                status=Status.LOST if one in self.lost else Status.FLYING,
                here=tuple(self.flown[one][-1]),
                spent=StepBudget(self.steps).cost(self.flown[one]),
                rest=self.rest[one],
            )
            for one in self.rest
        ]
        answer = self.policy.decide(observation(*reports, event=Event.LOST))
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


@pytest.mark.parametrize("order", [(1, 2), (3, 1)])
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


def test_the_rest_of_a_lost_vehicle_is_seen_by_the_others():
    fleet = Fleet(FixedPlan("lawnmower"), 360.0)
    fleet.fly(6)
    answer = fleet.lose(2)
    assert set(answer.paths) == {1, 3} and "lost vehicle 2 is taken over" in answer.reason
    assert fleet.unseen() < 0.03
    # The same vehicle is not handed over again when another one fails.
    again = fleet.lose(3)
    assert set(again.paths) == {1} and "lost vehicle 2, 3" not in again.reason


def test_who_has_more_to_spare_takes_over_more():
    land = shapely.box(0.0, 0.0, 8.0, 4.0)
    rich, poor = report(1, steps=400.0), report(2, steps=400.0, spent=300.0, rest=np.array([(20.0, 0.0)]))
    pieces = _pieces(land, [rich, poor])
    assert pieces[0].area > 1.5 * pieces[1].area
    alike = _pieces(land, [rich, report(2, steps=400.0)])
    assert alike[0].area == pytest.approx(alike[1].area, rel=0.05)
    # What is too little to be divided is one vehicle's.
    sliver = shapely.box(0.0, 0.0, 1e-9, 1e-9)
    shares = _pieces(sliver, [rich, report(2, here=(5.0, 5.0))])
    assert sum(not one.is_empty for one in shares) == 1 and not shares[0].is_empty
