"""What is kept of a run: one row."""

from __future__ import annotations

import copy
import platform
import time
from array import array
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec
import numpy as np

from geo.blame import told_error
from geo.errors import WbfMissionError
from mission.outcome import Outcome
from wbf_mission.bench.spec import BenchRun
from wbf_mission.flight import fly
from wbf_mission.run.flight_memory import memory_of_process
from wbf_mission.run.run_record import RunRecord
from wbf_mission.scenario import Scenario
from wbf_mission.version import __version__

__all__ = ["BenchRow", "Floats", "as_floats", "failed_row", "fly_run"]

if TYPE_CHECKING:
    Floats: TypeAlias = array[float]
else:
    Floats = array
    """Of type code ``d``: in a list a number takes four times as much, and a table has thousands of rows."""


def as_floats(kind: type, value: Any) -> Floats:
    """Return a list of numbers as an array: how msgspec reads the lists of a row.

    Raises
    ------
    TypeError
        If it is none.
    """
    if kind is not array or not isinstance(value, list):
        msg = f"Expected `array` of numbers, got `{type(value).__name__}`"
        raise TypeError(msg)
    return array("d", value)


def _no_floats() -> Floats:
    return array("d")


class BenchRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A run that was flown, or that failed.

    Losses are means a cell, by the names of the fields; the history has the scored times. Everything but the
    costs is decided by the run alone.

    Attributes
    ----------
    key, scenario, planner, estimator, seed
        Which run (`wbf_mission.bench.spec.BenchRun`).
    error : str or None
        Why it failed.
    score, final_score : float or None
        Over the run and at its end; 0 is perfect.
    losses : dict
        At the end.
    wall_time_s, cpu_time_s : float
        The costs: of the whole run, and by its parts in `timings_s`.
    times_s, scores, history
        Seconds of flight, the score and the losses at the scored times.
    versions : dict
        Of what flew it.
    codes : dict
        Digests of that (`wbf_mission.bench.spec.BenchRun`); empty in rows of old stores, which did not tell.
    bad_answers : dict
        How many answers of the policy were not flown, or came too late, by what was wrong with them.
    """

    key: str
    scenario: str
    planner: str
    estimator: str
    seed: int
    outcome: str | None = None
    error: str | None = None
    score: float | None = None
    final_score: float | None = None
    losses: dict[str, float] = {}
    observations: int | None = None
    cells_observed: int | None = None
    path_length_m: float | None = None
    flight_time_s: float | None = None
    predicted_time_s: float | None = None
    decisions: int | None = None
    wall_time_s: float = 0.0
    cpu_time_s: float = 0.0
    timings_s: dict[str, float] = {}
    times_s: Floats = msgspec.field(default_factory=_no_floats)
    scores: Floats = msgspec.field(default_factory=_no_floats)
    history: dict[str, Floats] = {}
    versions: dict[str, str] = {}
    codes: dict[str, str] = {}
    bad_answers: dict[str, int] = {}


def fly_run(run: BenchRun) -> BenchRow:
    """Fly a run and return its row; of a run that fails, one with the cause.

    Raises
    ------
    KeyboardInterrupt
        If it came meanwhile.
    """
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    try:
        result = fly(_fresh(run.scenario), memory=memory_of_process())
    except WbfMissionError as error:
        return failed_row(run, str(error))
    except MemoryError:
        return failed_row(run, "not enough memory")
    except Exception as error:  # a planner or estimator of somebody's: the other runs go on
        return failed_row(run, told_error(error))
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return _row(run, result, time.perf_counter() - wall_s, time.process_time() - cpu_s)


def _fresh(scenario: Scenario) -> Scenario:
    """Return the scenario with copies of a user's objects: a run is not to see what those before it left."""
    try:
        return copy.deepcopy(scenario)
    except Exception:  # an object that cannot be copied is flown as it is
        return scenario


def failed_row(run: BenchRun, cause: str) -> BenchRow:
    """Return the row of a run that gave nothing."""
    return BenchRow(**_which(run), error=" ".join(cause.split()), versions=_versions())


def _row(run: BenchRun, result: RunRecord, wall_s: float, cpu_s: float) -> BenchRow:
    summary, history = result.summary(), result.history
    good = result.outcome.is_good and not result.policy_failed
    why = f"{result.outcome.value}: {result.reason}"
    if result.outcome.is_good:
        why = result.warnings[0] if result.policy_failed else ""
    names = result.fields.names
    losses = history.field_losses
    return BenchRow(
        **_which(run),
        outcome=result.outcome.value,
        error=None if good else why,
        score=_finite(summary["score"]),
        final_score=_finite(summary["final_score"]),
        losses={name: one for name, one in summary["losses"].items() if one is not None},
        observations=summary["observations"],
        cells_observed=summary["cells_observed"],
        path_length_m=_finite(summary["path_length_m"]),
        flight_time_s=_finite(summary["flight_time_s"]),
        predicted_time_s=_finite(summary["predicted_time_s"]),
        decisions=len(result.decisions),
        bad_answers=result.bad_answers,
        wall_time_s=wall_s,
        cpu_time_s=cpu_s,
        timings_s=dict(result.timings_s),
        times_s=array("d", history.times_s),
        scores=array("d", history.scores),
        history={name: array("d", losses[:, k]) for k, name in enumerate(names)} if len(losses) else {},
        versions=_versions(),
    )


def _which(run: BenchRun) -> dict[str, Any]:
    return {
        "key": run.key,
        "scenario": run.scenario_id,
        "planner": run.planner,
        "estimator": run.estimator,
        "seed": run.seed,
        "codes": run.codes,
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None


def _versions() -> dict[str, str]:
    return {
        "wbf-mission": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
