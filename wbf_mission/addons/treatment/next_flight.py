"""Next flight, planned on a treatment map."""

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
from wbf_mission.addons.treatment.treatment_map import TreatmentMap
from wbf_mission.planning import PlanResult
from wbf_mission.planning.fleet import SingleVehicle
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.loop import Knowledge
from wbf_mission.run.plan import plans_of, progress_events
from wbf_mission.run.resolve import resolve
from wbf_mission.scenario import Choice, Scenario

_FAR = 1e6
_WHOLE_FLIGHT = {"greedy": {"ahead": _FAR}, "orienteering": {"horizon": _FAR, "patience": _FAR}}
"""Parameters that make policies plan for the whole budget, because each policy decides only once here."""


@dataclass(frozen=True, slots=True)
class NextFlight:
    """Next flight, planned on a treatment map, with the saving expected from the flight."""

    plan: PlanResult
    vehicle: SingleVehicle
    policy: str
    gain: float  # Expected saving by the flight, in the unit of the costs
    gain_of_all: float  # Expected saving by perfect information on the whole farm
    looked_at_ha: float  # Area of crops that the images show

    def summary(self) -> dict[str, object]:
        """Return the plan and the gains as plain values, for JSON."""
        values = {name: getattr(self, name) for name in ("policy", "gain", "gain_of_all", "looked_at_ha")}
        return {**values, "plan": self.plan.summary()}


def plan_next(of: TreatmentMap, scenario: Scenario, *, progress: Progress = silent) -> NextFlight:
    """Plan the next flight, using the treatment map `of` and the scenario's vehicle, budget and policy.

    The default policy is `greedy`. If the policy has a parameter "acquisition", its default here is each
    cell's expected saving by perfect information; other policies use the estimate, as in flight. `greedy` and
    `orienteering` plan for the whole budget; other policies plan only up to their next decision. Raises
    WbfMissionError if no path fits the budget, or the policy finds no flight that saves anything.
    """
    farm, fleet = of.farm, scenario.vehicle
    choice = scenario.mission.policy or Choice("greedy")
    policy, label = _policy(of, choice), f"policy {choice}"
    single = replace(
        scenario,
        farm=replace(scenario.farm, day=of.day, days=1),
        mission=replace(scenario.mission, policy=choice, file=None),
        vehicle=replace(fleet, name=fleet.fleet[0], autopilot=fleet.autopilots[0], vehicles=None),
    )
    run = resolve(single, to_fly=False, farm=farm, fields=of.fields, events=progress_events(progress))
    run = replace(run, decider=replace(run.decider, policy=policy))
    knowledge = Knowledge(farm, of.day, of.fields, run.weights, lambda: of.model, lambda: of.observations)
    (plan,) = plans_of(run, knowledge, "another flight on this map")
    (vehicle,) = run.vehicles
    budget = vehicle.task.budget_text
    progress("planning", 1, 1)
    seen = _cells_shown(farm, plan.image_places, scenario.camera.footprint)
    gain = gain_of_all = looked_at = 0.0
    for zone_map in of.zone_maps:
        cells = seen & zone_map.field.mask(farm.grid())
        side = zone_map.of.grid.pixel
        looks = np.zeros(zone_map.zone.shape)
        x, y = np.nonzero(cells)
        np.add.at(looks, (x // side, y // side), 1.0)
        gain += zone_map.gain_of_looks(looks)
        gain_of_all += float(np.nansum(zone_map.gain * zone_map.hectares))
        looked_at = max(looked_at, len(x) * farm.cell_size_m**2 / 1e4)
    if gain <= 0.0:
        raise PlanningError(f"{label} finds no path within {budget} on which a new look would save anything")
    return NextFlight(plan, vehicle, str(choice), gain, gain_of_all, looked_at)


def _policy(of: TreatmentMap, choice: Choice) -> Policy:
    if choice.made is not None:
        return make_policy(choice.made)
    known = policy_parameters(choice.name)
    wanted: dict[str, Any] = {**_WHOLE_FLIGHT.get(choice.name, {})}
    if "acquisition" in known:
        wanted["acquisition"] = _gain_of_cells(of)
    return make_policy(choice.name, **{**wanted, **choice.params})


def _gain_of_cells(of: TreatmentMap) -> Acquisition:
    """Return an acquisition function: each cell's expected saving by perfect information."""

    def acquisition(observation: PolicyObservation) -> ValueMap:
        grid = observation.farm.grid()
        total = np.zeros(grid.shape, np.float32)
        for zone_map in of.zone_maps:
            side, (width, height) = zone_map.of.grid.pixel, grid.shape
            gain = np.nan_to_num(zone_map.gain).astype(np.float32)
            fine = np.repeat(np.repeat(gain, side, axis=0), side, axis=1)[:width, :height]
            total += np.where(zone_map.field.mask(grid), fine, np.float32(0.0))
        return total

    return acquisition


def _cells_shown(farm: Farm, places_m: Points, footprint: int) -> NDArray[np.bool_]:
    """Return a mask of the cells that images taken at `places_m` show."""
    shown = np.zeros(farm.grid().shape, np.bool_)
    ix, iy = farm.cell_of(places_m[:, 0], places_m[:, 1])
    dx, dy = footprint_offsets(footprint)
    x, y = (ix[:, None] + dx).ravel(), (iy[:, None] + dy).ravel()
    inside = (x >= 0) & (x < farm.width_cells) & (y >= 0) & (y < farm.height_cells)
    shown[x[inside], y[inside]] = True
    return shown
