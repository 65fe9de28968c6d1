"""Whether rows of a benchmark are what they say: complete, consistent, and the same when flown again."""

from __future__ import annotations

import functools
import hashlib
import itertools
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geo.errors import WbfMissionError
from geo.texts import one_line
from geo.workers import Processes
from sensors.scoring.score import ScoreWeights
from wbf_mission.bench.asked import read_asked
from wbf_mission.bench.engine import fly_run
from wbf_mission.bench.meaning import built_in_digest, meaning_of
from wbf_mission.bench.replay import causes, differences, run_of
from wbf_mission.bench.rows import BenchRow, by_pair, by_scenario
from wbf_mission.bench.spec import BenchRun, seeds_of, seeds_text
from wbf_mission.planning.plan import farm_of
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice, load_scenario, scenario_ids
from wbf_mission.scenario.choice import choose

VERIFIED = 3
"""So many rows of a submission are flown again where nobody says how many."""
_MOST_S = 600.0
_LEAST_ERROR = 1e-9
NEAR = 1e-6
"""Scores that differ by less were flown by the same code with other libraries for linear algebra."""


def require_asked(rows: Sequence[BenchRow], folder: Path) -> None:
    """Raise ResultError unless rows have all runs that their folder was asked for."""
    there = {(row.scenario, row.planner, row.estimator, row.seed) for row in rows}
    for one in read_asked(folder).asked:
        table = tomllib.loads(one.specification)
        # What was given as an object stands only in a comment.
        names = [table.get(key, []) for key in ("scenarios", "planners", "estimators")]
        missing = [
            run for run in itertools.product(*names, seeds_of(str(table["seeds"]))) if run not in there
        ]
        if missing:
            scenario, planner, estimator, seed = missing[0]
            first = f"such as {scenario}, {planner}, {estimator}, seed {seed}"
            msg = f"lacks {len(missing)} runs that were asked for, {first}; fly them, or use a new folder"
            raise ResultError(msg)


def require_whole(rows: Sequence[BenchRow]) -> None:
    """Raise ResultError unless rows can be published: of one code, complete, and consistent in themselves.

    The text is one line that begins with what is wrong, and says what to do. Rows of runs that failed are in
    order: they are told as failed.
    """
    _require_one_code(rows)
    scenarios = by_scenario(rows)
    for scenario, here in scenarios.items():
        _require_meaning(scenario, here[0].codes["scenario"])
    for scenario, here in scenarios.items():
        _require_complete(scenario, here)
        parts = _field_parts(scenario)
        for row in here:
            if why := _inconsistency(row, parts):
                raise ResultError(f"{one_line(row.named)}: {why}; fly it again into a new folder")


def _require_one_code(rows: Sequence[BenchRow]) -> None:
    if not all({"code", "scenario"} <= row.codes.keys() for row in rows):
        raise ResultError("some rows do not tell which code flew them; fly them again into a new folder")
    for what, values in (
        ("versions of wbf-mission", {row.versions.get("wbf-mission", "") for row in rows}),
        ("states of its code", {row.codes["code"] for row in rows}),
    ):
        if len(values) > 1:
            several = ", ".join(sorted(values)[:3])
            raise ResultError(f"rows of {len(values)} {what} ({several}); fly all of them into a new folder")
    names: dict[tuple[str, str, str], set[str]] = {}
    for row in rows:
        for kind in ("scenario", "planner", "estimator"):
            key = (row.scenario if kind == "scenario" else "", kind, getattr(row, kind))
            names.setdefault(key, set()).add(row.codes.get(kind, ""))
    for (_, kind, name), digests in names.items():
        if len(digests) > 1:
            msg = f"{kind} {name} stands for {len(digests)} things; fly all of one into a new folder"
            raise ResultError(msg)


def _require_meaning(scenario: str, meaning: str) -> None:
    if scenario not in scenario_ids():
        msg = f"{one_line(scenario)} is no id of the catalogue; fly scenarios that 'bench list' prints"
        raise ResultError(msg)
    if meaning != _meaning(scenario):
        raise ResultError(f"{scenario} meant something else when it was flown; fly it again")


@functools.cache
def _meaning(scenario: str) -> str:
    return meaning_of(load_scenario(scenario))


def _require_complete(scenario: str, rows: Sequence[BenchRow]) -> None:
    """Raise ResultError unless every planner and estimator of a scenario has each seed once."""
    every = {row.seed for row in rows}
    for (planner, estimator), own in by_pair(rows).items():
        seeds = [row.seed for row in own]
        missing, label = sorted(every - set(seeds)), one_line(f"{scenario}, {planner}, {estimator}")
        if len(set(seeds)) < len(seeds):
            raise ResultError(f"{label}: a seed is there twice; fly it again into a new folder")
        if missing:
            seeds_told = one_line(seeds_text(missing), 60)
            raise ResultError(f"{label}: seeds {seeds_told} of the others are missing; fly them, too")


@dataclass(frozen=True, slots=True)
class _Parts:
    """How much each field counts in the loss of a scenario: its weight times its cells, in parts of all."""

    names: tuple[str, ...]
    parts: NDArray[np.float64]


@functools.cache
def _field_parts(scenario: str) -> _Parts:
    farm, fields = farm_of(load_scenario(scenario).farm)
    cells = fields.masks(farm.grid()).sum(axis=(1, 2))
    weights = np.array(ScoreWeights.of(fields).field) * cells
    return _Parts(fields.names, weights / weights.sum())


def _inconsistency(row: BenchRow, fields: _Parts) -> str:
    """Return what of a row contradicts the rest of it; empty if nothing does."""
    scores = np.array(row.scores)
    if row.score is None or row.final_score is None or not len(scores):
        return "" if row.error is not None else "it has no score and no error"
    if set(row.history) != set(fields.names) or set(row.losses) != set(fields.names):
        return f"its losses are not those of {', '.join(fields.names)}"
    history = [np.array(row.history[name]) for name in fields.names]
    if {len(row.times_s), *map(len, history)} != {len(scores)}:
        return "its history has lists of several lengths"
    losses = np.array(history)
    numbers = (scores, losses, np.array(row.times_s), np.array([row.score, row.final_score]))
    if not all(np.isfinite(one).all() for one in numbers) or (losses < 0.0).any():
        return "its history has values that are no losses"
    if row.score != float(np.mean(scores)):
        return f"its score {row.score} is not the mean of its history"
    if row.final_score != scores[-1]:
        return f"its score at the end {row.final_score} is not the last of its history"
    for name in fields.names:
        if row.losses[name] != row.history[name][-1]:
            return f"its loss {name} is not the last of its history"
    if (np.abs(scores + fields.parts @ losses) > _LEAST_ERROR * np.maximum(1.0, np.abs(scores))).any():
        return "its scores are not those of its losses"
    return ""


EQUAL, CLOSE, OTHER, ENDLESS = "equal", f"within {NEAR:g}", "differ", "not ended"


@dataclass(frozen=True, slots=True)
class FlownAgain:
    """A row that was flown again, and how near it came: `EQUAL`, `CLOSE`, `OTHER`, or `ENDLESS`."""

    scenario: str
    planner: str
    estimator: str
    seed: int
    same: str
    why: str = ""
    """What differs, in words."""


@dataclass(frozen=True, slots=True)
class Verification:
    """What came of flying some rows again."""

    rows: tuple[FlownAgain, ...] = ()
    left_out: str = ""
    """Why others were not flown."""

    @property
    def differing(self) -> tuple[FlownAgain, ...]:
        """The rows that are not the same, or of which that is not known."""
        return tuple(one for one in self.rows if one.same in (OTHER, ENDLESS))

    def of(self, scenario: str, planner: str, estimator: str) -> Verification:
        """Return the part of one method."""
        key = (scenario, planner, estimator)
        return Verification(
            tuple(one for one in self.rows if (one.scenario, one.planner, one.estimator) == key)
        )

    def __str__(self) -> str:
        """Count the rows by how near they came, in words."""
        counts = Counter(one.same for one in self.rows)
        told = [f"{counts[same]} {same}" for same in (OTHER, ENDLESS, CLOSE, EQUAL) if counts[same]]
        return ", ".join(told) or "no"


def fly_again(
    rows: Sequence[BenchRow],
    count: int,
    *,
    own: Mapping[str, Choice] | None = None,
    progress: Progress = silent,
) -> Verification:
    """Fly some rows that have a score again, and compare them.

    Which rows is decided by a digest of all, so that who made the rows does not choose. Only built-in
    planners, policies and estimators fly, and those of `own`, by their digests. Without `own` they fly in
    another process, for ten minutes each at most: a row may name parameters that take for ever.
    """
    if count < 1 or not rows:
        return Verification()
    if rows[0].codes.get("code") != built_in_digest():
        return Verification(left_out="another state of the code flew them")
    chosen: list[tuple[BenchRow, BenchRun]] = []
    left_out = ""
    for row in _drawn(rows):
        run = _run_of(row, own or {})
        if isinstance(run, str):
            left_out = run
        else:
            chosen.append((row, run))
        if len(chosen) == count:
            break
    runs = [run for _, run in chosen]
    flown = map(fly_run, runs) if own else _flown_apart(runs)
    found = []
    for number, (row, _) in enumerate(chosen):
        progress("flying again", number, len(chosen))
        found.append(_compared(row, next(flown)))
    return Verification(tuple(found), left_out)


def _flown_apart(runs: Iterable[BenchRun]) -> Iterator[BenchRow | None]:
    """Yield the rows of runs that another process flies; None if one takes too long, or is killed."""
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
        same, why = ENDLESS, f"{one_line(row.named, 200)}: was not flown again in {_MOST_S:g} s"
    elif not (found := list(differences(row, again))):
        same = EQUAL
    elif _is_near(row.score, again.score) and _is_near(row.final_score, again.final_score):
        same = CLOSE
    else:
        same = OTHER
        why = f"{one_line(row.named, 200)}: {one_line('; '.join(found), 200)}"
        if known := one_line(" and ".join(causes(row, again)), 200):
            why = f"{why} (there is {known})"
    return FlownAgain(row.scenario, row.planner, row.estimator, row.seed, same, why)


def _is_near(one: float | None, other: float | None) -> bool:
    return one is not None and other is not None and abs(one - other) <= NEAR


def _drawn(rows: Sequence[BenchRow]) -> list[BenchRow]:
    """Return rows of runs that went well in an order that nobody can choose; each method comes once first."""
    good = [row for row in rows if row.score is not None and row.error is None]
    all_of = hashlib.sha256()
    for row in sorted(good, key=lambda row: row.key):
        all_of.update(repr((row.key, row.score, row.final_score)).encode())
    salt = all_of.digest()
    drawn = sorted(good, key=lambda row: hashlib.sha256(salt + row.key.encode()).digest())
    before: Counter[tuple[str, str, str]] = Counter()
    turns = []
    for row in drawn:
        method = (row.scenario, row.planner, row.estimator)
        turns.append(before[method])
        before[method] += 1
    return [drawn[k] for k in sorted(range(len(drawn)), key=turns.__getitem__)]


def _run_of(row: BenchRow, own: Mapping[str, Choice]) -> BenchRun | str:
    """Return the run of a row; if it cannot be flown here, why."""
    given: dict[str, Choice | None] = {}
    try:
        for kind in ("planner", "estimator"):
            code, label = row.codes.get(kind), getattr(row, kind)
            if code is not None and code not in own:
                return f"own code of {one_line(label, 60)} is not run"
            given[kind] = None if code is None else own[code]
            if code is None and _names_files(choose(label, kind)):
                return f"{one_line(label, 60)} names files of a machine"
        run = run_of(row, **given)
    except WbfMissionError as error:
        return str(error)
    if run.codes != row.codes:
        return f"{one_line(row.planner, 60)} or {one_line(row.estimator, 60)} is other code here"
    return run


def _names_files(choice: Choice) -> bool:
    """Return whether parameters name files or folders: a row of somebody else's is not to reach these."""
    return any(key == "cache" or "/" in str(value) for key, value in choice.params.items())
