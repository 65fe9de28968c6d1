"""Treatment map of a flight's readings, and the next flight planned on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo import Farm
from mission.errors import PlanningError
from mission.logs import LogError, read_track
from mission.logs.telemetry import observations_in
from mission.planners.path import Points
from mission.policies.acquisition import Acquisition, ValueMap
from mission.policies.observation import PolicyObservation
from mission.policies.policy import Policy, make_policy, policy_parameters
from sensors.camera.leaf_camera import footprint_offsets
from sensors.errors import ObservationError
from sensors.estimation import attribute_errors_to, believed, prepare_days
from sensors.estimators import Estimator
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.maps.treatment import TreatmentMap
from wbf_mission.maps.zones import costs_of
from wbf_mission.planning import PlanResult
from wbf_mission.planning.coverage import image_places
from wbf_mission.planning.fleet import SingleVehicle
from wbf_mission.progress import Progress, silent
from wbf_mission.readings import is_cells, join, read_readings
from wbf_mission.replanning.loop import Knowledge
from wbf_mission.results.result import Result
from wbf_mission.run.estimation import estimator_of, naming_estimator, require_run_memory
from wbf_mission.run.plan import plans_of, progress_events
from wbf_mission.run.resolve import farm_of, resolve
from wbf_mission.scenario import Choice, Scenario
from wbf_mission.scenario.parts import LAST_DAY
from wbf_mission.scenario.scenario import PARTS

Costs = Mapping[str, Sequence[str]]
"""Costs, as `wbf_mission.maps.zones.costs_of` takes them."""
_FAR = 1e6
_WHOLE_FLIGHT = {"greedy": {"ahead": _FAR}, "orienteering": {"horizon": _FAR, "patience": _FAR}}
"""Parameters by which policies plan for the whole budget, since they decide only once here."""


def treatment_of_log(
    scenario: Scenario,
    *,
    log: Path | None,
    observations: Path | None,
    costs: Costs | None = None,
    block_m: float | None = None,
    progress: Progress = silent,
) -> TreatmentMap:
    """Return the treatment map of the readings of any flight.

    Parameters
    ----------
    scenario : Scenario
        Its farm, fields, day, footprint, estimator and seed.
    log : Path, optional
        As `mission.logs.read_track` takes it; without one the readings have to say where they were made.
    observations : Path, optional
        A table of readings (`wbf_mission.readings`), or a file of `sensors.observations.Observations`. A
        .tlog of a flight with a leaf camera has them itself.
    costs : mapping, optional
        See `wbf_mission.maps.zones.costs_of`.
    block_m : float, optional
        See `wbf_mission.maps.zones.block_grid`.

    Raises
    ------
    WbfMissionError
        If something cannot be read or is out of range, or no reading lies on the farm.
    """
    farm, fields = farm_of(scenario.farm)
    scenario = naming_estimator(scenario, farm, fields)
    wanted = costs_of(fields, costs or {})
    progress("reading", 0, 1)
    seen, notes = _observed(scenario, farm, fields, log, observations)
    progress("reading", 1, 1)
    sensed = seen.sensed
    notes += tuple(
        f"{one.title} was not read anywhere: its map shows only what is assumed of it (leave it out of"
        " --fields)"
        for k, one in enumerate(fields)
        if not sensed[:, k].any()
    )
    day = int(seen.day.max())
    model, estimator = _estimate(scenario, farm, fields, seen, progress)
    return TreatmentMap(
        farm,
        fields,
        model,
        seen,
        day,
        str(scenario.estimate.estimator),
        getattr(estimator, "states_deviation", False),
        wanted,
        block_m,
        " and ".join(one.name for one in (log, observations) if one is not None),
        notes,
        knows_only_seen=getattr(estimator, "knows_only_seen", False),
    )


def treatment_of_result(
    result: Result, *, costs: Costs | None = None, block_m: float | None = None, source: str = ""
) -> TreatmentMap:
    """Make the map of a run: its own estimate, at the end of its last day.

    Raises
    ------
    WbfMissionError
        If costs cannot be read, or the run saw nothing.
    """
    if result.model is None or not len(result.observations):
        raise ObservationError("the run saw nothing of the farm: there is no estimate to map")
    estimator = estimator_of(result.scenario.estimate.estimator, result.scenario.seed, result.fields)
    return TreatmentMap(
        result.farm,
        result.fields,
        result.model,
        result.observations,
        result.days[-1].day if result.days else int(result.observations.day.max()),
        result.estimator,
        getattr(estimator, "states_deviation", False),
        costs_of(result.fields, costs or {}),
        block_m,
        source,
        knows_only_seen=getattr(estimator, "knows_only_seen", False),
    )


def _observed(
    scenario: Scenario, farm: Farm, fields: FieldSet, log: Path | None, table: Path | None
) -> tuple[Observations, tuple[str, ...]]:
    names = fields.names
    day, footprint = scenario.farm.day, scenario.camera.footprint
    track = None if log is None else read_track(log)
    notes = () if track is None else track.notes
    if table is None:
        if log is None or track is None:
            raise LogError("there is nothing to map: give --log, --observations or both")
        if track.kind != "telemetry log":
            raise LogError(
                f"{log}: a {track.kind} says where the camera was, not what it saw; give --observations"
            )
        seen, lost = observations_in(log, farm, day, names)
        if not len(seen):
            text = "has no observations of a leaf camera on the farm"
            raise LogError(f"{log}: {text} {farm.name}; give --observations, or another --farm")
        return seen, (*notes, *lost)
    if is_cells(table):
        seen = Observations.load(table, names)
        seen.check_inside(farm.grid().shape)
        if not len(seen):
            raise ObservationError(f"{table}: holds no observations")
        if not 0 <= seen.day.min() <= seen.day.max() <= LAST_DAY:
            days = f"{seen.day.min()} to {seen.day.max()}"
            raise ObservationError(f"{table}: the days {days} are not within 0 to {LAST_DAY}")
        return seen, ()
    try:
        seen, left_out = join(read_readings(table, fields), track, farm, names, footprint, day)
    except (LogError, ObservationError) as error:
        if str(error).startswith(str(table)):
            raise
        raise ObservationError(f"{table}: {error}") from None
    return seen, (*notes, *left_out)


def _estimate(
    scenario: Scenario, farm: Farm, fields: FieldSet, seen: Observations, progress: Progress
) -> tuple[InformationModel, Estimator]:
    """Return the estimate after these observations, and the estimator."""
    estimator = estimator_of(scenario.estimate.estimator, scenario.seed, fields)
    require_run_memory(farm, estimator, len(seen))
    first = int(seen.day.min())
    # As in a flight: sums of code of the user's own do not depend on the number of cores then.
    with threadpool_limits(1, user_api="blas"), attribute_errors_to(estimator):
        estimator.fit(farm.grid())
        prepare_days(estimator, first, int(seen.day.max()) - first + 1, progress)
        progress("estimating", 0, 1)
        estimator.partial_fit(seen)
        model = believed(estimator)
        progress("estimating", 1, 1)
    return model, estimator


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
    farm, fleet = of.farm, scenario.vehicle
    choice = scenario.mission.policy or Choice("greedy")
    policy, label = _policy(of, choice), f"policy {choice}"
    parts = {name: getattr(scenario, name) for name in PARTS}
    parts["farm"] = replace(scenario.farm, day=of.day, days=1)
    parts["mission"] = replace(scenario.mission, policy=choice, file=None)
    parts["vehicle"] = replace(fleet, name=fleet.fleet[0], autopilot=fleet.autopilots[0], vehicles=None)
    one = Scenario(**parts, seed=scenario.seed)
    run = resolve(one, to_fly=False, farm=farm, fields=of.fields, events=progress_events(progress))
    run = replace(run, decider=replace(run.decider, policy=policy))
    knowledge = Knowledge(farm, of.day, of.fields, run.weights, lambda: of.model, lambda: of.observations)
    (plan,) = plans_of(run, knowledge, "another flight on this map")
    (vehicle,) = run.vehicles
    budget = vehicle.task.budget_text
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
