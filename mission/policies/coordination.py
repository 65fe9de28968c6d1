"""Who of a fleet flies where: ways of assigning paths when each vehicle is valued alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from geo.named import ParameterError
from mission.planners.path import Points
from mission.policies.observation import VehicleReport


@dataclass(frozen=True, slots=True, eq=False)
class Bid:
    """The best path of a vehicle, when others fly what they have promised."""

    points_m: Points  # float64[n, 2]: in metres of the farm frame
    value: float  # What it promises, in the policy's own measure
    share: float  # What it costs, as a share of what the vehicle has left: so unlike vehicles can be compared

    @property
    def rate(self) -> float:
        """Value by share of what is left."""
        return self.value / self.share if self.share > 0.0 else float("inf")


Promised: TypeAlias = Mapping[int, Points]
"""Paths of vehicles by their system ids; what they are going to see is worth nothing to the others."""
Bidder: TypeAlias = Callable[[VehicleReport, Promised], Bid | None]
"""Finds a vehicle's best path beside those that are promised; its own present one does not count."""
Coordination: TypeAlias = Callable[[Sequence[VehicleReport], Promised, Bidder], dict[int, Points]]
"""Returns new paths for vehicles, given the present paths of all; those that are not named go on."""


def sequential(vehicles: Sequence[VehicleReport], present: Promised, bidder: Bidder) -> dict[int, Points]:
    """Let vehicles choose in turn.

    Each finds what the others leave: the new paths of those before it, the present ones of those after it.
    Where what is seen once is worth nothing again, the result is worth at least half of the best possible
    (sequential allocation: Singh et al. 2009; Fisher, Nemhauser and Wolsey 1978).
    """
    promised, chosen = dict(present), {}
    for vehicle in vehicles:
        bid = bidder(vehicle, promised)
        if bid is not None:
            promised[vehicle.system_id] = chosen[vehicle.system_id] = bid.points_m
    return chosen


def auction(vehicles: Sequence[VehicleReport], present: Promised, bidder: Bidder) -> dict[int, Points]:
    """Sell paths one after the other to the vehicle that makes most of what it has left.

    Present paths of vehicles that bid are given up. All bid; the best bid by its rate wins and is promised;
    the others bid again. Bids only fall by that, so only a bid that would win has to be made anew (Minoux
    1978). A vehicle without a bid goes on as before. The bound is that of `sequential`, but the order is
    not left to the system ids.
    """
    bidding = {one.system_id: one for one in vehicles}
    promised = {number: path for number, path in present.items() if number not in bidding}
    chosen: dict[int, Points] = {}
    bids: dict[int, tuple[int, Bid]] = {}
    sold = 0
    for number, vehicle in list(bidding.items()):
        bid = bidder(vehicle, promised)
        if bid is not None:
            bids[number] = sold, bid
    while bids:
        number = max(bids, key=lambda one: (bids[one][1].rate, -one))
        asked, bid = bids[number]
        if asked == sold:
            promised[number] = chosen[number] = bid.points_m
            del bids[number]
            sold += 1
            continue
        again = bidder(bidding[number], promised)
        if again is None:
            del bids[number]
        else:
            bids[number] = sold, again
    return chosen


COORDINATIONS: dict[str, Coordination] = {"sequential": sequential, "auction": auction}


def make_coordination(coordination: str | Coordination) -> Coordination:
    """Return a coordination by its name (`COORDINATIONS`), or the callable that was given."""
    if callable(coordination):
        return coordination
    found = COORDINATIONS.get(str(coordination))
    if found is None:
        msg = f"coordination {coordination!r}: give {' or '.join(COORDINATIONS)}"
        raise ParameterError(msg)
    return found
