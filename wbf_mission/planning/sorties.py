"""Cuts a mission that needs more than one battery into the fewest and fastest sorties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.texts import distance
from mission.course import Course, Place, unrolled
from mission.errors import PlanningError
from mission.model import GeoPoint, Mission
from mission.planners.build import TOLERANCE_M
from mission.planners.path import Points
from mission.sorties import Way, image_spacing_m, part_of, resumed_at
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.prediction.battery_swaps import TrialFlights
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.planning.budget import leg_costs
from wbf_mission.planning.builder import MissionBuilder, PlanResult, home_of, positions_of
from wbf_mission.planning.conditions import wind_of
from wbf_mission.scenario.parts import VehicleParts

CHANGE_S = 180.0
"""Default duration of a battery change (s)."""
_IMAGES = 2
"""Number of image spacings that a resumed sortie flies again."""
_HOLD_S = 2.0
_TRIES = 12
_SPARE = 1.003
_PROBES = 25
_PLACES = 300
_CLOSEST_M = 5.0
# Least saving (s) for which a leg is cut, because images of one row are better taken in one flight.
_MIDST_S = 1.0
_MOST_SORTIES = 200


class UncutError(PlanningError):
    """A mission that cannot be cut into sorties, with the reason."""


@dataclass(frozen=True, slots=True)
class PlannedSortie:
    """One sortie of a mission."""

    begin: Place
    """Start of the sortie on the whole mission; the overlap that is flown again lies before it."""
    end: Place | None
    """End of the sortie on the whole mission, or None for the mission's end."""
    plan: PlanResult

    def summary(self, course: Course) -> dict[str, Any]:
        """Return the sortie as plain values for JSON."""
        home = self.plan.mission.home
        return {
            **{
                name: None
                if place is None
                else {"item": place.item, "fraction": place.fraction, "at_m": course.metres(place)}
                for name, place in (("begin", self.begin), ("end", self.end))
            },
            "home": None if home is None else [home.latitude_deg, home.longitude_deg],
            "items": len(self.plan.mission.items),
            "length_m": self.plan.length_m,
            "predicted_time_s": self.plan.prediction.duration_s,
            "predicted_energy_wh": self.plan.prediction.energy_wh,
            "energy_bound_wh": self.plan.prediction.most_wh,
            "battery_used": self.plan.battery_used,
        }


@dataclass(frozen=True, slots=True)
class SortiePlan:
    """A mission cut into sorties; each sortie needs at most a battery less its reserve."""

    whole: PlanResult
    course: Course
    sorties: tuple[PlannedSortie, ...]
    change_s: float
    overlap_m: float
    full: float

    @property
    def plans(self) -> tuple[PlanResult, ...]:
        """The plan of each sortie."""
        return tuple(sortie.plan for sortie in self.sorties)

    @property
    def flight_s(self) -> float:
        """Flight time of all sorties (s)."""
        return sum(plan.prediction.duration_s for plan in self.plans)

    @property
    def total_s(self) -> float:
        """Flight time of all sorties, with the battery changes between them (s)."""
        return self.flight_s + self.change_s * (len(self.sorties) - 1)

    def told(self) -> str:
        """Return a line with the number and duration of the sorties."""
        minutes = " + ".join(f"{plan.prediction.duration_s / 60.0:.0f}" for plan in self.plans)
        return f"longer than a battery: {len(self.sorties)} sorties of {minutes} min"

    def summary(self) -> dict[str, Any]:
        """Return a plan's plain values for JSON, with totals over the sorties."""
        predictions = [plan.prediction for plan in self.plans]
        whole = {**self.whole.summary(), "reason": "", "feasible": True, "batteries": len(self.sorties)}
        warnings = dict.fromkeys(text for plan in self.plans for text in plan.warnings)
        return {
            **whole,
            "warnings": list(warnings),
            "length_m": sum(plan.length_m for plan in self.plans),
            "predicted_time_s": self.flight_s,
            "predicted_time_interval_s": None,
            "predicted_energy_wh": sum(prediction.energy_wh for prediction in predictions),
            "predicted_energy_interval_wh": None,
            "battery_used": max(plan.battery_used or 0.0 for plan in self.plans),
            "time_with_changes_s": self.total_s,
            "sorties": [sortie.summary(self.course) for sortie in self.sorties],
        }


def cut_plan(
    whole: PlanResult,
    builder: MissionBuilder,
    *,
    footprint: int,
    begin: Place | None = None,
    homes: Sequence[GeoPoint] = (),
    overlap_m: float | None = None,
    change_s: float = CHANGE_S,
    full: float = 1.0,
) -> SortiePlan:
    """Cut a mission into as few sorties as batteries allow; of such cuts, return the fastest.

    A quick model estimates the cost of each part of the mission, from one prediction of the whole mission and
    of the flights between home and a few positions. Dynamic programming finds the best cuts at leg ends and
    on legs. Each sortie is then predicted in full, like any plan. If a sortie's energy bound exceeds a
    battery less its reserve, the estimates are scaled up and the mission is cut again.

    Parameters
    ----------
    whole : PlanResult
        Plan of the whole mission; jumps in the mission are unrolled.
    builder : MissionBuilder
        Builder of the vehicle.
    footprint : int
        Side of an image, in cells.
    begin : Place, optional
        Start of the first sortie; the part of the mission before it has been flown already.
    homes : sequence of GeoPoint, optional
        Possible take-off positions; by default, only the mission's home. A sortie lands where it took off.
    overlap_m : float, optional
        Overlap of two successive sorties (m, see `mission.sorties.part_of`); by default that of `overlap_of`.
    change_s : float
        Duration of a battery change (s).
    full : float
        Charge of an inserted battery, as a fraction of its capacity.

    Raises
    ------
    UncutError
        If a position is too far away or unreachable, or `homes` differ in height for a plan over terrain.
    MissionError
        If the mission cannot be cut, or nothing remains to be flown.
    """
    own_home = home_of(whole.mission, builder.farm)
    if homes and builder.ground is not None:
        stands = np.array([(home.latitude_deg, home.longitude_deg) for home in (own_home, *homes)])
        if (differ_m := float(np.ptp(builder.ground.ground.heights(*stands.T)))) > TOLERANCE_M:
            raise UncutError(
                "the plan's heights over the terrain count from the mission's home, but the ground at"
                f" the take-off places differs by {differ_m:.1f} m; take off where it is as high as at home"
            )
    placed = replace(whole.mission, home=own_home)
    whole = replace(whole, mission=unrolled(placed))
    course = Course(whole.mission)
    overlap = overlap_of(builder, whole) if overlap_m is None else overlap_m
    homes = homes or [own_home]
    cutter = _Cutter(whole, builder, course, begin or course.start, homes, overlap, footprint, full)
    return SortiePlan(whole, course, cutter.cut(), change_s, overlap, full)


def rest_of(cut: SortiePlan, builder: MissionBuilder, begin: Place) -> Mission:
    """Return the rest of a mission after `begin`; it takes off and lands at home."""
    home = home_of(cut.whole.mission, builder.farm)
    cutter = _Cutter(cut.whole, builder, cut.course, begin, [home], cut.overlap_m, 1)
    return cutter.mission((begin, None, 0))


def sorties_of(whole: PlanResult, one: VehicleParts, **how: Any) -> SortiePlan:
    """Cut the mission of one vehicle of a run; `how` goes to `cut_plan`."""
    return cut_plan(whole, MissionBuilder.of(one, whole.farm), footprint=one.camera.footprint, **how)


def overlap_of(builder: MissionBuilder, whole: PlanResult) -> float:
    """Return the overlap of a resumed sortie (m): two image spacings plus the way to line up with the leg."""
    spacing = image_spacing_m(whole.mission, builder.level.speed_m_s)
    # The vehicle passes the end of one sortie and the start of the next within the acceptance radius.
    line_up_m = 2.0 * builder.cornering.radius_m
    if builder.vehicle.circles:
        law = fixed_wing_procedures(builder.vehicle).limits(builder.vehicle)
        line_up_m = max(2.0 * abs(law.loiter_radius), line_up_m)
    return _IMAGES * (builder.image_spacing_m if spacing is None else spacing) + line_up_m


def _way_of(builder: MissionBuilder) -> Way | None:
    """Return a function that finds a leg's detour points round obstacles, or None without obstacles."""
    keep_out, frame = builder.keep_out, builder.farm.frame
    if keep_out is None:
        return None

    def way(begin: tuple[float, float], end: tuple[float, float]) -> list[tuple[float, float]]:
        points = np.column_stack(frame.from_wgs84(*np.array([begin, end]).T))
        between = keep_out.around(points)[0][1:-1]
        latitude, longitude = frame.to_wgs84(between[:, 0], between[:, 1])
        return list(zip(latitude.tolist(), longitude.tolist(), strict=True))

    return way


Flown: TypeAlias = "tuple[Place, Place | None, int]"
"""Start and end of a sortie, and the index of its home."""


@dataclass(slots=True)
class _Cutter:
    """Cuts one mission."""

    whole: PlanResult
    builder: MissionBuilder
    course: Course
    begin: Place
    homes: Sequence[GeoPoint]
    overlap_m: float
    footprint: int
    full: float = 1.0
    _predicted: dict[Flown, tuple[Mission, Prediction]] = field(default_factory=dict)

    def cut(self) -> tuple[PlannedSortie, ...]:
        """Return the sorties; raise UncutError if no number of batteries is enough."""
        battery = self.builder.vehicle.battery
        if battery is None:
            name = self.builder.vehicle.name
            raise UncutError(f"vehicle {name} has no battery, so its missions are not cut into sorties")
        costs = SortieCosts.of(
            self.course, self.builder, begin=self.begin, homes=self.homes, overlap_m=self.overlap_m
        )
        if costs is None:
            msg = "no sorties: the vehicle cannot fly the mission, or cannot return home from all positions"
            raise UncutError(msg)
        usable_wh = battery.capacity_wh * (self.full - battery.reserve_fraction)
        charge = np.ones(len(costs.places))
        for number in range(_TRIES):
            choice = costs.cheapest(usable_wh, charge)
            if choice is None:
                raise UncutError(self._too_dear(costs, charge, usable_wh))
            flown = [
                (costs.places[first] or self.begin, costs.places[last], home)
                for (first, last), home in zip(pairwise(choice.ends), choice.homes, strict=True)
            ]
            takes_wh = self._priced(flown) if number == 0 else [self._full(one).most_wh for one in flown]
            if number > 0 and all(
                self._full(one).feasible and most <= usable_wh
                for one, most in zip(flown, takes_wh, strict=True)
            ):
                return tuple(map(self._planned, flown))
            # Each place is charged with the predicted energy of its sortie, divided by the estimated energy.
            charge = np.ones(len(costs.places))
            for (first, last), home, takes in zip(pairwise(choice.ends), choice.homes, takes_wh, strict=True):
                charge[first:last] = takes / costs.watt_hours[home, first, last]
            charge *= _SPARE**number
        msg = f"no sorties: all {_TRIES} cuts that were tried have a sortie that needs more than a battery"
        raise UncutError(msg)

    def _too_dear(self, costs: SortieCosts, charge: NDArray[np.float64], usable_wh: float) -> str:
        """Return why no cut is possible: a place is too far from home, or too many sorties are needed."""
        shortest = np.arange(len(costs.places) - 1)
        takes_wh = costs.charged(charge)[:, shortest, shortest + 1].min(axis=0)
        dearest = int(takes_wh.argmax())
        if takes_wh[dearest] <= usable_wh:
            return f"no sorties: the mission takes more than {_MOST_SORTIES} batteries"
        place = costs.places[dearest] or self.begin
        frame = self.builder.farm.frame
        stands = np.array([(home.latitude_deg, home.longitude_deg) for home in self.homes])
        x, y = frame.from_wgs84(*self.course.position(place)[:2])
        home_x, home_y = frame.from_wgs84(*stands.T)
        away_m = float(np.hypot(home_x - x, home_y - y).min())
        return (
            f"no sorties: to fly {distance(away_m)} from the take-off place to {place} and back takes"
            f" {takes_wh[dearest]:.1f} Wh, but a battery has {usable_wh:.1f} Wh above its reserve; take off"
            " nearer to this place"
        )

    def _priced(self, flown: Sequence[Flown]) -> list[float]:
        """Estimate the sorties' energy bounds: price times the dearest sortie's ratio of bound to price."""
        prices = [one.energy_wh for one in self.builder.price([self.mission(one) for one in flown])]
        dearest = max(range(len(prices)), key=prices.__getitem__)
        more = self._full(flown[dearest]).most_wh / prices[dearest]
        return [price * more for price in prices]

    def mission(self, flown: Flown) -> Mission:
        """Return the mission of a sortie."""
        begin, end, home = flown
        return part_of(
            self.course,
            begin,
            end,
            overlap_m=self.overlap_m,
            hold_s=_HOLD_S if self.builder.vehicle.hovers else 0.0,
            home=self.homes[home],
            way=_way_of(self.builder),
            speed_m_s=self.builder.level.speed_m_s,
        )

    def _full(self, flown: Flown) -> Prediction:
        """Return the full prediction of a sortie."""
        if flown not in self._predicted:
            mission = self.mission(flown)
            self._predicted[flown] = mission, self.builder.predict(mission)
        return self._predicted[flown][1]

    def _planned(self, flown: Flown) -> PlannedSortie:
        whole, (mission, prediction) = self.whole, self._predicted[flown]
        plan = self.builder.plan_of(
            mission,
            positions_of(mission, whole.farm),
            planner=whole.planner,
            seed=whole.seed,
            budget_text=whole.budget_text,
            footprint=self.footprint,
            spacing_m=whole.spacing_m,
            prediction=prediction,
        )
        return PlannedSortie(flown[0], flown[1], plan)


@dataclass(frozen=True, slots=True)
class _Cut:
    """A cut: indices of the places at which sorties begin and end, and the index of each sortie's home."""

    ends: tuple[int, ...]
    homes: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SortieCosts:
    """Costs of a sortie between any two places, from each home.

    Parameters
    ----------
    places : tuple
        Possible starts and ends of sorties, in order; None is the mission's end.
    seconds, watt_hours : float64[h, n, n]
        Costs of a sortie from each of h homes, by the sortie's start and end.
    midst : bool[n]
        Whether the place is on a leg, and not at the leg's start.
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
        """Return the costs of all sorties on a course from `begin` on, or None if the course cannot be flown.

        The whole course is predicted once. The flights out to a position and back home are predicted for some
        positions; at other positions, the costs are interpolated by straight-line time in the mean wind.
        """
        wind = wind_of(builder.weather, builder.level)
        trials = TrialFlights(course.mission, builder.priced_vehicle, course.frame, wind)
        flown = trials.fly(course.mission.items)
        if flown is None:
            return None
        way_m = np.maximum.accumulate(course.along(flown.seq, flown.place_m[:, 0], flown.place_m[:, 1]))
        count = int(np.searchsorted(way_m[:-1], course.length_m)) + 1  # The rest is the flight home
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
        begin_m = np.array([course.length_m if place is None else course.metres(place) for place in begins])
        end_m = np.array([_end_m(course, place) for place in places])
        # The probes are evenly spread from the shortest to the longest straight-line time.
        ranks = np.unique(np.linspace(0, len(end_m) - 1, _PROBES).astype(np.int64))
        probed_m = end_m[np.argsort(straight_s(from_m, at(end_m)).ravel(), kind="stable")[ranks]]
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
            return ways + (at_end[None, :] - at_begin[:, None])[None] + homes

        seconds = parts(flown.time_s, [t.out_s for t in transits], [t.back_s for t in transits], 1.0)
        watt_hours = parts(
            flown.energy_wh, [t.out_wh for t in transits], [t.back_wh for t in transits], a_second_wh
        )
        midst = np.array([one is not None and one.fraction > 0.0 for one in places])
        return cls(tuple(places), seconds, watt_hours, midst)

    def charged(self, charge: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each sortie's energy, multiplied by the mean `charge` of the places on the sortie."""
        before, number = np.concatenate(([0.0], np.cumsum(charge[:-1]))), np.arange(len(charge))
        places = np.maximum(number[None, :] - number[:, None], 1)
        return self.watt_hours * ((before[None, :] - before[:, None]) / places)

    def cheapest(self, most_wh: float, charge: NDArray[np.float64]) -> _Cut | None:
        """Return the fastest cut into the fewest sorties of at most `most_wh`; None if there is no such cut.

        `charge`, float64[n], multiplies the energy from each place to the next; its last entry is not used.
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
        return _Cut(tuple(ends), tuple(int(homes[first, last]) for first, last in pairwise(ends)))


def _places(course: Course, begin: Place, overlap_m: float) -> list[Place | None]:
    """Return the possible starts and ends of sorties: leg starts and places on legs; None: mission's end."""
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
    """Return the distance along the course (m) at which a sortie that ends at `place` turns home."""
    if place is None:
        return course.length_m
    number = course.leg_of(place)
    while place.fraction == 0.0 and number > 1 and not course.legs[number - 1].works:
        number -= 1
        place = Place(course.legs[number].item)
    return course.metres(place)


def _interpolated(
    straight_s: NDArray[np.float64], known_s: NDArray[np.float64], takes: list[float], beyond: float
) -> NDArray[np.float64]:
    """Interpolate the costs of flights by straight-line time; after the longest, a second costs `beyond`.

    The interpolation is linear, since return altitudes change in steps with the distance from home.
    """
    order = np.argsort(known_s, kind="stable")
    farther: NDArray[np.float64] = np.maximum(straight_s - known_s[order[-1]], 0.0)
    within: NDArray[np.float64] = np.interp(straight_s, known_s[order], np.array(takes)[order])
    return within + beyond * farther
