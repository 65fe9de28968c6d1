"""From a scenario to a mission: the path within the budget, and what it will take."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from geo import Farm, get_farm
from geo.errors import WbfMissionError
from mission.errors import PlanningError
from mission.files import read_mission
from mission.model import Command, GeoPoint, Mission
from mission.planners import PlannedPath, Planner, PlanningRequest, coverage, make_planner
from mission.planners.budget import LengthBudget
from sim_vehicle.airframe.spec import VehicleSpec
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.result import PlanResult
from wbf_mission.planning.task import FlightTask, free_area
from wbf_mission.progress import Progress, silent
from wbf_mission.scenario import Choice, MissionOptions, Scenario, ScenarioError
from wbf_mission.weather import wind_of


def plan(scenario: Scenario, *, progress: Progress = silent) -> PlanResult:
    """Plan a scenario, or read the mission that it names.

    Parameters
    ----------
    scenario : Scenario
    progress : callable
        Told how far the planner's search is: see `wbf_mission.progress.Progress`.

    Raises
    ------
    WbfMissionError
        If a name is unknown, a value is out of range, or no path fits the budget.
    """
    builder = flight_builder(scenario)
    if scenario.mission.file is not None:
        return _read(scenario, builder)
    task = FlightTask.of(scenario, builder, progress=progress)
    choice = scenario.mission.planner
    return task.plan(_run_planner(planner_of(choice), task.request, str(choice)), str(choice))


def flight_builder(scenario: Scenario) -> MissionBuilder:
    """Return what makes the missions of a run.

    Raises
    ------
    WbfMissionError
        If farm or vehicle are unknown, or the vehicle cannot fly in that wind or at that speed.
    """
    builder = MissionBuilder.of(scenario, get_farm(scenario.farm.name))
    check_wind(builder)
    check_speed(scenario.mission, builder.vehicle)
    return builder


def planner_of(choice: Choice) -> Planner:
    """Return the planner of a choice, with its parameters.

    Raises
    ------
    PlanningError
        If there is no such planner, or the object is none.
    ParameterError
        If it does not have one of the parameters.
    """
    return make_planner(choice.name if choice.made is None else choice.made, **choice.params)


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


def check_wind(builder: MissionBuilder) -> None:
    """Raise ScenarioError if the mean wind at the height of the flight would blow the vehicle away."""
    vehicle, limit = builder.vehicle, builder.vehicle.airspeed_limit_m_s
    wind = wind_of(builder.weather, builder.level, gusts=False)
    speed = math.hypot(*wind.mean_at(builder.level.altitude_m))
    if not vehicle.is_ideal and speed >= limit:
        msg = (
            f"wind of {speed:g} m/s: vehicle {vehicle.name} flies at most {limit:.3g} m/s "
            "through the air and would be blown away; wait for less wind"
        )
        raise ScenarioError(msg)


def check_speed(mission: MissionOptions, vehicle: VehicleSpec) -> None:
    """Raise ScenarioError if a cruise speed was asked for that the vehicle cannot fly."""
    asked, most = mission.cruise_speed_m_s, vehicle.fastest_m_s
    if asked is not None and asked > most:
        msg = f"cruise speed {asked:g} m/s: vehicle {vehicle.name} flies at most {most:.3g} m/s"
        raise ScenarioError(msg + "; give less, or another vehicle")


def home_of(mission: Mission, farm: Farm) -> GeoPoint:
    """Return where a flight of ``mission`` begins: at its own home, without one at the farm's."""
    latitude_deg, longitude_deg = farm.frame.to_wgs84(*farm.home_m)
    return mission.home or GeoPoint(latitude_deg, longitude_deg, farm.frame.altitude_m)


def _read(scenario: Scenario, builder: MissionBuilder) -> PlanResult:
    """Take the mission from a file; the farm only says where its waypoints lie."""
    path = str(scenario.mission.file)
    mission = read_mission(path)
    positioned = [item for item in mission.items if item.has_position and (item.x or item.y)]
    if not positioned:
        msg = f"{path}: no item of the mission has a position; give a mission with waypoints"
        raise ScenarioError(msg)
    x, y = builder.farm.frame.from_wgs84(
        np.array([item.x for item in positioned]), np.array([item.y for item in positioned])
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
        planner=None,
        seed=scenario.seed,
        mission=mission,
        path_m=points,
        spacing_m=None,
        budget_text="none (mission file)",
        length_m=LengthBudget(1.0, home_m if returns else None).cost(np.vstack((home_m, points))),
        coverage=coverage(
            route, free_area(builder.farm), scenario.camera.footprint * builder.farm.cell_size_m
        ),
        prediction=prediction,
        batteries=builder.batteries(placed, prediction),
    )
