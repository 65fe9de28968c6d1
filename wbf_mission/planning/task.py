"""What one vehicle may do: where, from where, for how much; and from its path to the plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.random import SeedSequence

from geo import Crop, Farm
from geo.seeds import sealed_seed
from mission.model import Mission
from mission.planners import CropArea, PlannedPath, PlanningRequest, coverage
from mission.planners.inside_routing import parts_of
from mission.planners.path import Area, Points, drop_coincident
from mission.policies.decision import Decision
from mission.policies.observation import Status, TravelCost, VehicleReport
from mission.policies.travel_cost import GeometricTravelCost
from sim_vehicle.prediction.flight import Prediction, home_frame
from sim_vehicle.prediction.onward import InFlight
from wbf_mission.planning.budget import FlightBudget, make_budget
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.result import PlanResult, turns_camera
from wbf_mission.planning.sortie_number import SortieNumber
from wbf_mission.planning.travel_cost import (
    FlightTravelCost,
    StartTravelCost,
    leg_travel_cost,
    onward_predictor,
)
from wbf_mission.progress import Progress, silent
from wbf_mission.scenario import MissionOptions, Scenario, ScenarioError

# A track is simplified by so much of what the camera sees at once.
_SIMPLER = 0.02


@dataclass(frozen=True, slots=True)
class VehicleAssignment:
    """One vehicle's task.

    Parameters
    ----------
    system_id : int
        The vehicle's MAVLink system id.
    builder : MissionBuilder
        Makes its missions and predicts them.
    request : PlanningRequest
        What its planner is asked.
    budget_text : str
        The budget in words.
    seed : int
        The run's, for the record.
    """

    system_id: int
    builder: MissionBuilder
    request: PlanningRequest
    budget_text: str
    seed: int

    @classmethod
    def of(
        cls, scenario: Scenario, builder: MissionBuilder, *, system_id: int = 1, progress: Progress = silent
    ) -> VehicleAssignment:
        """Return the task of a vehicle.

        Raises
        ------
        PlanningError, ScenarioError
            If the budget is not understood, or does not fit the vehicle.
        """
        farm = builder.farm
        steered = scenario.mission.policy is not None
        budget, text = make_budget(scenario.mission.budget, builder, steered=steered)
        request = PlanningRequest(
            area=flyable_area(builder),
            start_xy_m=builder.home_m,
            budget=budget,
            footprint_m=scenario.camera.footprint * farm.cell_size_m,
            crop_areas=tuple(
                CropArea(crop, land)
                for crop in (Crop.TOMATO, Crop.STRAWBERRY)
                if not (land := farm.crop_area(crop)).is_empty
            ),
            seed=_planner_seed(scenario.seed, SortieNumber.first(scenario.farm.day, system_id)),
            progress=lambda done, total: progress("planning", done, total),
        )
        return cls(system_id, builder, request, text, scenario.seed)

    def moved(self, mission: MissionOptions, builder: MissionBuilder) -> VehicleAssignment:
        """Return the same task for a vehicle that starts and lands where another builder has its home.

        Raises
        ------
        PlanningError, ScenarioError
            As of `of`.
        """
        budget, text = make_budget(mission.budget, builder, steered=mission.policy is not None)
        area, start_xy_m = flyable_area(builder), builder.home_m
        request = replace(self.request, area=area, start_xy_m=start_xy_m, budget=budget)
        return replace(self, builder=builder, request=request, budget_text=text)

    def of_sortie(self, number: SortieNumber) -> VehicleAssignment:
        """Return the same task for another flight of the run, for which its planner draws anew."""
        return replace(self, request=replace(self.request, seed=_planner_seed(self.seed, number)))

    def report(self, *, steered: bool = False) -> VehicleReport:
        """Return the vehicle as it stands at its start, ready for its first path.

        Parameters
        ----------
        steered : bool
            Whether that will be changed in flight; see `plan_of`.
        """
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
        )

    def travel_cost_in_flight(self, first_m: Points) -> Callable[[InFlight, Points, bool], TravelCost]:
        """Return what tells what flying on costs the vehicle, in what state and on what path it is.

        The last argument is whether its autopilot leaves its mission for a change.

        Parameters
        ----------
        first_m : float64[n, 2]
            The path that is flown first.
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
        """Return the plan that flies the path of this vehicle in a decision.

        Parameters
        ----------
        decided_by : str
            Planner or policy, with its parameters.
        steered : bool
            Whether the path is changed in flight: then the way to the first point is looked at, too, and a
            point that is named again is a joint of two pieces, not a stay.
        """
        spacing_m = decision.spacing_m.get(self.system_id)
        path = PlannedPath(decision.paths[self.system_id], spacing_m, decided_by)
        builder = self.builder
        farm = builder.farm
        flown = replace(path, points_m=drop_coincident(path.points_m)) if steered else path
        mission = builder.mission(flown, camera_on_approach=steered)
        prediction = builder.predict(mission)
        return PlanResult(
            farm=farm,
            vehicle=builder.vehicle,
            planner=decided_by,
            seed=self.seed,
            mission=mission,
            path_m=path.points_m,
            spacing_m=path.spacing_m,
            budget_text=self.budget_text,
            length_m=prediction.ground_length_m,
            coverage=predicted_coverage(farm, mission, prediction, self.request.footprint_m),
            prediction=prediction,
            batteries=builder.batteries(mission, prediction),
        )


def _planner_seed(seed: int, number: SortieNumber) -> SeedSequence:
    """Return what the planner of a flight draws from."""
    return sealed_seed(seed, *number.stream_names("planner"))


def predicted_coverage(farm: Farm, mission: Mission, prediction: Prediction, footprint_m: float) -> float:
    """Return the fraction of the owner's land that is seen in a predicted flight, while the camera is on.

    That needs no more than the mission, so one that is read from a file has the coverage that it was planned
    with, whatever its autopilot is told to do at corners.
    """
    about_home = home_frame(mission)
    track_m = np.column_stack(farm.frame.from_wgs84(*about_home.to_wgs84(*prediction.track_m[:, :2].T)))
    camera_on = [False]
    for item in mission.items:
        camera_on.append(camera_on[-1] if (on := turns_camera(item)) is None else on)
    seen = np.array(camera_on)[np.minimum(prediction.items, len(mission.items))]
    paths = [np.empty((0, 2))]
    for first, end in np.flatnonzero(np.diff(seen, prepend=False, append=False)).reshape(-1, 2):
        # Straight legs without the many points of the track.
        stretch = shapely.linestrings(track_m[max(first - 1, 0) : end + (first == 0)])
        legs = shapely.get_coordinates(shapely.simplify(stretch, _SIMPLER * footprint_m))
        paths += [legs, np.full((1, 2), np.nan)]
    path = np.vstack(paths)
    return coverage(path, free_area(farm), footprint_m) if len(path) else 0.0


def free_area(farm: Farm) -> Area:
    """Return the owner's land without what must not be flown over."""
    area = farm.owner_area
    if farm.obstacles:
        area = shapely.difference(area, shapely.union_all(list(farm.obstacles)))
    return area


def flyable_area(builder: MissionBuilder) -> Area:
    """Return the owner's land over which a vehicle's path may lead.

    Raises
    ------
    ScenarioError
        If the obstacles leave nothing.
    """
    farm, keep_out = builder.farm, builder.keep_out
    if keep_out is None:
        return free_area(farm)
    wide = [
        part
        for part in parts_of(shapely.difference(farm.owner_area, keep_out.area))
        if not shapely.buffer(part, -0.5 * farm.cell_size_m).is_empty
    ]
    if not wide:
        msg = (
            f"farm {farm.name}: no land is {keep_out.distance_m:.1f} m away from every obstacle, as the"
            " margin and what the vehicle strays in that wind need; give a smaller --margin, or fly slower"
        )
        raise ScenarioError(msg)
    return wide[0] if len(wide) == 1 else shapely.MultiPolygon(wide)
