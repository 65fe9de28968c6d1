"""From a scenario to a mission: budget, path, and what it will take."""

from wbf_mission.planning.builder import MissionBuilder, flown_vehicle
from wbf_mission.planning.plan import flight_builder, home_of, plan, plan_tasks, planner_of
from wbf_mission.planning.result import PlanResult
from wbf_mission.planning.task import VehicleAssignment

__all__ = [
    "MissionBuilder",
    "PlanResult",
    "VehicleAssignment",
    "flight_builder",
    "flown_vehicle",
    "home_of",
    "plan",
    "plan_tasks",
    "planner_of",
]
