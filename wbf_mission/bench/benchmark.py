"""One benchmark: fly what is missing, keep it, return all rows."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path

from geo.processes import interrupts_noted
from wbf_mission.bench.engine import fly_all
from wbf_mission.bench.requests import keep_asked
from wbf_mission.bench.rows import BenchRow, BenchStore
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.bench.versions import build_of
from wbf_mission.progress import Progress, silent


class BenchmarkInterrupted(KeyboardInterrupt):
    """Ctrl-C in a benchmark.

    Parameters
    ----------
    rows : list of BenchRow
        Of the runs that ended before.
    total : int
        How many runs were wanted.
    """

    def __init__(self, rows: list[BenchRow], total: int) -> None:
        super().__init__(f"interrupted after {len(rows)} of {total} runs")
        self.rows = rows
        self.total = total


def benchmark(
    spec: BenchSpec,
    *,
    out: str | Path | None = None,
    jobs: int = 1,
    dask: str | None = None,
    retry: bool = False,
    command: str = "",
    progress: Progress | None = None,
) -> list[BenchRow]:
    """Fly every planner with every estimator in every scenario, on the environments of all seeds.

    The environment of a seed is the same for all planners and estimators, so rows can be compared in pairs. A
    run that fails gives a row with the cause.

    Parameters
    ----------
    out : path-like, optional
        Folder where each run is kept when it ends; what it holds is not flown again.
    jobs : int
        Processes at once; -1: one per core. The rows do not depend on it, but for the costs.
    dask : str, optional
        The address of a Dask scheduler whose workers fly, or ``local`` for one of this machine with `jobs`
        workers.
    retry : bool
        Fly again what failed.
    command : str
        The command line that asks for it, which the folder keeps with the specification.
    progress : callable, optional
        ``progress(what, done, total)``.

    Returns
    -------
    list of BenchRow
        Of all runs of the specification, by scenario, planner, estimator and seed.

    Raises
    ------
    ResultError
        If the folder holds something else, or another process writes it.
    ClusterError
        If Dask's scheduler or workers cannot be used, or are lost.
    OSError
        If it cannot be written.
    BenchmarkInterrupted
        At Ctrl-C, with what was flown before.
    """
    tell = progress or silent
    runs = list(spec.runs())
    wanted = {one.key for one in runs}
    rows: dict[str, BenchRow] = {}
    interrupted = False
    with contextlib.ExitStack() as stack:
        store = None if out is None else stack.enter_context(BenchStore(Path(out)))
        if out is not None:
            keep_asked(Path(out), spec, command)
        done = {} if store is None else store.done
        missing = [one for one in runs if one.key not in done or (retry and not done[one.key])]
        kept = len(runs) - len(missing)
        try:
            with interrupts_noted(at_once=True) as answer_interrupt:
                for number, row in enumerate(fly_all(missing, jobs=jobs, dask=dask), kept + 1):
                    if store is None:
                        rows[row.key] = row
                    else:
                        store.add(row)
                    tell("flying", number, len(runs))
                    answer_interrupt()
        except KeyboardInterrupt:
            interrupted = True
    if store is None:
        found = [rows[one.key] for one in runs if one.key in rows]
    else:
        found = [row for row in store.rows if row.key in wanted]
        names = {(one.scenario_id, one.planner, one.estimator, one.seed) for one in runs}
        others = [
            row
            for row in store.rows
            if row.key not in wanted and (row.scenario, row.planner, row.estimator, row.seed) in names
        ]
        if others:
            builds = "; ".join(dict.fromkeys(map(build_of, others)))
            msg = (
                f"{out}: {len(others)} rows with the names of these runs were flown with other behaviour"
                f" numbers, code, parameters or files ({builds}); they are kept, and do not count here"
            )
            warnings.warn(msg, stacklevel=2)
    if interrupted:
        raise BenchmarkInterrupted(found, len(runs))
    return found
