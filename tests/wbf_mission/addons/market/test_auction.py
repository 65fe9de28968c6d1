import math

import numpy as np
import pytest

from mission.planners import LengthBudget
from mission.policies.observation import GeometricTravelCost
from wbf_mission.addons.market.auction import Bidder, hold_auction, path_cost
from wbf_mission.addons.market.segments import Row, Segment

HOME = (0.0, 0.0)
FARES = GeometricTravelCost(LengthBudget(1000.0), HOME)


def _strip(number, y, x=(0.0, 10.0)):
    return Segment(number, False, (x[0], y - 1, x[1], y + 1), (Row(np.array([[x[0], y], [x[1], y]]), 0),))


def _bidder(system_id, segments, at, limit=1000.0, takes=None, *, returns=False, until_free=0.0):
    takes = [True] * len(segments) if takes is None else takes
    return Bidder(
        system_id, FARES, segments, takes, np.array(at, float), HOME, until_free, limit, returns=returns
    )


def _flown(bidder, segments, at):
    """Return how long the way of what was awarded is, measured along the path itself."""
    rows = [ends for k, variant in bidder.route for _, ends in segments[k].ordered(variant)]
    return path_cost(FARES, np.vstack((np.array(at, float), *rows)))


def test_each_segment_is_sold_once_and_bids_are_what_is_flown():
    segments = [_strip(k, 2.0 * k) for k in range(8)]
    bidders = [_bidder(1, segments, (0, 0)), _bidder(2, segments, (0, 14))]
    assert hold_auction(bidders, range(8)) == []
    assert sorted(k for one in bidders for k, _ in one.route) == list(range(8))
    for bidder, at in zip(bidders, ((0, 0), (0, 14)), strict=True):
        assert bidder.cost == pytest.approx(_flown(bidder, segments, at))
    assert {k for k, _ in bidders[0].route} == {0, 1, 2, 3}


@pytest.mark.parametrize("returns", [True, False])
def test_nobody_takes_more_than_is_left(returns):
    segments = [_strip(k, 2.0 * k) for k in range(8)]
    bidder = _bidder(1, segments, (0, 0), limit=60.0, returns=returns)
    unsold = hold_auction([bidder], range(8))
    assert unsold and bidder.cost <= 60.0
    way_home = math.hypot(*segments[bidder.route[-1][0]].ordered(bidder.route[-1][1])[-1][1][1])
    assert bidder.cost == pytest.approx(_flown(bidder, segments, (0, 0)) + returns * way_home)


def test_what_a_vehicle_does_not_take_it_does_not_get():
    segments = [_strip(0, 1.0), _strip(1, 3.0)]
    bidders = [_bidder(1, segments, (0, 0), takes=[False, True]), _bidder(2, segments, (90, 90))]
    hold_auction(bidders, range(2))
    assert [k for k, _ in bidders[0].route] == [1] and [k for k, _ in bidders[1].route] == [0]
    alone = [_bidder(1, segments, (0, 0), takes=[False, True])]
    assert hold_auction(alone, range(2)) == [0]


@pytest.mark.parametrize("returns", [True, False])
def test_a_bid_is_what_everything_costs_then(returns):
    segments = [_strip(k, 3.0 * k, (5.0 * (k % 3), 5.0 * (k % 3) + 10.0)) for k in range(7)]
    bidder = _bidder(1, segments, (0, 0), returns=returns, until_free=3.0)
    # Those in the middle are put between others, whose way from one to the next they replace.
    for segment in (0, 6, 3, 1, 5, 2, 4):
        bid = bidder.bid(segment)
        bidder.award(segment, bid)
        assert bidder.cost == pytest.approx(bid.cost)
