"""Execution of benchmark runs: in this process, in several processes, or on a Dask cluster."""

from __future__ import annotations

import contextlib
import copy
import io
import marshal
import pickle
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from types import CodeType
from typing import Any, Protocol, TypeAlias, cast

import numpy as np

from geo.errors import WbfMissionError, told_error
from geo.imports import load_named
from geo.processes import CallsAhead, Processes
from mission.outcome import Outcome
from sensors.scoring.expected import calibration
from wbf_mission.bench.digests import is_own
from wbf_mission.bench.provenance import hardware, program, unlike, versions
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchRun
from wbf_mission.flight import fly
from wbf_mission.replanning.record import PLANNED_PATH
from wbf_mission.results.result import Result
from wbf_mission.run.record import RunRecord
from wbf_mission.run.reuse import memory_of_process


def fly_run(run: BenchRun) -> BenchRow:
    """Fly a run and return its row; the row of a failed run contains the cause."""
    try:
        return flown(run, memory=memory_of_process())[0]
    except WbfMissionError as error:
        return failed_row(run, str(error))
    except MemoryError:
        return failed_row(run, "not enough memory")
    except (Exception, SystemExit) as error:  # user code failed; the other runs continue
        return failed_row(run, told_error(error))


def flown(run: BenchRun, **how: Any) -> tuple[BenchRow, Result]:
    """Fly a run and return its row and its result; `wbf_mission.flight.fly` gets the keywords `how`.

    Raises
    ------
    WbfMissionError
        If the run cannot be flown.
    KeyboardInterrupt
        At Ctrl-C.
    """
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    try:
        scenario = copy.deepcopy(run.scenario)  # so that no state of the user's objects leaks between runs
    except Exception:  # an object that cannot be copied is shared by all runs
        scenario = run.scenario
    result = fly(scenario, **how)
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return _row_of(run, result, time.perf_counter() - wall_s, time.process_time() - cpu_s), result


def failed_row(run: BenchRun, cause: str) -> BenchRow:
    """Return the row of a run that gave no result."""
    return BenchRow(**_which(run), error=" ".join(cause.split()), versions=versions(), hardware=hardware())


def _row_of(run: BenchRun, result: RunRecord, wall_s: float, cpu_s: float) -> BenchRow:
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
        losses={name: loss for name, loss in summary["losses"].items() if loss is not None},
        calibration=_calibration_of(result),
        observations=summary["observations"],
        cells_observed=summary["cells_observed"],
        path_length_m=_finite(summary["path_length_m"]),
        flight_time_s=_finite(summary["flight_time_s"]),
        predicted_time_s=_finite(_predicted_time_s(result)),
        budget=summary["budget"],
        battery_used=_finite(summary["battery_used"]),
        decisions=len(result.decisions),
        bad_answers=result.bad_answers,
        wall_time_s=wall_s,
        cpu_time_s=cpu_s,
        timings_s=dict(result.timings_s),
        times_s=array("d", history.times_s),
        scores=array("d", history.scores),
        history={name: array("d", losses[:, k]) for k, name in enumerate(names)} if len(losses) else {},
        versions=versions(),
        hardware=hardware(),
    )


def _predicted_time_s(result: RunRecord) -> float | None:
    """Return the predicted time of the flights (s); for a policy, the time until its last paths would end.

    For a policy, return None unless the budget is in seconds or in steps of a second, because the cost of a
    policy's path has the unit of the budget.
    """
    if result.scenario.mission.policy is None:
        return result.predicted_time_s
    if result.plan.budget_text.partition(" ")[2] not in ("s", "steps"):
        return None
    ends: dict[tuple[int, int, int], float] = {}
    for decision in result.decisions:
        for change in decision.changes:
            if change.outcome == PLANNED_PATH or change.effect_s is not None:
                ends[decision.day, decision.flight, change.system_id] = (change.effect_s or 0.0) + change.cost
    longest: dict[tuple[int, int], float] = {}
    for (day, flight, _), end_s in ends.items():
        longest[day, flight] = max(longest.get((day, flight), 0.0), end_s)
    return sum(longest.values()) if longest else None


def _calibration_of(result: RunRecord) -> dict[str, float]:
    """Return the calibration of the last estimate on cells that were not observed on the last day."""
    if result.model is None or result.truth is None:
        return {}
    unseen = result.fields.masks(result.plan.farm.grid())
    seen = result.observations
    seen = seen[seen.day == result.days[-1].day]
    for cells, sensed in zip(unseen, seen.sensed.T, strict=True):
        cells[seen.x[sensed], seen.y[sensed]] = False
    states_deviation = all(shown.variance is not None for shown in result.maps)
    return calibration(result.model, result.truth, unseen, result.fields, states_deviation=states_deviation)


def _which(run: BenchRun) -> dict[str, Any]:
    return {
        "key": run.key,
        "scenario": run.scenario_id,
        "planner": run.planner,
        "estimator": run.estimator,
        "seed": run.seed,
        "codes": run.codes,
        "objects": run.objects,
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None


class ClusterError(WbfMissionError):
    """Raised when a cluster cannot be reached, is unsuitable or is lost."""


_Flown: TypeAlias = BenchRow | str


CLUSTERS = "wbf_mission.clusters"
"""Group of entry points; ``dask`` makes a `Cluster` from an address and a number of workers."""


class Workers(Protocol):
    """Workers that fly runs: processes of this machine or a cluster."""

    @property
    def most(self) -> int:
        """Greatest number of runs submitted at a time."""

    def submit(self, function: Callable[..., _Flown], /, *arguments: Any) -> Future[_Flown]:
        """Submit a call of `function`; only the name of the function is sent."""


class Cluster(Workers, Protocol):
    """Workers on other machines."""

    def result(self, future: Future[_Flown]) -> _Flown | None:
        """Return the result of a finished future, or None if the call killed several workers.

        ClusterError if the cluster is lost, or a worker runs different code.
        """

    def close(self) -> None:
        """Cancel the pending runs and disconnect."""


def fly_all(runs: Sequence[BenchRun], *, jobs: int = 1, dask: str | None = None) -> Iterator[BenchRow]:
    """Yield the row of each run when the run ends; only the costs in the rows depend on `jobs` and `dask`.

    `dask` is the address of a scheduler, such as ``tcp://10.0.0.1:8786``; ``local`` starts a scheduler on
    this machine with `jobs` workers.

    Raises
    ------
    ClusterError
        If the scheduler does not answer, the connection is lost, or the workers are unsuitable.
    KeyboardInterrupt
        At Ctrl-C; unfinished runs are cancelled.
    """
    from joblib import effective_n_jobs

    jobs = effective_n_jobs(jobs)
    if dask is not None:
        made: Cluster = load_named(CLUSTERS, "dask", "flies on", "the cluster", ClusterError)(dask, jobs)
        with closing(made) as cluster:
            for run, future in _ended(cluster, runs):
                yield _row(run, cluster.result(future) or _KILLED)
    elif jobs == 1:
        yield from map(fly_run, runs)
    else:
        yield from _in_processes(runs, jobs)


_KILLED = "the process that flew this run was killed; is there enough memory for the run?"


def _ended(workers: Workers, runs: Sequence[BenchRun]) -> Iterator[tuple[BenchRun, Future[_Flown]]]:
    """Submit all runs, and yield each run with its future when the run ends."""
    waiting = iter(runs)
    flying: dict[Future[_Flown], BenchRun] = {}
    while True:
        for run in waiting:
            flying[_submitted(workers, run)] = run
            if len(flying) >= workers.most:
                break
        if not flying:
            return
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            yield flying.pop(future), future


def _submitted(workers: Workers, run: BenchRun) -> Future[_Flown]:
    """Submit a run to a worker; the future's result is a row, or the cause of the failure."""
    try:
        sent = _packed(run)
    except Exception as error:  # a user's planner, policy or estimator cannot be pickled
        unsent: Future[_Flown] = Future()
        unsent.set_result(f"{_UNSENT}: {type(error).__name__}: {error}")
        return unsent
    return workers.submit(_fly_packed, *sent)


_UNSENT = "a planner, policy or estimator cannot be sent to another process"


def _row(run: BenchRun, given: _Flown) -> BenchRow:
    return failed_row(run, given) if isinstance(given, str) else given


def _packed(run: BenchRun) -> tuple[bytes, Mapping[str, str]]:
    """Return the arguments of `_fly_packed`, including user code that the other process cannot import.

    Dask alone would send only the names of the classes.
    """
    import cloudpickle

    class Pickler(cloudpickle.Pickler):  # type: ignore[misc]
        """Keeps the file names of user code for error messages; cloudpickle by itself drops them."""

        def reducer_override(self, obj: Any) -> Any:
            if isinstance(obj, CodeType):
                return marshal.loads, (marshal.dumps(obj),)
            return super().reducer_override(obj)

    known = cloudpickle.list_registry_pickle_by_value()
    own = [
        module
        for name, module in tuple(sys.modules.items())
        if name not in known and name != "__main__" and getattr(module, "__file__", None) and is_own(name)
    ]
    for module in own:
        cloudpickle.register_pickle_by_value(module)
    try:
        sent = io.BytesIO()
        Pickler(sent).dump((fly_run, run))
        return sent.getvalue(), program()
    finally:
        for module in own:
            cloudpickle.unregister_pickle_by_value(module)


def _fly_packed(sent: bytes, theirs: Mapping[str, str]) -> _Flown:
    """Fly a run packed by another process of the same user; return its row, or the cause of the failure.

    ClusterError if this process runs a different program from the sender, because the row would differ.
    """
    if why := unlike(theirs):
        raise ClusterError(why)
    try:
        function, run = pickle.loads(sent)  # noqa: S301 (this command sent it over its pool or scheduler)
    except Exception as error:
        return f"{_UNSENT}: {type(error).__name__}: {error}"
    with contextlib.redirect_stdout(sys.stderr):  # As in `Output.progress`
        return cast("BenchRow", function(run))


def _in_processes(runs: Sequence[BenchRun], jobs: int) -> Iterator[BenchRow]:
    remaining = list(runs)
    while remaining:
        done: set[str] = set()
        try:
            with closing(Processes(jobs)) as processes:
                for run, future in _ended(processes, remaining):
                    row = _row(run, future.result())
                    done.add(run.key)
                    yield row
        except BrokenProcessPool:
            remaining = [run for run in remaining if run.key not in done]
            # One of the first `jobs` runs killed its process. Now each flies alone, so only that run fails.
            yield from map(_alone, remaining[:jobs])
            remaining = remaining[jobs:]
        else:
            return


def _alone(run: BenchRun) -> BenchRow:
    with closing(CallsAhead(_fly_packed, [_packed(run)])) as calls:
        try:
            return _row(run, calls.result(0))
        except BrokenProcessPool:
            return failed_row(run, _KILLED)
