import itertools
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from policy_observations import observation, report

from geo.named import ParameterError
from mission.policies.map_policies import Greedy
from mission.policies.observation import Event, Status
from mission.policies.steering import COORDINATIONS, Bid, auction, make_coordination, sequential

FARM = "miniberry-10"
robot = partial(report, farm=FARM, steps=40.0)


class Rows:
    """Bids for the row that is worth most, of rows that one vehicle can see."""

    def __init__(self, worth):
        self.worth = np.asarray(worth)  # [vehicle, row]
        self.asked = 0

    def __call__(self, vehicle, promised):
        self.asked += 1
        left = self.worth[vehicle.system_id - 1].copy()
        for number, path in promised.items():
            if number != vehicle.system_id:
                left[int(path[0, 0])] = 0.0
        best = int(left.argmax())
        return Bid(np.array([[float(best), 0.0]]), float(left[best]), 0.5) if left[best] > 0.0 else None

    def total(self, chosen):
        return sum(self.worth[number - 1, int(path[0, 0])] for number, path in chosen.items())


WORTH = st.lists(st.integers(1, 50), min_size=5, max_size=5)
REACHED = st.lists(st.lists(st.booleans(), min_size=5, max_size=5), min_size=1, max_size=4)


@pytest.mark.parametrize("coordination", COORDINATIONS.values(), ids=COORDINATIONS)
@given(worth=WORTH, reached=REACHED)
@settings(max_examples=40, deadline=None)
def test_no_two_fly_the_same_and_half_of_the_best_is_certain(coordination, worth, reached):
    """A row is worth the same to each vehicle that reaches it."""
    rows = Rows(np.where(reached, worth, 0))
    vehicles = [robot(number) for number in range(1, len(reached) + 1)]
    chosen = coordination(vehicles, {}, rows)
    taken = [int(path[0, 0]) for path in chosen.values()]
    assert len(set(taken)) == len(taken)
    best = max(
        sum(row[k] for row, k in zip(rows.worth, order, strict=True))
        for order in itertools.permutations(range(5), len(reached))
    )
    assert rows.total(chosen) >= 0.5 * best


def test_the_auction_sells_to_who_makes_most_of_it():
    rows = Rows([[10.0, 9.0], [30.0, 1.0]])
    vehicles = [robot(1), robot(2)]
    assert rows.total(sequential(vehicles, {}, rows)) == 11.0
    assert rows.total(auction(vehicles, {}, rows)) == 39.0
    # Only the bid that would win is made anew.
    rows = Rows(np.diag([5.0, 4.0, 3.0]) + 1.0)
    rows.asked = 0
    auction([robot(1), robot(2), robot(3)], {}, rows)
    assert rows.asked <= 6


def test_what_others_fly_is_promised():
    rows = Rows([[10.0, 9.0], [10.0, 9.0]])
    present = {2: np.array([[0.0, 0.0]])}
    for coordination in (sequential, auction):
        assert coordination([robot(1)], present, rows)[1][0, 0] == 1.0
    nothing = Rows([[0.0, 0.0]])
    for coordination in (sequential, auction):
        assert coordination([robot(1)], {}, nothing) == {}


def test_policies_take_a_coordination():
    with pytest.raises(ParameterError, match="coordination 'barter': give sequential or auction"):
        make_coordination("barter")
    assert make_coordination(auction) is auction
    for name in COORDINATIONS:
        policy = Greedy(coordination=name)
        policy.start()
        paths = policy.decide(observation(robot(1), robot(2), robot(3), farm=FARM)).paths
        assert sorted(paths) == [1, 2, 3]
        assert len({tuple(map(tuple, path.tolist())) for path in paths.values()}) == 3
    # A vehicle whose new path is still on its way to it has promised that path.
    changing = robot(1, status=Status.CHANGING, rest=paths[1])
    policy.start()
    other = policy.decide(observation(changing, robot(2), farm=FARM, event=Event.PERIOD)).paths
    assert set(other) == {2} and other[2].tolist() != paths[1].tolist()
