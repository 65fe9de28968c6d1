"""Planners: a farm, a start and a budget in, a path within the budget out."""

from mission.planners.budget import BatchBudget, Budget, LengthBudget, StepBudget, parse_budget
from mission.planners.build import WingPattern, build_mission
from mission.planners.conformance import check_planner
from mission.planners.path import PlannedPath, path_length
from mission.planners.registry import get_planner, planner_names
from mission.planners.request import CropArea, Planner, PlanningRequest
from mission.planners.seen import coverage

__all__ = [
    "BatchBudget",
    "Budget",
    "CropArea",
    "LengthBudget",
    "PlannedPath",
    "Planner",
    "PlanningRequest",
    "StepBudget",
    "WingPattern",
    "build_mission",
    "check_planner",
    "coverage",
    "get_planner",
    "parse_budget",
    "path_length",
    "planner_names",
]
