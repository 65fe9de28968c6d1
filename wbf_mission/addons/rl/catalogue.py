"""Training interfaces of each scenario of the catalogue, with reasons for the interfaces that it lacks."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

from geo.errors import WbfMissionError
from mission.planners import parse_budget
from sim_vehicle.airframe.catalog import get_vehicle
from wbf_mission.scenario import Scenario, load_scenario, scenario_ids


class TrainingError(WbfMissionError, ValueError):
    """A training environment cannot be created, or is used wrongly."""


@dataclass(frozen=True, slots=True)
class Interfaces:
    """Reasons why a scenario lacks training interfaces; the text of an available interface is empty."""

    name: str
    single: str
    """`gymnasium.make`, and `gymnasium.make_vec` with ``vectorization_mode="sync"`` or ``"async"``."""
    batched: str
    """`gymnasium.make_vec` without a mode: many runs in arrays (`SurveyVectorEnv`)."""
    parallel: str
    """`parallel_env`."""

    def __str__(self) -> str:
        ways = {"make": self.single, "make_vec": self.batched, "parallel_env": self.parallel}
        had = [way for way, missing in ways.items() if not missing]
        why = self.parallel or self.single or self.batched
        return f"{self.name}: {', '.join(had) or 'none'}{f' ({why})' if why else ''}"


def interfaces() -> tuple[Interfaces, ...]:
    """Return the interfaces of each catalogue id, in catalogue order.

    >>> [str(one) for one in interfaces() if one.name == "WBF/Miniberry-10-v1"]
    ['WBF/Miniberry-10-v1: make, make_vec, parallel_env']
    """
    return tuple(interfaces_of(name) for name in scenario_ids())


def interfaces_of(name: str) -> Interfaces:
    """Return the interfaces of an id or scenario file."""
    scenario = load_scenario(name)
    unfit = why_not_stepped(scenario)
    several = unfit or why_not_single(scenario)
    return Interfaces(name, several, several or why_not_batched(scenario), unfit)


def why_not_stepped(scenario: Scenario) -> str:
    """Return why the robots of a scenario cannot be moved cell by cell; empty if they can."""
    for one in scenario.vehicle.fleet:
        if not get_vehicle(one).is_ideal:
            return f'{one} flies under an autopilot, but only "ideal" can be moved cell by cell'
    if scenario.vehicle.gps_noise_m > 0.0:
        return "the robot's position has noise, but moves from cell to cell are exact"
    budget = scenario.mission.budget
    value, unit = (0.0, "") if budget is None else parse_budget(budget)
    if unit != "steps" or value < 2:
        return f"the budget is {budget or 'not given'}; give two steps or more, such as 500steps"
    return ""


def why_not_single(scenario: Scenario) -> str:
    """Return why a cell-by-cell scenario has no single-robot environment; empty if it has one."""
    robots = len(scenario.vehicle.fleet)
    return "" if robots == 1 else f"{robots} robots fly: use wbf_mission.addons.rl.parallel_env"


def why_not_batched(scenario: Scenario) -> str:
    """Return why a single-robot environment has no batched form; empty if it has one."""
    of = scenario.farm
    if of.days * of.flights_per_day > 1:
        return "runs of several flights are not batched"
    return "images of several cells are not batched" if scenario.camera.footprint > 1 else ""


def register_all() -> None:
    """Register the ids not yet registered; for an unavailable id, `gymnasium.make` raises TrainingError.

    Raises TrainingError if a library of the extra is missing.
    """
    missing = [name for name in ("gymnasium", "pettingzoo") if importlib.util.find_spec(name) is None]
    if missing:
        raise TrainingError(
            f"training environments need {' and '.join(missing)}: install with pip install 'wbf-mission[rl]'"
        )
    import gymnasium

    for interface in interfaces():
        if interface.name not in gymnasium.registry:
            gymnasium.register(
                interface.name,
                entry_point=f"{__package__}.env:SurveyEnv",
                vector_entry_point=None if interface.batched else f"{__package__}.vector_env:SurveyVectorEnv",
                kwargs={"scenario": interface.name},
            )
