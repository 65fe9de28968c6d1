"""A sequential single-item auction of segments among vehicles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission.planners.path import Points
from mission.policies.observation import TravelCost
from wbf_mission.addons.market.segments import VARIANTS, Segment, corners_of

_FREE, _HOME, _FIRST = 0, 1, 2
_CORNERS = 2 * VARIANTS
_AT_ONCE = 16


@dataclass(frozen=True, slots=True)
class Bid:
    """A vehicle's price for a segment: the total cost of the vehicle's work if it gets the segment."""

    cost: float  # In the unit of the vehicle's budget
    # Place of the segment in the vehicle's route, and the corner from which it would be flown.
    position: int
    variant: int


class Bidder:
    """A vehicle that takes part in the auction, with all travel costs that its bids need."""

    def __init__(
        self,
        system_id: int,
        travel_cost: TravelCost,
        segments: Sequence[Segment],
        takes: Sequence[bool],
        free_m: Points,
        home_m: tuple[float, float],
        until_free: float,
        limit: float,
        *,
        returns: bool,
    ) -> None:
        self.system_id = system_id
        nodes = np.vstack((free_m, home_m, corners_of(segments).reshape(-1, 2)))
        # float64[n, n]: travel costs between nodes (place where the vehicle becomes free, home, all corners).
        self.legs = travel_cost.legs(nodes, nodes)
        # Cost of each segment's rows; infinite if the vehicle cannot fly the segment.
        self.own = [
            path_cost(travel_cost, np.concatenate([ends for _, ends in segment.ordered(0)]))
            if take
            else math.inf
            for segment, take in zip(segments, takes, strict=True)
        ]
        self.until_free = until_free  # Cost of the work that the vehicle keeps
        self.limit = limit  # Maximum total cost
        self.returns = returns  # Whether the costs include the return home
        # Awarded segments in order of flight, each as index in the list of segments, and variant.
        self.route: list[tuple[int, int]] = []

    @property
    def cost(self) -> float:
        """Total cost of the vehicle's work."""
        cost, at = self.until_free, _FREE
        for k, variant in self.route:
            cost += float(self.legs[at, _entry(k, variant)] + self.own[k])
            at = _exit(k, variant)
        return cost + self._home(at)

    def bid(self, segment: int) -> Bid | None:
        """Return the bid for the place in the route where the segment costs least; None if unaffordable."""
        if not math.isfinite(self.own[segment]):
            return None
        before, best = self.cost, Bid(math.inf, 0, 0)
        for position in range(len(self.route) + 1):
            at = _exit(*self.route[position - 1]) if position else _FREE
            last = position == len(self.route)
            onward = None if last else _entry(*self.route[position])
            without = self._home(at) if onward is None else float(self.legs[at, onward])
            for variant in range(VARIANTS):
                end = _exit(segment, variant)
                after = self._home(end) if onward is None else float(self.legs[end, onward])
                extra = float(self.legs[at, _entry(segment, variant)] + self.own[segment]) + after - without
                if before + extra < best.cost:
                    best = Bid(before + extra, position, variant)
        return best if best.cost <= self.limit else None

    def award(self, segment: int, bid: Bid) -> None:
        """Insert a segment into the route at the bid's position, flown in the bid's variant."""
        self.route.insert(bid.position, (segment, bid.variant))

    def _home(self, at: int) -> float:
        return float(self.legs[at, _HOME]) if self.returns else 0.0


def hold_auction(bidders: Sequence[Bidder], offered: Iterable[int]) -> list[int]:
    """Award segments one at a time, always by the lowest of all bids; return the unsold segments.

    A bid is the vehicle's total cost, so that all vehicles end with similar costs (rule MiniMax of sequential
    single-item auctions; Lagoudakis et al. 2005, Koenig et al. 2006). Equal bids go to the first bidder.
    """
    left = list(offered)
    bids = [{segment: bidder.bid(segment) for segment in left} for bidder in bidders]
    while True:
        best: tuple[float, int, int] | None = None
        for k, of_bidder in enumerate(bids):
            for segment in left:
                bid = of_bidder[segment]
                if bid is not None and (best is None or bid.cost < best[0]):
                    best = bid.cost, k, segment
        if best is None:
            return left
        _, winner, sold = best
        bid = bids[winner][sold]
        assert bid is not None
        bidders[winner].award(sold, bid)
        left.remove(sold)
        bids[winner] = {segment: bidders[winner].bid(segment) for segment in left}


def path_cost(travel_cost: TravelCost, points_m: Points) -> float:
    """Return the approximate cost of flying through points, starting at the first point."""
    return 0.0 if len(points_m) < 2 else float(leg_costs(travel_cost, points_m).sum())


def leg_costs(travel_cost: TravelCost, points_m: Points) -> NDArray[np.float64]:
    """Return the approximate cost of each leg between consecutive points, float64[n - 1], n > 1."""
    # `legs` computes the costs of all pairs of points; blocks keep the number of pairs small.
    begins, ends = points_m[:-1], points_m[1:]
    parts = [
        np.diagonal(travel_cost.legs(begins[k : k + _AT_ONCE], ends[k : k + _AT_ONCE]))
        for k in range(0, len(begins), _AT_ONCE)
    ]
    return np.concatenate(parts)


def _entry(segment: int, variant: int) -> int:
    return _FIRST + segment * _CORNERS + variant


def _exit(segment: int, variant: int) -> int:
    return _FIRST + segment * _CORNERS + VARIANTS + variant
