"""Verification of benchmark rows: some rows are flown again and compared."""

from __future__ import annotations

import secrets
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from geo.errors import WbfMissionError
from geo.processes import Processes
from geo.texts import one_line
from wbf_mission.addons.boards.audit import FILES, names_files
from wbf_mission.addons.boards.replay import causes, differences, run_of
from wbf_mission.bench.engine import fly_run
from wbf_mission.bench.rows import BenchRow, by_method
from wbf_mission.bench.spec import BenchRun
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice
from wbf_mission.scenario.choice import choose
from wbf_mission.version import behaviour

VERIFIED = 1
"""Default number of rows that are flown again for each submitted method."""
NEAR = 1e-6
"""Relative differences below this come from different linear algebra libraries, not from different code."""
EQUAL, CLOSE, OTHER, ENDLESS = "equal", f"within {NEAR:g}", "differ", "not ended"
OTHER_CODE = "flown with behaviour numbers that differ from this version's"
_MOST_S = 600.0
Method = tuple[str, str, str]
"""Scenario, planner (or policy) and estimator."""


@dataclass(frozen=True, slots=True)
class FlownAgain:
    """Comparison of a row with its second flight: `EQUAL`, `CLOSE`, `OTHER`, or `ENDLESS` (timeout)."""

    method: Method
    seed: int
    same: str
    why: str = ""
    """The differences, in words."""


@dataclass(frozen=True, slots=True)
class Verification:
    """Results of flying some rows of each method again."""

    rows: tuple[FlownAgain, ...] = ()
    left_out: tuple[tuple[Method, str], ...] = ()
    """Methods without a second flight, and the reasons."""

    @property
    def differing(self) -> tuple[FlownAgain, ...]:
        """Rows whose second flight differs or did not end."""
        return tuple(row for row in self.rows if row.same in (OTHER, ENDLESS))

    def of(self, *method: str) -> Verification:
        """Return the results of one method: scenario, planner, estimator."""
        return Verification(
            tuple(row for row in self.rows if row.method == method),
            tuple(one for one in self.left_out if one[0] == method),
        )

    def __str__(self) -> str:
        """Return, in words, the number of rows with each result, and the methods that were not flown."""
        counts = Counter(row.same for row in self.rows)
        told = [f"{counts[same]} {same}" for same in (OTHER, ENDLESS, CLOSE, EQUAL) if counts[same]]
        if self.left_out:
            reasons = ", ".join(dict.fromkeys(why for _, why in self.left_out))
            flown = len({row.method for row in self.rows})
            of = f" ({len(self.left_out)} of {flown + len(self.left_out)} methods)" if flown else ""
            told.append(f"not flown again{of}: {reasons}")
        return "; ".join(told) or "not requested"


def fly_again(
    rows: Sequence[BenchRow],
    count: int,
    *,
    own: Mapping[tuple[str, str], Choice] | None = None,
    salt: bytes | None = None,
    progress: Progress = silent,
) -> Verification:
    """Fly some rows of each method again, and compare them; failed rows are left out.

    The rows are drawn at random by the checker, so that their author cannot predict them. Only built-in
    methods and the methods in `own` (by name and digest) are flown. Without `own`, rows are flown in another
    process with a timeout of ten minutes each, as the parameters in a row may cause an endless run. `count`
    rows of each method are drawn, with the seed `salt`, by default from the system's randomness.
    """
    if count < 1:
        return Verification()
    draw = np.random.default_rng(list(secrets.token_bytes(16) if salt is None else salt))
    chosen: list[tuple[BenchRow, BenchRun]] = []
    left_out: list[tuple[Method, str]] = []
    for method, flown in by_method(rows).items():
        good = [row for row in flown if row.error is None]
        try:
            if not good:
                raise ResultError("all of its runs failed")
            drawn = [good[k] for k in draw.permutation(len(good))[:count]]
            chosen += [(row, _run_of(row, own or {})) for row in drawn]
        except WbfMissionError as error:
            left_out.append((method, one_line(str(error), 200)))
    again = (fly_run(run) for _, run in chosen) if own else _flown_apart(run for _, run in chosen)
    compared = []
    for number, (row, _) in enumerate(chosen):
        progress("flying again", number, len(chosen))
        compared.append(_compared(row, next(again)))
    return Verification(tuple(compared), tuple(left_out))


def _flown_apart(runs: Iterable[BenchRun]) -> Iterator[BenchRow | None]:
    """Fly runs in another process and yield their rows; None after a timeout or a crash."""
    waiting = iter(runs)
    while (run := next(waiting, None)) is not None:
        with closing(Processes(1)) as processes:
            while run is not None:
                try:
                    row = processes.submit(fly_run, run).result(_MOST_S)
                except (TimeoutError, BrokenProcessPool):
                    yield None
                    break
                yield row
                run = next(waiting, None)


def _compared(row: BenchRow, again: BenchRow | None) -> FlownAgain:
    why = ""
    if again is None:
        same, why = ENDLESS, f"{one_line(row.named, 200)}: the second flight did not end in {_MOST_S:g} s"
    elif not (found := list(differences(row, again))):
        same = EQUAL
    elif not list(differences(row, again, NEAR)):
        same = CLOSE
    else:
        same = OTHER
        why = f"{one_line(row.named, 200)}: {one_line('; '.join(found), 200)}"
        if known := one_line(" and ".join(causes(row, again)), 200):
            why = f"{why} (there is {known})"
    return FlownAgain((row.scenario, row.planner, row.estimator), row.seed, same, why)


def _run_of(row: BenchRow, own: Mapping[tuple[str, str], Choice]) -> BenchRun:
    """Return the run of a row; WbfMissionError if this program cannot fly the run."""
    if row.codes.get("code") != behaviour():
        raise ResultError(OTHER_CODE)
    for kind in ("planner", "estimator"):
        code = row.codes.get(kind)
        if code is not None and (getattr(row, kind), code) not in own:
            raise ResultError("own code is not run")
        if code is None and names_files(choose(getattr(row, kind), kind)):
            raise ResultError(FILES)
    planner = own.get((row.planner, row.codes.get("planner", "")))
    estimator = own.get((row.estimator, row.codes.get("estimator", "")))
    run = run_of(row, planner=planner, estimator=estimator)
    if run.codes != row.codes:
        raise ResultError("its code here is not the code that flew the row")
    return run
