"""Task of one vehicle in a flight: its planning request, and the plan of its path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from geo.seeds import sealed_seed
from mission.planners import CropArea, PlannedPath, PlanningRequest
from mission.planners.path import Points, drop_coincident
from mission.policies.decision import Decision
from mission.policies.observation import GeometricTravelCost, Status, TravelCost, VehicleReport
from sim_vehicle.prediction.onward import InFlight
from wbf_mission.planning.budget import (
    FlightBudget,
    FlightTravelCost,
    StartTravelCost,
    leg_travel_cost,
    make_budget,
    onward_predictor,
)
from wbf_mission.planning.builder import MissionBuilder, PlanResult
from wbf_mission.planning.keep_out import land_of
from wbf_mission.progress import Progress, silent
from wbf_mission.scenario import MissionOptions
from wbf_mission.scenario.choice import drawing_seed

_LEAST_M = 1e-3


@dataclass(frozen=True, slots=True)
class SortieNumber:
    """Number of one vehicle's flight in a run."""

    day: int  # Day of the environment.
    flight: int  # Number of the flight on the day, from 1.
    system_id: int  # MAVLink system id of the vehicle.
    first_day: int  # First day of the run.

    @classmethod
    def first(cls, day: int, system_id: int) -> SortieNumber:
        """Return the number of a vehicle's first flight in a run that begins on `day`."""
        return cls(day, 1, system_id, day)

    def stream_names(self, part: str) -> tuple[str, ...]:
        """Return the names that identify a part's random stream; only `part` for vehicle 1's first flight."""
        names = [part]
        if (self.day, self.flight) != (self.first_day, 1):
            names += [f"day-{self.day}", f"flight-{self.flight}"]
        if self.system_id != 1:
            names.append(f"vehicle-{self.system_id}")
        return tuple(names)


@dataclass(frozen=True, slots=True)
class VehicleAssignment:
    """Task of one vehicle in one flight."""

    system_id: int  # The vehicle's MAVLink system id.
    builder: MissionBuilder  # Makes and predicts the vehicle's missions.
    request: PlanningRequest  # Request to the planner or policy.
    budget_text: str  # Budget of the flight, in words.
    seed: int  # Seed of the run, for the plan's record.
    drawing_seed: int  # Seed of the planner or policy.
    footprint: int  # Side of the camera's footprint, in cells.

    @classmethod
    def of(
        cls,
        mission: MissionOptions,
        builder: MissionBuilder,
        *,
        footprint: int,
        seed: int,
        number: SortieNumber,
        progress: Progress = silent,
    ) -> VehicleAssignment:
        """Return the task of a vehicle in a flight; `footprint` is the side of an image, in cells."""
        farm = builder.farm
        means, text = _means(mission, builder)
        camera: dict[str, Any] = {"footprint_m": footprint * farm.cell_size_m}
        if (over := builder.imaging) is not None:
            camera = {
                "footprint_m": over.across_m,
                "footprint_along_m": max(over.sure_along_m, _LEAST_M),
                "row_spacing_m": over.row_spacing_m,
            }
        kind, choice = ("planner", mission.planner) if mission.policy is None else ("policy", mission.policy)
        drawn = drawing_seed(choice, kind, seed)
        request = PlanningRequest(
            **camera,
            least_leg_m=builder.cornering.radius_m,
            crop_areas=tuple(
                CropArea(crop, land) for crop in farm.grown if not (land := farm.crop_area(crop)).is_empty
            ),
            seed=_planner_seed(drawn, number),
            progress=lambda done, total: progress("planning", done, total),
            **means,
        )
        return cls(number.system_id, builder, request, text, seed, drawn, footprint)

    def moved(self, mission: MissionOptions, builder: MissionBuilder) -> VehicleAssignment:
        """Return the task with the home of `builder`; raises the errors of `of`."""
        means, text = _means(mission, builder)
        return replace(self, builder=builder, request=replace(self.request, **means), budget_text=text)

    def of_sortie(self, number: SortieNumber) -> VehicleAssignment:
        """Return the task for another flight of the run, with the planner's seed of that flight."""
        return replace(self, request=replace(self.request, seed=_planner_seed(self.drawing_seed, number)))

    def report(self, *, steered: bool = False) -> VehicleReport:
        """Return the vehicle's report before take-off; `plan_of` explains `steered`."""
        return VehicleReport(
            self.system_id,
            self.request,
            Status.READY,
            self.request.start_xy_m,
            (0.0, 0.0),
            age_s=0.0,
            spent=0.0,
            rest_m=np.empty((0, 2)),
            travel_cost=StartTravelCost(self.request, self.builder, steered),
            battery=None if self.builder.vehicle.battery is None else 1.0,
            contact=None if (reaches := self.builder.station_range) is None else reaches.contact_area(),
        )

    def travel_cost_in_flight(self, first_m: Points) -> Callable[[InFlight, Points, bool], TravelCost]:
        """Return a function that maps the vehicle's state and path in flight to the vehicle's travel cost.

        The function's last argument says whether the autopilot leaves its mission for a change of path.
        """
        rough = leg_travel_cost(self.request, self.builder)
        if isinstance(rough, GeometricTravelCost):
            budget = rough.budget
            return lambda state, *_: GeometricTravelCost(budget, state.position_m)
        flown = self.request.budget
        charged: Callable[[float], float] = float
        if isinstance(flown, FlightBudget):
            charged = flown.onward(np.vstack((self.request.start_xy_m, first_m)))
        predictor, unit = onward_predictor(self.builder), flown.unit
        return lambda state, path, aside: FlightTravelCost(
            state, predictor, rough, unit, charged, path, aside
        )

    def plan_of(self, decision: Decision, decided_by: str, *, steered: bool = False) -> PlanResult:
        """Return the plan of this vehicle's path in a decision.

        `steered` means that the path is changed in flight. Then the camera is on from take-off, and a
        repeated point is not a loiter, because it only joins two pieces of the path.
        """
        spacing_m = decision.spacing_m.get(self.system_id)
        path = PlannedPath(decision.paths[self.system_id], spacing_m, decided_by)
        flown = replace(path, points_m=drop_coincident(path.points_m)) if steered else path
        return self.builder.plan_of(
            self.builder.with_zones(self.builder.mission(flown, camera_on_approach=steered), path.points_m),
            path.points_m,
            planner=decided_by,
            seed=self.seed,
            budget_text=self.budget_text,
            footprint=self.footprint,
            spacing_m=spacing_m,
        )


def _means(mission: MissionOptions, builder: MissionBuilder) -> tuple[dict[str, Any], str]:
    """Return the parts of a planning request that depend on the home, and the budget in words."""
    budget, text = make_budget(mission.budget, builder, steered=mission.policy is not None)
    area, passable = land_of(builder.farm, builder.keep_out)
    if builder.vehicle.is_ideal and passable is not None:  # The paper's robot scouts all its land, ponds too.
        area, passable = passable, None
    means = {"area": area, "passable": passable, "start_xy_m": builder.home_m, "budget": budget}
    return means, text


def _planner_seed(seed: int, number: SortieNumber) -> SeedSequence:
    """Return the seed of a flight's planner."""
    return sealed_seed(seed, *number.stream_names("planner"))
