"""The ids of Gymnasium's registry: those of the catalogue that one of the paper's robots flies."""

from __future__ import annotations

import gymnasium

from sim_vehicle.airframe.catalog import get_vehicle
from wbf_mission.rl.task import can_batch
from wbf_mission.scenario import load_scenario, scenario_ids

__all__ = ["register_all"]


def register_all() -> None:
    """Register every such id that is not registered yet."""
    for name in scenario_ids():
        scenario = load_scenario(name)
        fleet = scenario.vehicle.fleet
        if name in gymnasium.registry or len(fleet) > 1 or not get_vehicle(fleet[0]).is_ideal:
            continue
        gymnasium.register(
            name,
            entry_point="wbf_mission.rl.env:SurveyEnv",
            vector_entry_point="wbf_mission.rl.vector_env:SurveyVectorEnv" if can_batch(scenario) else None,
            kwargs={"scenario": name},
        )
