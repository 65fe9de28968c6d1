"""From a scenario to a mission: budget, path, and what it will take."""

from wbf_mission.planning.builder import MissionBuilder, flown_vehicle
from wbf_mission.planning.plan import home_of, plan
from wbf_mission.planning.result import PlanResult

__all__ = ["MissionBuilder", "PlanResult", "flown_vehicle", "home_of", "plan"]
