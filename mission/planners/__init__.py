"""Planners: a farm, a start and a budget in, a path within the budget out."""

from mission.planners.budget import Budget, LengthBudget, StepBudget, parse_budget
from mission.planners.build import build_mission
from mission.planners.path import PlannedPath, coverage, path_length
from mission.planners.request import CropArea, Planner, PlanningRequest

__all__ = [
    "Budget",
    "CropArea",
    "LengthBudget",
    "PlannedPath",
    "Planner",
    "PlanningRequest",
    "StepBudget",
    "build_mission",
    "coverage",
    "parse_budget",
    "path_length",
]
