"""Estimator of a run, number of its scores, and memory that the run needs."""

from __future__ import annotations

from geo import Farm
from geo.seeds import sealed_seed
from geo.system import require_memory
from sensors.estimators import Estimator, default_estimator, make_estimator
from sensors.estimators.base import estimator_memory
from sensors.field_files import load_field_set
from sensors.fields import PAPER_FIELDS, FieldSet
from wbf_mission.scenario import Choice, Scenario, scenario_with
from wbf_mission.scenario.choice import drawing_seed

DEFAULT_SCORE_POINTS = 25
SMALL_FARM_CELLS = 2500
LARGE_FARM_CELLS = 3_000_000
# Scores on a large farm: few for an estimator that recomputes every cell, many for an incremental estimator.
LARGE_FARM_SCORE_POINTS = 10
INCREMENTAL_SCORE_POINTS = 100
_FLIGHTS_SCORED_IN_FULL = 6
_LEAST_POINTS = 5

# Bytes per cell of the truth, of the environment (two onset days and soil), and of crop map and masks.
_RUN_BYTES_A_CELL = 12 + 6 + 8
_PROGRAM_BYTES = 300_000_000


def resolved(scenario: Scenario, farm: Farm | None = None, fields: FieldSet | None = None) -> Scenario:
    """Return the scenario with an estimator; by default, the estimator for its `farm` and `fields`."""
    if scenario.estimate.estimator is not None:
        return scenario
    names = (load_field_set(scenario.farm.fields) if fields is None else fields).names
    if scenario.camera.fields is not None and names == PAPER_FIELDS.names:
        names = tuple(dict.fromkeys(name for sensed in scenario.camera.by_vehicle for name in sensed))
    chosen = default_estimator(scenario.farm.load() if farm is None else farm, names)
    return scenario_with(scenario, {"estimator": chosen})


def estimator_of(choice: Choice, seed: int, fields: FieldSet) -> Estimator:
    """Return the chosen estimator; its seed does not reveal the run's seed."""
    drawn = sealed_seed(drawing_seed(choice, "estimator", seed), "estimator")
    return make_estimator(choice.chosen, fields=fields, random_state=drawn, **choice.params)


def score_points(farm: Farm, estimator: Estimator) -> int:
    """Return the default number of scores of a flight on this farm."""
    if farm.width_cells * farm.height_cells <= LARGE_FARM_CELLS:
        return DEFAULT_SCORE_POINTS
    incremental = getattr(estimator, "incremental", False)
    return INCREMENTAL_SCORE_POINTS if incremental else LARGE_FARM_SCORE_POINTS


def points_a_flight(points: int, flights: int) -> int:
    """Return the number of scores per flight.

    In runs of up to six flights, each flight has ``points`` scores. In longer runs, the flights share the
    scores of six flights, but each has at least five.

    Examples
    --------
    >>> [points_a_flight(25, flights) for flights in (1, 6, 10, 30, 100)]
    [25, 25, 15, 5, 5]
    """
    return min(points, max(_LEAST_POINTS, _FLIGHTS_SCORED_IN_FULL * points // flights))


def readings_a_score(
    points: int | None, farm: Farm, estimator: Estimator, flights: int, expected: float, *, ideal: bool
) -> int:
    """Return the number of observations between two scores."""
    if points is None:
        if ideal and farm.owner_cells <= SMALL_FARM_CELLS:
            return 1
        points = points_a_flight(score_points(farm, estimator), flights)
    return max(1, round(expected / points))


def require_run_memory(farm: Farm, estimator: Estimator, n_observations: int) -> None:
    """Raise NotEnoughMemoryError if the run does not fit into memory."""
    shape = (farm.width_cells, farm.height_cells)
    estimate = estimator_memory(estimator, shape, n_observations)
    require_memory(
        f"flying {farm.name} ({shape[0]} x {shape[1]} cells) with {type(estimator).__name__}",
        {
            "estimate": estimate,
            "environment and score": _RUN_BYTES_A_CELL * shape[0] * shape[1],
            "program": _PROGRAM_BYTES,
        },
    )
