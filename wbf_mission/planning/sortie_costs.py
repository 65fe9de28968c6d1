"""Approximate costs of a mission's parts as sorties, and the cheapest cut."""

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
from wbf_mission.planning.budget import leg_costs
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.conditions import wind_of

__all__ = ["Choice", "SortieCosts"]

_PROBES = 25
_PLACES = 300
_CLOSEST_M = 5.0
# Least saving (s) of a cut within a leg: images of one row are better from one flight.
_MIDST_S = 1.0
_MOST_SORTIES = 200


@dataclass(frozen=True, slots=True)
class Choice:
    """A cut: place numbers of the sorties' ends, and home number of each sortie."""

    ends: tuple[int, ...]
    homes: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SortieCosts:
    """Costs of the sorties between all pairs of places, from each home.

    Parameters
    ----------
    places : tuple
        Possible ends of sorties, in order; None is the mission's end.
    seconds, watt_hours : float64[h, n, n]
        Costs from each of h homes, by the sortie's start and end.
    midst : bool[n]
        Whether a place is within a leg.
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
        """Return the costs of the parts of a course from `begin`; None if the course cannot be flown.

        The whole course is predicted once, and outbound and return flights at some of its positions. Flights
        at other positions are interpolated by straight-line time in the mean wind.
        """
        wind = wind_of(builder.weather, builder.level)
        trials = TrialFlights(course.mission, builder.priced_vehicle, course.frame, wind)
        flown = trials.fly(course.mission.items)
        if flown is None:
            return None
        way_m = np.maximum.accumulate(course.along(flown.seq, flown.place_m[:, 0], flown.place_m[:, 1]))
        count = int(np.searchsorted(way_m, course.length_m)) + 1  # The flight home follows
        way_m, place_m = way_m[:count], flown.place_m[:count]
        frame = builder.farm.frame
        track_m = np.column_stack(frame.from_wgs84(*course.frame.to_wgs84(place_m[:, 0], place_m[:, 1])))

        def at(metres: NDArray[np.float64]) -> Points:
            return np.column_stack([np.interp(metres, way_m, axis) for axis in track_m.T])

        straight_s = leg_costs(builder).legs
        stands = np.array([(home.latitude_deg, home.longitude_deg) for home in homes])
        homes_m = np.column_stack(frame.from_wgs84(*stands.T))
        from_m = np.column_stack(frame.from_wgs84(course.frame.latitude_deg, course.frame.longitude_deg))
        places = _places(course, begin, overlap_m)
        begins = [resumed_at(course, place, overlap_m) if place is not None else None for place in places]
        begin_m = np.array(
            [course.length_m if begin_place is None else course.metres(begin_place) for begin_place in begins]
        )
        end_m = np.array([_end_m(course, place) for place in places])
        probed_m = _spread(straight_s(from_m, at(end_m)).ravel(), end_m)
        transits = []
        for k in np.minimum(np.searchsorted(way_m, probed_m), count - 1).tolist():
            transit = trials.there_and_back(flown.place_m[k], int(flown.seq[k]))
            if transit is None:
                return None
            transits.append(transit)
        outward, homeward = straight_s(from_m, at(probed_m)).ravel(), straight_s(at(probed_m), from_m).ravel()
        out, back = straight_s(homes_m, at(begin_m)), straight_s(at(end_m), homes_m).T
        a_second_wh = float(flown.energy_wh[count - 1] / flown.time_s[count - 1])

        def parts(
            spent: NDArray[np.float64], there: list[float], home: list[float], beyond: float
        ) -> NDArray[np.float64]:
            at_end, at_begin = (np.interp(metres, way_m, spent[:count]) for metres in (end_m, begin_m))
            ways = _interpolated(out, outward, there, beyond)[:, :, None]
            homes = _interpolated(back, homeward, home, beyond)[:, None, :]
            part: NDArray[np.float64] = ways + (at_end[None, :] - at_begin[:, None])[None] + homes
            return part

        seconds = parts(flown.time_s, [t.out_s for t in transits], [t.back_s for t in transits], 1.0)
        watt_hours = parts(
            flown.energy_wh, [t.out_wh for t in transits], [t.back_wh for t in transits], a_second_wh
        )
        midst = np.array([one is not None and one.fraction > 0.0 for one in places])
        return cls(tuple(places), seconds, watt_hours, midst)

    def charged(self, charge: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the energy of all sorties, times the mean charge factor of the places that each covers."""
        before, number = np.concatenate(([0.0], np.cumsum(charge[:-1]))), np.arange(len(charge))
        places = np.maximum(number[None, :] - number[:, None], 1)
        charged: NDArray[np.float64] = self.watt_hours * ((before[None, :] - before[:, None]) / places)
        return charged

    def cheapest(self, most_wh: float, charge: NDArray[np.float64]) -> Choice | None:
        """Return the fastest of the cuts with the fewest sorties of at most `most_wh`; None without a cut.

        `charge`, float64[n], scales the energy from each place to the next; the last entry is not used.
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
    """Return the possible ends of sorties: starts of legs, and places on legs; None is the mission's end."""
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


def _end_m(course: Course, place: Place | None) -> float:
    """Return the distance along the course (m) that a sortie to `place` has flown."""
    if place is None:
        return course.length_m
    number = course.leg_of(place)
    while place.fraction == 0.0 and number > 1 and not course.legs[number - 1].works:
        number -= 1
        place = Place(course.legs[number].item)
    return course.metres(place)


def _spread(straight_s: NDArray[np.float64], metres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a sample of the places, evenly spaced by rank of straight-line time."""
    ranks = np.unique(np.linspace(0, len(metres) - 1, _PROBES).astype(np.int64))
    chosen: NDArray[np.float64] = metres[np.argsort(straight_s, kind="stable")[ranks]]
    return chosen


def _interpolated(
    straight_s: NDArray[np.float64], known_s: NDArray[np.float64], takes: list[float], beyond: float
) -> NDArray[np.float64]:
    """Return the costs of flights, interpolated by straight-line time and extrapolated at rate `beyond`.

    The interpolation is linear, since return altitudes of autopilots change in steps with distance from home.
    """
    order = np.argsort(known_s, kind="stable")
    farther = np.maximum(straight_s - known_s[order[-1]], 0.0)
    found: NDArray[np.float64] = (
        np.interp(straight_s, known_s[order], np.array(takes)[order]) + beyond * farther
    )
    return found
