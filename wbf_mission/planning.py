"""From a scenario to a mission: the budget in the vehicle's own terms, the path, and what it will take."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Crop, Farm, get_farm
from geo.errors import WbfMissionError
from geo.seeds import sealed_seed
from mission.errors import PlanningError
from mission.files import read_mission
from mission.model import Command, GeoPoint, Mission
from mission.planners import (
    Budget,
    CropArea,
    PlannedPath,
    Planner,
    PlanningRequest,
    StepBudget,
    WingPattern,
    build_mission,
    coverage,
    get_planner,
    parse_budget,
)
from mission.planners.budget import LengthBudget
from sim_vehicle.airframe.spec import VehicleSpec, get_vehicle
from sim_vehicle.autopilot import fixed_wing_procedures, with_autopilot
from sim_vehicle.execution.fixed_wing_items import circles
from sim_vehicle.prediction.battery_swaps import batteries_needed
from sim_vehicle.prediction.predict import Prediction, expected_flights
from wbf_mission.scenario import Scenario, ScenarioError
from wbf_mission.weather import wind_of

_CAMERA_STARTS = frozenset({206, 214, 2000})
# Where an aeroplane's climb-out leads to, and the height of its final approach.
CLIMB_OUT_M = 150.0
APPROACH_ALTITUDE_M = 30.0
_MOST_THREADS = 4
PAPER_STEPS_PER_CELL = 0.4  # timesteps of a day for each of the owner's cells (Matloob et al., experiments)


@dataclass(frozen=True, slots=True)
class PlanResult:
    """A mission and what it will take.

    Parameters
    ----------
    farm : Farm
    vehicle : VehicleSpec
    mission : Mission
    path_m : float64[n, 2]
        The waypoints in metres of the farm frame.
    spacing_m : float or None
        Distance between neighbouring rows or rings; None where the planner has none.
    budget_text : str
        The budget in words.
    length_m : float
        Length over ground from home through the waypoints, and back home where the mission returns.
    coverage : float
        Fraction of the owner's land that the camera's footprint passes over.
    prediction : Prediction
        Time, energy and feasibility from the vehicle's own model.
    batteries : int or None
        How many the mission needs, changed at home; 0 for a vehicle without one, None if no number is enough.
    """

    farm: Farm
    vehicle: VehicleSpec
    mission: Mission
    path_m: NDArray[np.float64]
    spacing_m: float | None
    budget_text: str
    length_m: float
    coverage: float
    prediction: Prediction
    batteries: int | None

    @property
    def crosses_obstacles(self) -> bool:
        """Whether the way from home through the waypoints, and back, leads over an obstacle of the farm."""
        home = np.array(self.farm.home_m)
        way = shapely.LineString(np.vstack((home, self.path_m, home)))
        return any(way.intersects(obstacle) for obstacle in self.farm.obstacles)

    @property
    def warnings(self) -> list[str]:
        """Return what an operator should know before flying, each in one line."""
        found = []
        if not self.prediction.feasible:
            found.append(f"the vehicle cannot fly this mission: {self.prediction.reason}")
        if self.crosses_obstacles:
            found.append("the path or the way home crosses an obstacle: keep the flight height above it")
        if not any(item.command in _CAMERA_STARTS for item in self.mission.items):
            found.append("the mission never starts the camera: there will be no observations")
        ground = shapely.box(
            0.0,
            0.0,
            self.farm.width_cells * self.farm.cell_size_m,
            self.farm.height_cells * self.farm.cell_size_m,
        )
        if not shapely.MultiPoint(self.path_m).intersects(ground):
            found.append(f"no waypoint lies on the farm {self.farm.name}: is this the right --farm?")
        return found

    @property
    def battery_used(self) -> float | None:
        """Fraction of the battery that the flight takes; None without a battery."""
        return None if self.vehicle.battery is None else 1.0 - self.prediction.battery_fraction

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "farm": self.farm.name,
            "vehicle": self.vehicle.name,
            "budget": self.budget_text,
            "items": len(self.mission.items),
            "waypoints": len(self.path_m),
            "spacing_m": self.spacing_m,
            "length_m": self.length_m,
            "predicted_time_s": self.prediction.duration_s,
            "predicted_energy_wh": self.prediction.energy_wh,
            "battery_used": self.battery_used,
            "batteries": self.batteries,
            "coverage": self.coverage,
            "feasible": self.prediction.feasible,
            "reason": self.prediction.reason,
            "warnings": self.warnings,
        }


@dataclass(frozen=True, slots=True)
class FlightBudget:
    """A budget in seconds or watt hours, charged by flying the mission in the vehicle's own model.

    Parameters
    ----------
    limit : float
        The most that the whole flight may take, from take-off to touch-down.
    unit : {"s", "Wh"}
    builder : MissionBuilder
        Makes the mission of a path.
    """

    limit: float
    unit: str
    builder: MissionBuilder

    def cost(self, path_xy_m: NDArray[np.float64]) -> float:
        """Return the predicted seconds or watt hours; infinite when the vehicle cannot fly the path."""
        return self.costs([path_xy_m])[0]

    def costs(self, paths_xy_m: Sequence[NDArray[np.float64]]) -> list[float]:
        """Return the `cost` of each path; they are flown together."""
        missions = []
        for path in paths_xy_m:
            points = np.asarray(path, dtype=np.float64).reshape(-1, 2)
            way = points[1:] if len(points) > 1 else points
            missions.append(self.builder.mission(PlannedPath(way, None, "candidate")))
        return [self._price(prediction) for prediction in self.builder.predict_all(missions)]

    def _price(self, prediction: Prediction) -> float:
        if prediction.feasible:
            return prediction.duration_s if self.unit == "s" else prediction.energy_wh
        # What only exceeds the budget still has a price, to be told when nothing fits.
        return prediction.energy_wh if self.unit == "Wh" and prediction.energy_wh > self.limit else math.inf


@dataclass(frozen=True, slots=True)
class MissionBuilder:
    """Turns paths into missions of one scenario, and predicts them."""

    scenario: Scenario
    farm: Farm
    vehicle: VehicleSpec

    def mission(self, path: PlannedPath) -> Mission:
        """Return the mission that flies ``path``."""
        scenario, vehicle, farm = self.scenario, self.vehicle, self.farm
        # What the vehicle was built for, not what an autopilot does that is told nothing.
        built = get_vehicle(scenario.vehicle)
        spacing = scenario.camera_spacing_m or farm.cell_size_m * scenario.camera_footprint
        radius = scenario.acceptance_radius_m
        return build_mission(
            path,
            frame=farm.frame,
            home_xy_m=farm.home_m,
            altitude_m=scenario.altitude_m or built.takeoff_altitude_m,
            speed_m_s=min(scenario.cruise_speed_m_s or built.cruise_speed_m_s, vehicle.top_speed_m_s),
            camera_distance_m=None if vehicle.is_ideal else spacing,
            camera_interval_s=vehicle.step_s if vehicle.is_ideal else None,
            acceptance_radius_m=vehicle.acceptance_radius_m
            if vehicle.is_ideal and radius is None
            else radius,
            return_home=not vehicle.is_ideal,
            pattern=self._pattern(scenario.altitude_m or built.takeoff_altitude_m),
        )

    def _pattern(self, altitude_m: float) -> WingPattern | None:
        """Return how an aeroplane takes off and lands, into the wind."""
        vehicle, scenario = self.vehicle, self.scenario
        if not circles(vehicle):
            return None
        procedures = fixed_wing_procedures(vehicle)
        law = procedures.limits(vehicle)
        down_m = min(altitude_m, APPROACH_ALTITUDE_M)
        return WingPattern(
            heading_rad=math.radians(scenario.wind_direction_deg) if scenario.wind_speed_m_s > 0.0 else 0.0,
            climb_out_m=CLIMB_OUT_M,
            # A little flatter than the steepest slope.
            approach_m=1.1 * down_m / law.landing_slope,
            approach_altitude_m=down_m,
            radius_m=max(abs(law.loiter_radius), 1.2 * law.tightest_m(law.airspeed_trim)),
            placed_start=procedures.placed_land_start,
        )

    def predict(self, mission: Mission) -> Prediction:
        """Predict the flight of ``mission`` in the scenario's wind, of its gusts by the statistics only."""
        return self.predict_all([mission])[0]

    def predict_all(self, missions: Sequence[Mission]) -> list[Prediction]:
        """Predict the flights of several missions."""
        return expected_flights(missions, self.vehicle, wind=wind_of(self.scenario), threads=_threads())

    def batteries(self, mission: Mission, prediction: Prediction) -> int | None:
        """How many batteries ``mission`` needs (`sim_vehicle.prediction.battery_swaps.batteries_needed`)."""
        return batteries_needed(mission, self.vehicle, prediction, wind=wind_of(self.scenario))


def _threads() -> int:
    """Return how many candidates are flown at the same time; the predictions do not depend on it."""
    return min(_MOST_THREADS, os.cpu_count() or 1)


def flown_vehicle(scenario: Scenario) -> VehicleSpec:
    """Return the scenario's vehicle as its autopilot flies it.

    Raises
    ------
    VehicleError
        If the vehicle or a parameter is unknown, or a value out of range.
    """
    return with_autopilot(get_vehicle(scenario.vehicle), scenario.autopilot, scenario.parameters)


def make_budget(builder: MissionBuilder) -> tuple[Budget, str]:
    """Return the scenario's budget and how to say it.

    Raises
    ------
    PlanningError
        If the budget is not understood.
    ScenarioError
        If the budget's unit does not fit the vehicle.
    """
    scenario, farm, vehicle = builder.scenario, builder.farm, builder.vehicle
    home = None if vehicle.is_ideal else farm.home_m
    if scenario.budget is None:
        if vehicle.is_ideal:
            steps = float(round(PAPER_STEPS_PER_CELL * farm.owner_cells))
            return StepBudget(steps, farm.cell_size_m), f"{steps:.0f} steps (0.4 x the owner's cells)"
        if vehicle.battery is None:
            msg = f"vehicle {vehicle.name} has no battery to budget by: give --budget, such as 8000m or 25min"
            raise ScenarioError(msg)
        usable = vehicle.battery.capacity_wh * (1.0 - vehicle.battery.reserve_fraction)
        text = f"{usable:.1f} Wh (the battery less {vehicle.battery.reserve_fraction:.0%} reserve)"
        return FlightBudget(usable, "Wh", builder), text
    value, unit = parse_budget(scenario.budget)
    if unit == "m":
        return LengthBudget(value, home), f"{value:g} m"
    if unit == "steps":
        return StepBudget(value, farm.cell_size_m, home), f"{value:g} steps"
    if unit == "Wh" and vehicle.power is None:
        msg = (
            f"budget {scenario.budget}: vehicle {vehicle.name} uses no energy; give metres, minutes or steps"
        )
        raise ScenarioError(msg)
    return FlightBudget(value, unit, builder), f"{value:g} {unit}"


def plan(scenario: Scenario) -> PlanResult:
    """Plan a scenario, or read the mission that it names.

    Raises
    ------
    WbfMissionError
        If a name is unknown, a value is out of range, or no path fits the budget.
    """
    farm = get_farm(scenario.farm)
    vehicle = flown_vehicle(scenario)
    _check_wind(scenario, vehicle)
    builder = MissionBuilder(scenario, farm, vehicle)
    area = farm.owner_area
    if farm.obstacles:
        area = shapely.difference(area, shapely.union_all(list(farm.obstacles)))
    footprint_m = scenario.camera_footprint * farm.cell_size_m
    if scenario.mission is not None:
        return _read(builder, area, footprint_m)
    planner = get_planner(scenario.planner)
    budget, text = make_budget(builder)
    request = PlanningRequest(
        area=area,
        start_xy_m=farm.home_m,
        budget=budget,
        footprint_m=footprint_m,
        crop_areas=tuple(
            CropArea(crop, land)
            for crop in (Crop.TOMATO, Crop.STRAWBERRY)
            if not (land := farm.crop_area(crop)).is_empty
        ),
        seed=sealed_seed(scenario.seed, "planner"),
    )
    path = _run_planner(planner, request, scenario.planner)
    mission = builder.mission(path)
    prediction = builder.predict(mission)
    return PlanResult(
        farm=farm,
        vehicle=vehicle,
        mission=mission,
        path_m=path.points_m,
        spacing_m=path.spacing_m,
        budget_text=text,
        length_m=LengthBudget(1.0, None if vehicle.is_ideal else farm.home_m).cost(
            np.vstack((farm.home_m, path.points_m))
        ),
        coverage=coverage(path, area, footprint_m),
        prediction=prediction,
        batteries=builder.batteries(mission, prediction),
    )


def _run_planner(planner: Planner, request: PlanningRequest, name: str) -> PlannedPath:
    """Run a planner, whoever wrote it, and hold it to its budget."""
    try:
        path = planner(request)
        cost = request.cost(path.points_m)
    except (WbfMissionError, MemoryError):
        raise
    except Exception as error:
        msg = f"planner {name} failed: {type(error).__name__}: {error}"
        raise PlanningError(msg) from error
    budget = request.budget
    if not cost <= budget.limit * (1.0 + 1e-9):
        msg = (
            f"planner {name} returned a path that takes {cost:.6g} {budget.unit}, "
            f"over the budget of {budget.limit:g} {budget.unit}"
        )
        raise PlanningError(msg)
    return path


def _check_wind(scenario: Scenario, vehicle: VehicleSpec) -> None:
    limit = vehicle.airspeed_limit_m_s
    height_m = scenario.altitude_m or get_vehicle(scenario.vehicle).takeoff_altitude_m
    speed = math.hypot(*wind_of(scenario, gusts=False).mean_at(height_m))
    if not vehicle.is_ideal and speed >= limit:
        msg = (
            f"wind of {speed:g} m/s: vehicle {vehicle.name} flies at most {limit:g} m/s "
            "through the air and would be blown away; wait for less wind"
        )
        raise ScenarioError(msg)


def home_of(mission: Mission, farm: Farm) -> GeoPoint:
    """Return where a flight of ``mission`` begins: at its own home, without one at the farm's."""
    latitude_deg, longitude_deg = farm.frame.to_wgs84(*farm.home_m)
    return mission.home or GeoPoint(latitude_deg, longitude_deg, farm.frame.altitude_m)


def _read(builder: MissionBuilder, area: Any, footprint_m: float) -> PlanResult:
    """Take the mission from the scenario's file; the farm only says where its waypoints lie."""
    path = str(builder.scenario.mission)
    mission = read_mission(path)
    places = [item for item in mission.items if item.has_place and (item.x or item.y)]
    if not places:
        msg = f"{path}: no item of the mission has a place; give a mission with waypoints"
        raise ScenarioError(msg)
    x, y = builder.farm.frame.from_wgs84(
        np.array([item.x for item in places]), np.array([item.y for item in places])
    )
    points = np.column_stack((x, y))
    route = PlannedPath(points, None, "file")
    # The flight of a mission without a home begins at the farm's.
    home = home_of(mission, builder.farm)
    home_m = builder.farm.frame.from_wgs84(home.latitude_deg, home.longitude_deg)
    placed = replace(mission, home=home)
    prediction = builder.predict(placed)
    returns = any(item.command == Command.NAV_RETURN_TO_LAUNCH for item in mission.items)
    return PlanResult(
        farm=builder.farm,
        vehicle=builder.vehicle,
        mission=mission,
        path_m=points,
        spacing_m=None,
        budget_text="none (mission file)",
        length_m=LengthBudget(1.0, home_m if returns else None).cost(np.vstack((home_m, points))),
        coverage=coverage(route, area, footprint_m),
        prediction=prediction,
        batteries=builder.batteries(placed, prediction),
    )
