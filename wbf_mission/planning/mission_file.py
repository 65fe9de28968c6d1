"""Plan of a mission file."""

from __future__ import annotations

import numpy as np

from geo import Farm
from mission.files import read_mission
from mission.model import Mission
from mission.planners.path import Points
from wbf_mission.planning.builder import MissionBuilder, PlanResult
from wbf_mission.scenario import ScenarioError


def read_plan(file: str, builder: MissionBuilder, footprint: int, seed: int) -> PlanResult:
    """Return the plan of a mission file; `ScenarioError` if no mission item has a position."""
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
    """Return the positions of a mission's items in the farm frame (m), float64[n, 2]."""
    placed = [(item.x, item.y) for item in mission.items if item.has_position and (item.x or item.y)]
    latitude, longitude = np.array(placed).reshape(-1, 2).T
    return np.column_stack(farm.frame.from_wgs84(latitude, longitude))
