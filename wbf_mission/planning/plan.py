"""From a scenario to a mission: the path within the budget, and what it will take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from geo import Farm, get_farm
from mission.files import read_mission
from mission.model import GeoPoint, Mission
from mission.planners import Planner, make_planner
from mission.policies.policy import FixedPlan
from sensors.field_files import load_field_set
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import ScoreWeights
from sim_vehicle.airframe.spec import VehicleSpec
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.result import PlanResult
from wbf_mission.planning.task import VehicleAssignment, predicted_coverage
from wbf_mission.planning.weather import wind_of
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.loop import DecisionLoop, Knowledge
from wbf_mission.scenario import Choice, MissionOptions, Scenario, ScenarioError
from wbf_mission.scenario.scenario import require_scenario


def plan(scenario: Scenario, *, progress: Progress = silent) -> PlanResult:
    """Plan a scenario, or read the mission that it names.

    Parameters
    ----------
    progress : callable
        Told how far the planner's search is: see `wbf_mission.progress.Progress`.

    Raises
    ------
    WbfMissionError
        If a name is unknown, a value is out of range, or no path fits the budget; if several vehicles fly
        (`wbf_mission.run.fleet.plan_fleet` plans for them).
    """
    require_scenario(scenario)
    if len(scenario.vehicle.fleet) > 1:
        count = len(scenario.vehicle.fleet)
        msg = f"{count} vehicles: a mission is one vehicle's; plan for the fleet, or give one"
        raise ScenarioError(msg)
    builder = flight_builder(scenario)
    if scenario.mission.file is not None:
        return _read(scenario, builder)
    task = VehicleAssignment.of(scenario, builder, progress=progress)
    return plan_tasks(scenario, [task])[0]


def plan_tasks(scenario: Scenario, tasks: Sequence[VehicleAssignment]) -> tuple[PlanResult, ...]:
    """Return what the scenario's planner plans for vehicles that fly together.

    Raises
    ------
    WbfMissionError
        If no path fits the budget.
    """
    farm, choice = tasks[0].builder.farm, scenario.mission.planner
    fields = load_field_set(scenario.farm.fields)
    knowledge = Knowledge(
        farm,
        scenario.farm.day,
        fields,
        ScoreWeights.of(fields),
        partial(InformationModel.unknown, farm.grid().shape, fields),
        partial(Observations.empty, fields.names),
    )
    policy = FixedPlan(planner_of(choice), scenario.mission.partition)
    loop = DecisionLoop(policy, f"planner {choice}", knowledge, records=[])
    decision = loop.start([task.report() for task in tasks]).decision
    return tuple(task.plan_of(decision, str(choice)) for task in tasks)


def flight_builder(scenario: Scenario, home_m: tuple[float, float] | None = None) -> MissionBuilder:
    """Return what makes the missions of a run's vehicle, which starts at the farm's home without `home_m`.

    Raises
    ------
    WbfMissionError
        If farm or vehicle are unknown, or the vehicle cannot fly in that wind or at that speed.
    """
    builder = MissionBuilder.of(scenario, get_farm(scenario.farm.name), home_m)
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
    return make_planner(choice.chosen, **choice.params)


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
    # The flight of a mission without a home begins at the farm's.
    home = home_of(mission, builder.farm)
    placed = replace(mission, home=home)
    prediction = builder.predict(placed)
    return PlanResult(
        farm=builder.farm,
        vehicle=builder.vehicle,
        planner=None,
        seed=scenario.seed,
        mission=mission,
        path_m=points,
        spacing_m=None,
        budget_text="none (mission file)",
        length_m=prediction.ground_length_m,
        coverage=predicted_coverage(
            builder.farm, placed, prediction, scenario.camera.footprint * builder.farm.cell_size_m
        ),
        prediction=prediction,
        batteries=builder.batteries(placed, prediction),
    )
