"""Plans of a scenario: paths within the budgets, and their predictions."""

from __future__ import annotations

from functools import partial

import numpy as np

from geo import Farm
from mission.errors import PlanningError
from mission.files import read_mission
from mission.model import Mission
from mission.planners import Planner, make_planner
from mission.planners.path import Points
from mission.policies.policy import FixedPlan, Policy, make_policy
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import ScoreWeights
from wbf_mission.planning.builder import MissionBuilder, PlanResult
from wbf_mission.planning.fleet import vehicles_of
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.loop import DecisionLoop, Knowledge
from wbf_mission.scenario import Choice, FarmOptions, Scenario, ScenarioError
from wbf_mission.scenario.scenario import require_scenario


def plan(scenario: Scenario, *, progress: Progress = silent) -> PlanResult:
    """Plan a scenario, or read the mission that it names.

    Parameters
    ----------
    progress : callable
        Progress of the planner's search: see `wbf_mission.progress.Progress`.

    Raises
    ------
    WbfMissionError
        If a name is unknown, a value is out of range, or no path fits the budget; if several vehicles fly
        (`plan_fleet` plans for them).
    """
    require_scenario(scenario)
    count = len(scenario.vehicle.fleet)
    if count > 1:
        msg = f"{count} vehicles: a mission is one vehicle's; plan for the fleet, or give one"
        raise ScenarioError(msg)
    return plan_fleet(scenario, progress=progress)[0]


def plan_fleet(
    scenario: Scenario, *, farm: Farm | None = None, progress: Progress = silent
) -> tuple[PlanResult, ...]:
    """Plan for all vehicles of a scenario, in the order of their system ids; errors as of `plan`.

    `farm` is the scenario's, if it is loaded already. A policy gives its first paths, before anything is
    known of the farm; in flight it follows the estimate.
    """
    (farm, fields), day = farm_of(scenario.farm, farm), scenario.farm.day
    if scenario.mission.file is not None:
        require_one_vehicle(scenario.mission.file, len(scenario.vehicle.fleet))
        builder = MissionBuilder.of(scenario, farm)
        return (read_plan(scenario.mission.file, builder, scenario.camera.footprint, scenario.seed),)
    vehicles = vehicles_of(scenario, farm, seed=scenario.seed, first_day=day, progress=progress)
    tasks, mission = [one.task for one in vehicles], scenario.mission
    knowledge = Knowledge(
        farm,
        day,
        fields,
        ScoreWeights.of(fields),
        partial(InformationModel.unknown, farm.grid().shape, fields),
        partial(Observations.empty, fields.names),
    )
    choice, steered = mission.policy or mission.planner, mission.policy is not None
    policy: Policy
    if steered:
        policy = make_policy(choice.chosen, **choice.params)
        policy.start()
    else:
        policy = FixedPlan(planner_of(choice), mission.partition)
    name = f"{'policy' if steered else 'planner'} {choice}"
    loop = DecisionLoop(policy, name, knowledge, records=[])
    decision = loop.start([task.report(steered=steered) for task in tasks]).decision
    if not any(len(decision.paths[task.system_id]) for task in tasks):
        msg = f"{name} finds nothing worth a flight within {tasks[0].budget_text}"
        raise PlanningError(msg)
    return tuple(task.plan_of(decision, str(choice), steered=steered) for task in tasks)


def farm_of(options: FarmOptions, farm: Farm | None = None) -> tuple[Farm, FieldSet]:
    """Return the farm, limited to the crops of the fields, and the fields."""
    fields = load_field_set(options.fields)
    return (options.load() if farm is None else farm).scouting(fields.crops), fields


def require_one_vehicle(file: str, count: int) -> None:
    """Raise ScenarioError if several vehicles are to fly one mission file."""
    if count > 1:
        msg = f"mission {file} is one vehicle's, but {count} fly; give one"
        raise ScenarioError(msg)


def planner_of(choice: Choice) -> Planner:
    """Return the planner of a choice, with its parameters."""
    return make_planner(choice.chosen, **choice.params)


def read_plan(file: str, builder: MissionBuilder, footprint: int, seed: int) -> PlanResult:
    """Return the plan of a mission file; the farm only places its waypoints."""
    farm, mission = builder.farm, read_mission(file)
    path_m = positions_of(mission, farm)
    if not len(path_m):
        msg = f"{file}: no item of the mission has a position; give a mission with waypoints"
        raise ScenarioError(msg)
    return builder.plan_of(
        mission,
        path_m,
        planner=None,
        seed=seed,
        budget_text="none (mission file)",
        footprint=footprint,
    )


def positions_of(mission: Mission, farm: Farm) -> Points:
    """Return where the items of a mission lie, float64[n, 2], in metres of the farm frame."""
    placed = [(item.x, item.y) for item in mission.items if item.has_position and (item.x or item.y)]
    latitude, longitude = np.array(placed).reshape(-1, 2).T
    return np.column_stack(farm.frame.from_wgs84(latitude, longitude))
