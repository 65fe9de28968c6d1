"""What the parts of a mission would take as flights of their own, roughly, and the cheapest of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mission.course import Course, Place
from mission.model import GeoPoint
from mission.planners.path import Points
from mission.sorties import resumed_at
from sim_vehicle.prediction.battery_swaps import TrialFlights
from wbf_mission.planning.budget import leg_fares
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.conditions import wind_of

__all__ = ["Choice", "SortieCosts"]

_PROBES = 9
_PLACES = 300
_CLOSEST_M = 5.0
# A cut in the midst of a leg has to save so much: the images of a row are better of one flight.
_MIDST_S = 1.0
_MOST_SORTIES = 200
Line = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Choice:
    """Which sorties are flown: between which of the places, and from which of the homes."""

    ends: tuple[int, ...]
    homes: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SortieCosts:
    """What a sortie from any of some places to any later one takes, from each home.

    Parameters
    ----------
    places : tuple
        Where a sortie may begin or end, in their order; None is the mission's end.
    seconds, watt_hours : float64[h, n, n]
        From each of h homes, by the places where it begins and ends.
    midst : bool[n]
        Which places lie in the midst of a leg.
    """

    places: tuple[Place | None, ...]
    seconds: NDArray[np.float64]
    watt_hours: NDArray[np.float64]
    midst: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        course: Course,
        builder: MissionBuilder,
        *,
        begin: Place,
        homes: Sequence[GeoPoint],
        overlap_m: float,
    ) -> SortieCosts | None:
        """Return the costs of the parts of a course from a place on; None if it cannot be flown.

        The whole is flown once, and the ways to and home from a few of its positions; those from others are
        taken to grow with how long they take straight on in the mean wind.
        """
        wind = wind_of(builder.weather, builder.level)
        trials = TrialFlights(course.mission, builder.priced_vehicle, course.frame, wind)
        flown = trials.fly(course.mission.items)
        if flown is None:
            return None
        way_m = np.maximum.accumulate(course.along(flown.seq, flown.place_m[:, 0], flown.place_m[:, 1]))
        count = int(np.searchsorted(way_m, course.length_m)) + 1  # what follows is the way home
        way_m, place_m = way_m[:count], flown.place_m[:count]
        frame = builder.farm.frame
        track_m = np.column_stack(frame.from_wgs84(*course.frame.to_wgs84(place_m[:, 0], place_m[:, 1])))

        def at(metres: NDArray[np.float64]) -> Points:
            return np.column_stack([np.interp(metres, way_m, axis) for axis in track_m.T])

        straight_s = leg_fares(builder).legs
        stands = np.array([(home.latitude_deg, home.longitude_deg) for home in homes])
        homes_m = np.column_stack(frame.from_wgs84(*stands.T))
        from_m = np.column_stack(frame.from_wgs84(course.frame.latitude_deg, course.frame.longitude_deg))
        probes, there = [], np.linspace(_first_m(course), course.length_m, _PROBES)
        for k in np.minimum(np.searchsorted(way_m, there), count - 1).tolist():
            transit = trials.there_and_back(flown.place_m[k], int(flown.seq[k]))
            if transit is None:
                return None
            probes.append((transit.out_s, transit.out_wh, transit.back_s, transit.back_wh))
        found = np.array(probes)
        lines = [
            _line(straight_s(*ways).ravel(), found[:, k])
            for k, ways in enumerate(((from_m, at(there)),) * 2 + ((at(there), from_m),) * 2)
        ]
        places = _places(course, begin, overlap_m)
        begins = [resumed_at(course, place, overlap_m) if place is not None else None for place in places]
        begin_m = np.array([course.length_m if one is None else course.metres(one) for one in begins])
        end_m = np.array([_end_m(course, place) for place in places])
        out, back = straight_s(homes_m, at(begin_m)), straight_s(at(end_m), homes_m).T
        seconds, watt_hours = (
            (there_line[0] + there_line[1] * out)[:, :, None]
            + (np.interp(end_m, way_m, spent)[None, :] - np.interp(begin_m, way_m, spent)[:, None])[None]
            + (home_line[0] + home_line[1] * back)[:, None, :]
            for spent, there_line, home_line in (
                (flown.time_s[:count], lines[0], lines[2]),
                (flown.energy_wh[:count], lines[1], lines[3]),
            )
        )
        midst = np.array([one is not None and one.fraction > 0.0 for one in places])
        return cls(tuple(places), seconds, watt_hours, midst)

    def charged(self, charge: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the energy of all sorties, times what is charged at the places where they begin and end."""
        return self.watt_hours * (0.5 * (charge[:, None] + charge[None, :]))

    def cheapest(self, most_wh: float, charge: NDArray[np.float64]) -> Choice | None:
        """Return the fewest sorties of at most so much energy, and of these the fastest; None without any.

        What they take is `charged`, float64[n].
        """
        seconds = np.where(self.charged(charge) <= most_wh, self.seconds + _MIDST_S * self.midst, np.inf)
        later = np.triu(np.ones(seconds.shape[1:], dtype=np.bool_), 1)
        cost, homes = np.where(later, seconds.min(axis=0), np.inf), seconds.argmin(axis=0)
        least = np.full(len(self.places), np.inf)
        least[0] = 0.0
        came_from: list[NDArray[np.int64]] = []
        while np.isinf(least[-1]):
            if len(came_from) == _MOST_SORTIES or np.isinf(least).all():
                return None
            total = least[:, None] + cost
            came_from.append(total.argmin(axis=0))
            least = total.min(axis=0)
        ends = [len(self.places) - 1]
        for before in reversed(came_from):
            ends.insert(0, int(before[ends[0]]))
        return Choice(tuple(ends), tuple(int(homes[first, last]) for first, last in pairwise(ends)))


def _places(course: Course, begin: Place, overlap_m: float) -> list[Place | None]:
    """Return where a sortie may begin or end: beginnings of legs, and places on them; None is the end."""
    working_m = sum(float(course.lengths_m[k]) for k, leg in enumerate(course.legs) if leg.works)
    step_m = max(working_m / _PLACES, overlap_m, _CLOSEST_M)
    first = course.after(begin)
    places: list[Place | None] = [begin]
    last_m = course.metres(begin if first is None else first)
    for k, leg in enumerate(course.legs):
        pieces = max(1, int(course.lengths_m[k] / step_m)) if leg.straight else 1
        for piece in range(pieces if leg.works else 0):
            place = Place(leg.item, piece / pieces)
            metres = course.metres(place)
            if first is not None and place > first and metres >= last_m + 0.5 * step_m:
                places.append(place)
                last_m = metres
    return [*places, None]


def _first_m(course: Course) -> float:
    """Return where the work begins, in metres of the way."""
    first = course.after(course.start)
    return 0.0 if first is None else course.metres(first)


def _end_m(course: Course, place: Place | None) -> float:
    """Return how much of the way is flown by a sortie that ends at a place."""
    if place is None:
        return course.length_m
    number = course.leg_of(place)
    while place.fraction == 0.0 and number > 1 and not course.legs[number - 1].works:
        number -= 1
        place = Place(course.legs[number].item)
    return course.metres(place)


def _line(straight_s: NDArray[np.float64], found: NDArray[np.float64]) -> Line:
    """Return base and rate of what ways take, by how long they take straight on (least squares)."""
    known = np.column_stack((np.ones_like(straight_s), straight_s))
    base, rate = np.linalg.lstsq(known, found, rcond=None)[0]
    return (float(base), float(rate)) if rate > 0.0 else (float(found.mean()), 0.0)
