"""Treatment map of a flight's readings, or of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from geo import Farm
from sensors.errors import ObservationError
from sensors.estimation import attribute_errors_to, checked_prediction, prepare_days
from sensors.fields import FieldSet
from sensors.observations import Observations
from wbf_mission.addons.treatment.logs import LogError, read_track
from wbf_mission.addons.treatment.logs.telemetry import observations_in
from wbf_mission.addons.treatment.readings import is_cells, join, read_readings
from wbf_mission.addons.treatment.treatment_map import TreatmentMap, costs_of
from wbf_mission.progress import Progress, silent
from wbf_mission.run.estimation import estimator_of, require_run_memory, resolved
from wbf_mission.run.record import RunRecord
from wbf_mission.run.resolve import farm_of
from wbf_mission.scenario import Scenario
from wbf_mission.scenario.parts import LAST_DAY

Costs = Mapping[str, Sequence[str]]
"""Costs as texts, as `wbf_mission.addons.treatment.treatment_map.costs_of` reads them."""


def treatment_of_log(
    scenario: Scenario,
    *,
    log: Path | None,
    observations: Path | None,
    costs: Costs | None = None,
    block_m: float | None = None,
    progress: Progress = silent,
) -> TreatmentMap:
    """Return the treatment map of a flight's readings.

    The scenario gives the farm, fields, day, footprint, estimator and seed. Without a `log` (`read_track`)
    the readings need positions. `observations` is a table of readings (`read_readings`) or a file of
    `Observations`; a .tlog of a leaf camera needs no `observations`. `costs`, `block_m`: see `treatment_map`.
    Raises WbfMissionError if a file cannot be read, a value is out of range, or no reading is on the farm.
    """
    farm, fields = farm_of(scenario.farm)
    scenario = resolved(scenario, farm, fields)
    wanted = costs_of(fields, costs or {})
    progress("reading", 0, 1)
    seen, notes = _observed(scenario, farm, fields, log, observations)
    progress("reading", 1, 1)
    sensed = seen.sensed
    notes += tuple(
        f"{field.title} was not read anywhere: its map shows only assumptions of the estimator (leave it out "
        f"of --fields)"
        for k, field in enumerate(fields)
        if not sensed[:, k].any()
    )
    estimator = estimator_of(scenario.estimate.estimator, scenario.seed, fields)
    require_run_memory(farm, estimator, len(seen))
    first, day = int(seen.day.min()), int(seen.day.max())
    # With one BLAS thread, sums in user code do not depend on the number of cores.
    with threadpool_limits(1, user_api="blas"), attribute_errors_to(estimator):
        estimator.fit(farm.grid())
        prepare_days(estimator, first, day - first + 1, progress)
        progress("estimating", 0, 1)
        estimator.partial_fit(seen)
        model = checked_prediction(estimator, fields.names, farm.grid().shape)
        progress("estimating", 1, 1)
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
        " and ".join(path.name for path in (log, observations) if path is not None),
        notes,
        knows_only_seen=getattr(estimator, "knows_only_seen", False),
    )


def treatment_of_result(
    result: RunRecord, *, costs: Costs | None = None, block_m: float | None = None, source: str = ""
) -> TreatmentMap:
    """Return the treatment map of a run's estimate at the end of the last day.

    Raises WbfMissionError if costs cannot be read, or the run has no observations.
    """
    if result.model is None or not len(result.observations):
        raise ObservationError("the run observed no cell of the farm, so there is no estimate to map")
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
                f"{log}: a {track.kind} has positions of the camera, but no readings; give --observations"
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
