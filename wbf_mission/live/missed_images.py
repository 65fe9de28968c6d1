"""How many images a camera beside a vehicle could not take while nothing was heard of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

from mission.ground.change import apart_m, is_return
from mission.model import Mission
from wbf_mission.live.mission_shots import Shots, shots_before

__all__ = ["Silence", "images_in"]


@dataclass(frozen=True, slots=True)
class Silence:
    """A vehicle before and after a time in which nothing was heard of it.

    Parameters
    ----------
    before, after : tuple of float
        Latitude and longitude, in degrees.
    item : int
        Of the mission, that was flown before; -1 if none was.
    seconds : float
    shots : Shots
        What the camera did before.
    """

    before: tuple[float, float]
    after: tuple[float, float]
    item: int
    seconds: float
    shots: Shots


def images_in(silence: Silence, mission: Mission, item: int) -> int:
    """Return about how many images the mission orders on the way that nobody saw.

    The way goes straight from position to position of the items that were flown; its time is spread evenly
    over its length. Where a mission orders nothing of the camera, it does what it did.

    Parameters
    ----------
    silence : Silence
    mission : Mission
        That was flown.
    item : int
        That is flown after it; from the number of items on, the mission is over.
    """
    first, last = silence.item, min(item, len(mission.items) - 1)
    if first < 0:
        # Outside a mission the camera does what somebody told it.
        return _images([(apart_m(silence.before, silence.after), silence.shots)], silence.seconds)
    legs: list[tuple[float, Shots]] = []
    here = silence.before
    for k in range(first, last + 1):
        one = mission.items[k]
        if not one.has_position or is_return(one):
            continue
        there = (one.x, one.y)
        # Of the leg that is flown now only what lies behind the vehicle.
        length_m = (
            apart_m(here, there) if k < last else min(apart_m(here, silence.after), apart_m(here, there))
        )
        legs.append((length_m, shots_before(mission, k) or silence.shots))
        here = there
    if not legs:
        # It hovers, or another mission has taken the place of the one before.
        legs = [(apart_m(silence.before, silence.after), shots_before(mission, last) or silence.shots)]
    return _images(legs, silence.seconds)


def _images(legs: list[tuple[float, Shots]], seconds: float) -> int:
    """Return how many images are taken on legs of a length each."""
    whole_m = sum(length_m for length_m, _ in legs)
    images = 0.0
    for length_m, shots in legs:
        share = length_m / whole_m if whole_m > 0.0 else 1.0 / len(legs)
        if shots.distance_m > 0.0:
            images += length_m / shots.distance_m
        elif shots.interval_ms > 0.0:
            images += 1000.0 * share * seconds / shots.interval_ms
    return int(images)
