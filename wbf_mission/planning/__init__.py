"""Mission planning for a scenario: budget, path, mission and prediction."""

from wbf_mission.planning.assignment import VehicleAssignment
from wbf_mission.planning.builder import MissionBuilder, PlanResult, flown_vehicle, home_of

__all__ = [
    "MissionBuilder",
    "PlanResult",
    "VehicleAssignment",
    "flown_vehicle",
    "home_of",
]
