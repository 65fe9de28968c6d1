"""Scenarios, which hold all options of a run, and scenario files. This package imports no slow libraries."""

from wbf_mission.scenario.choice import Choice
from wbf_mission.scenario.files import (
    Family,
    about_scenario,
    families,
    family_of,
    get_family,
    load_broken_scenario,
    load_scenario,
    read_table,
    scenario_from_table,
    scenario_ids,
    take_faults,
)
from wbf_mission.scenario.option import ScenarioError
from wbf_mission.scenario.parts import (
    CameraOptions,
    EstimateOptions,
    FarmOptions,
    MissionOptions,
    ScoreOptions,
    VehicleOptions,
    WeatherOptions,
)
from wbf_mission.scenario.scenario import Scenario, scenario_with

__all__ = [
    "CameraOptions",
    "Choice",
    "EstimateOptions",
    "Family",
    "FarmOptions",
    "MissionOptions",
    "Scenario",
    "ScenarioError",
    "ScoreOptions",
    "VehicleOptions",
    "WeatherOptions",
    "about_scenario",
    "families",
    "family_of",
    "get_family",
    "load_broken_scenario",
    "load_scenario",
    "read_table",
    "scenario_from_table",
    "scenario_ids",
    "scenario_with",
    "take_faults",
]
