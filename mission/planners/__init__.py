"""Planners, which turn an area, a start and a budget into a path within the budget."""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from mission.planners.budget import BatchBudget as BatchBudget
    from mission.planners.budget import Budget as Budget
    from mission.planners.budget import LengthBudget as LengthBudget
    from mission.planners.budget import StepBudget as StepBudget
    from mission.planners.budget import parse_budget as parse_budget
    from mission.planners.build import WingPattern as WingPattern
    from mission.planners.build import build_mission as build_mission
    from mission.planners.path import PlannedPath as PlannedPath
    from mission.planners.path import path_length as path_length
    from mission.planners.request import ConfiguredPlanner as ConfiguredPlanner
    from mission.planners.request import CropArea as CropArea
    from mission.planners.request import Planner as Planner
    from mission.planners.request import PlanningRequest as PlanningRequest
    from mission.planners.request import make_planner as make_planner
    from mission.planners.request import planner_names as planner_names
    from mission.planners.request import planner_parameters as planner_parameters
else:
    __getattr__, __dir__, __all__ = attach(__name__)
