"""The next flight, planned on a treatment map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.errors import PlanningError
from mission.planners.path import Points
from mission.policies.acquisition import Acquisition, ValueMap
from mission.policies.observation import PolicyObservation
from mission.policies.policy import Policy, make_policy, policy_parameters
from sensors.camera.leaf_camera import footprint_offsets
from sensors.scoring.score import ScoreWeights
from wbf_mission.addons.treatment.treatment_map import TreatmentMap
from wbf_mission.planning import PlanResult
from wbf_mission.planning.coverage import image_places
from wbf_mission.planning.fleet import SingleVehicle, vehicles_of
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.loop import DecisionLoop, Knowledge
from wbf_mission.scenario import Choice, Scenario

_FAR = 1e6
_WHOLE_FLIGHT = {"greedy": {"ahead": _FAR}, "orienteering": {"horizon": _FAR, "patience": _FAR}}
"""Parameters by which policies plan for the whole budget, since they decide only once here."""


@dataclass(frozen=True, slots=True)
class NextFlight:
    """The next flight, planned by the expected saving."""

    plan: PlanResult
    vehicle: SingleVehicle
    policy: str
    gain: float  # What it is expected to save, in the unit of the costs
    gain_of_all: float  # What knowing the whole farm would save
    looked_at_ha: float  # Of crops

    def summary(self) -> dict[str, object]:
        """Return plain values, for JSON."""
        told = {name: getattr(self, name) for name in ("policy", "gain", "gain_of_all", "looked_at_ha")}
        return {**told, "plan": self.plan.summary()}


def plan_next(of: TreatmentMap, scenario: Scenario, *, progress: Progress = silent) -> NextFlight:
    """Plan another flight on this map: the scenario's vehicle, budget and policy (`greedy` if it has none).

    A policy with an acquisition gets the expected saving of each cell by the costs of the map; others use the
    estimate, as in flight. `greedy` and `orienteering` plan for the whole budget, others only up to their
    next decision.

    Raises
    ------
    WbfMissionError
        If the policy finds nothing worth a flight, or no path fits the budget.
    """
    farm, names = of.farm, scenario.vehicle.fleet
    choice = scenario.mission.policy or Choice("greedy")
    policy, label = _policy(of, choice), f"policy {choice}"
    one = SingleVehicle(
        replace(scenario.vehicle, name=names[0], autopilot=scenario.vehicle.autopilots[0], vehicles=None),
        replace(scenario.mission, policy=choice, file=None),
        scenario.weather,
        scenario.camera,
    )
    (vehicle,) = vehicles_of(one, farm, seed=scenario.seed, first_day=of.day, progress=progress)
    progress("planning", 0, 1)
    knowledge = Knowledge(
        farm, of.day, of.fields, ScoreWeights.of(of.fields), lambda: of.model, lambda: of.observations
    )
    policy.start()
    loop = DecisionLoop(policy, label, knowledge, records=[])
    decision = loop.start([vehicle.task.report(steered=True)]).decision
    budget = vehicle.task.budget_text
    if not len(decision.paths[vehicle.task.system_id]):
        raise PlanningError(f"{label} finds nothing worth another flight on this map within {budget}")
    plan = vehicle.task.plan_of(decision, str(choice), steered=True)
    progress("planning", 1, 1)
    seen = _cells_shown(farm, image_places(farm, plan.mission, plan.prediction), scenario.camera.footprint)
    gain = gain_of_all = looked_at = 0.0
    for each in of.zone_maps:
        cells = seen & each.field.mask(farm.grid())
        side = each.of.grid.pixel
        looks = np.zeros(each.zone.shape)
        x, y = np.nonzero(cells)
        np.add.at(looks, (x // side, y // side), 1.0)
        gain += each.gain_of_looks(looks)
        gain_of_all += float(np.nansum(each.gain * each.hectares))
        looked_at = max(looked_at, len(x) * farm.cell_size_m**2 / 1e4)
    if gain <= 0.0:
        raise PlanningError(f"{label} finds no path on which a look would save anything within {budget}")
    return NextFlight(plan, one, str(choice), gain, gain_of_all, looked_at)


def _policy(of: TreatmentMap, choice: Choice) -> Policy:
    if choice.made is not None:
        return make_policy(choice.made)
    known = policy_parameters(choice.name)
    wanted: dict[str, Any] = {**_WHOLE_FLIGHT.get(choice.name, {})}
    if "acquisition" in known:
        wanted["acquisition"] = _gain_of_cells(of)
    return make_policy(choice.name, **{**wanted, **choice.params})


def _gain_of_cells(of: TreatmentMap) -> Acquisition:
    """Return an acquisition: the expected saving of each cell, its share of its block's."""

    def acquisition(observation: PolicyObservation) -> ValueMap:
        grid = observation.farm.grid()
        total = np.zeros(grid.shape, np.float32)
        for each in of.zone_maps:
            side, (width, height) = each.of.grid.pixel, grid.shape
            gain = np.nan_to_num(each.gain).astype(np.float32)
            fine = np.repeat(np.repeat(gain, side, axis=0), side, axis=1)[:width, :height]
            total += np.where(each.field.mask(grid), fine, np.float32(0.0))
        return total

    return acquisition


def _cells_shown(farm: Farm, places_m: Points, footprint: int) -> NDArray[np.bool_]:
    """Mark the cells that images taken at some places show."""
    shown = np.zeros(farm.grid().shape, np.bool_)
    ix, iy = farm.cell_of(places_m[:, 0], places_m[:, 1])
    dx, dy = footprint_offsets(footprint)
    x, y = (ix[:, None] + dx).ravel(), (iy[:, None] + dy).ravel()
    inside = (x >= 0) & (x < farm.width_cells) & (y >= 0) & (y < farm.height_cells)
    shown[x[inside], y[inside]] = True
    return shown
