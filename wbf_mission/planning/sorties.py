"""Cuts a mission beyond one battery into sorties, at least cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mission.course import Course, Place, unrolled
from mission.model import GeoPoint, Mission
from mission.sorties import Way, image_spacing_m, part_of
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.planning.builder import MissionBuilder, PlanResult, home_of
from wbf_mission.planning.mission_file import positions_of
from wbf_mission.planning.sortie_costs import Choice, SortieCosts
from wbf_mission.scenario.parts import VehicleParts

__all__ = [
    "CHANGE_S",
    "PlannedSortie",
    "SortiePlan",
    "cut_plan",
    "overlap_of",
    "rest_of",
    "sorties_of",
]

CHANGE_S = 180.0
"""Default duration of a battery change (s)."""
_IMAGES = 2
"""Image spacings that a resumed sortie flies again."""
_HOLD_S = 2.0
_TRIES = 12
_SPARE = 1.003


@dataclass(frozen=True, slots=True)
class PlannedSortie:
    """One sortie of a mission."""

    begin: Place
    """Start of the sortie on the whole mission, without the repeated overlap before it."""
    end: Place | None
    """End of the sortie on the whole mission; None for the mission's end."""
    plan: PlanResult

    def summary(self, course: Course) -> dict[str, Any]:
        """Return plain values for JSON."""
        ends = {"begin": self.begin, "end": self.end}
        home = self.plan.mission.home
        return {
            **{
                name: None
                if place is None
                else {"item": place.item, "fraction": place.fraction, "at_m": course.metres(place)}
                for name, place in ends.items()
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
    """A mission in sorties, each within a battery less its reserve."""

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
        """Flight time with battery changes (s)."""
        return self.flight_s + self.change_s * (len(self.sorties) - 1)

    def told(self) -> str:
        """Return a line with the number and duration of the sorties."""
        minutes = " + ".join(f"{plan.prediction.duration_s / 60.0:.0f}" for plan in self.plans)
        return f"longer than a battery: {len(self.sorties)} sorties of {minutes} min"

    def summary(self) -> dict[str, Any]:
        """Return a plan's plain values for JSON, with totals over the sorties."""
        predictions = [plan.prediction for plan in self.plans]
        whole = self.whole.summary()
        told = {"reason": "", "feasible": True, "batteries": len(self.sorties)}
        warnings = dict.fromkeys(text for plan in self.plans for text in plan.warnings)
        return {
            **whole,
            **told,
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
) -> SortiePlan | None:
    """Cut a mission into the fewest sorties that batteries allow, and of these the fastest.

    A quick model estimates the cost of each part: the whole mission is flown once, with outbound and return
    flights at a few positions. Dynamic programming finds the best cuts at leg ends and on legs. Each sortie
    is then predicted in full, as any plan. If the upper bound of a sortie exceeds a battery less its reserve,
    the estimates are scaled up and the mission is cut again.

    Parameters
    ----------
    whole : PlanResult
        Plan of the whole mission; jumps in the mission are unrolled.
    builder : MissionBuilder
        Builder of the vehicle.
    footprint : int
        Side of an image, in cells.
    begin : Place, optional
        Start of the first sortie; the mission before it is flown already.
    homes : sequence of GeoPoint, optional
        Take-off positions, by default the mission's home. A sortie lands where it took off.
    overlap_m : float, optional
        See `mission.sorties.part_of`; by default `overlap_of` decides.
    change_s : float
        Duration of a battery change (s).
    full : float
        Charge of an inserted battery, as a fraction of its capacity.

    Returns
    -------
    SortiePlan or None
        None if no number of batteries is enough: a position is too far away or unreachable.

    Raises
    ------
    MissionError
        If the mission cannot be cut, or nothing remains to be flown.
    """
    placed = replace(whole.mission, home=home_of(whole.mission, builder.farm))
    whole = replace(whole, mission=unrolled(placed))
    course = Course(whole.mission)
    overlap = overlap_of(builder, whole) if overlap_m is None else overlap_m
    homes = homes or [home_of(placed, builder.farm)]
    cutter = _Cutter(whole, builder, course, begin or course.start, homes, overlap, footprint, full)
    sorties = cutter.cut()
    return None if sorties is None else SortiePlan(whole, course, sorties, change_s, overlap, full)


def rest_of(cut: SortiePlan, builder: MissionBuilder, begin: Place) -> Mission:
    """Return the rest of a mission from `begin`, as a mission that takes off and lands at home."""
    home = home_of(cut.whole.mission, builder.farm)
    cutter = _Cutter(cut.whole, builder, cut.course, begin, [home], cut.overlap_m, 1)
    return cutter.mission((begin, None, 0))


def sorties_of(whole: PlanResult, one: VehicleParts, **how: Any) -> SortiePlan | None:
    """Cut the mission of one vehicle of a run; `how` are options of `cut_plan`."""
    return cut_plan(whole, MissionBuilder.of(one, whole.farm), footprint=one.camera.footprint, **how)


def overlap_of(builder: MissionBuilder, whole: PlanResult) -> float:
    """Return the overlap of a resumed sortie (m): two image spacings and the distance to line up."""
    spacing = image_spacing_m(whole.mission, builder.level.speed_m_s)
    # The end of the last sortie and the start of the next are each passed within the acceptance radius.
    line_up_m = 2.0 * builder.cornering.radius_m
    if builder.vehicle.circles:
        law = fixed_wing_procedures(builder.vehicle).limits(builder.vehicle)
        line_up_m = max(2.0 * abs(law.loiter_radius), line_up_m)
    return _IMAGES * (builder.image_spacing_m if spacing is None else spacing) + line_up_m


def _way_of(builder: MissionBuilder) -> Way | None:
    """Return a function that finds the points around obstacles; None without obstacles."""
    keep_out, frame = builder.keep_out, builder.farm.frame
    if keep_out is None:
        return None

    def way(begin: tuple[float, float], end: tuple[float, float]) -> list[tuple[float, float]]:
        ends = np.array([begin, end])
        points = np.column_stack(frame.from_wgs84(ends[:, 0], ends[:, 1]))
        between = keep_out.around(points)[0][1:-1]
        latitude, longitude = frame.to_wgs84(between[:, 0], between[:, 1])
        return list(zip(latitude.tolist(), longitude.tolist(), strict=True))

    return way


Flown: TypeAlias = "tuple[Place, Place | None, int]"
"""Start, end and home number of a sortie."""


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

    def cut(self) -> tuple[PlannedSortie, ...] | None:
        """Return the sorties; None if no number of batteries is enough."""
        battery = self.builder.vehicle.battery
        costs = None
        if battery is not None:
            costs = SortieCosts.of(
                self.course, self.builder, begin=self.begin, homes=self.homes, overlap_m=self.overlap_m
            )
        if battery is None or costs is None:
            return None
        usable_wh = battery.capacity_wh * (self.full - battery.reserve_fraction)
        best: list[Flown] | None = None
        charge = np.ones(len(costs.places))
        for number in range(_TRIES):
            choice = costs.cheapest(usable_wh, charge)
            if choice is None:
                break
            flown = [
                (costs.places[first] or self.begin, costs.places[last], home)
                for (first, last), home in zip(pairwise(choice.ends), choice.homes, strict=True)
            ]
            takes_wh = self._priced(flown) if number == 0 else [self._full(one).most_wh for one in flown]
            if number > 0 and all(
                self._full(one).feasible and most <= usable_wh
                for one, most in zip(flown, takes_wh, strict=True)
            ):
                best = flown
                break
            charge = _charge(costs, choice, takes_wh) * _SPARE**number
        return None if best is None else tuple(map(self._planned, best))

    def _priced(self, flown: Sequence[Flown]) -> list[float]:
        """Return the approximate energy bound of each sortie: its price, scaled by one full prediction."""
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


def _charge(costs: SortieCosts, choice: Choice, takes_wh: Sequence[float]) -> NDArray[np.float64]:
    """Return the charge factor at each place: predicted over estimated energy of its sortie."""
    charge = np.ones(len(costs.places))
    for (first, last), home, takes in zip(pairwise(choice.ends), choice.homes, takes_wh, strict=True):
        charge[first:last] = takes / costs.watt_hours[home, first, last]
    return charge
