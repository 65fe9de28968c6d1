"""Flights of submitted code on fresh environments, whose seeds are drawn just before the flights."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from geo.errors import WbfMissionError, told_error
from geo.texts import one_line
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from wbf_mission.addons.base.intervals import Interval
from wbf_mission.addons.boards.apart import Apart, EstimatorApart, PlannerApart, PolicyApart
from wbf_mission.addons.boards.verification import OTHER_CODE, Method
from wbf_mission.bench.engine import failed_row, flown
from wbf_mission.bench.rows import BenchRow, by_method
from wbf_mission.bench.spec import BenchRun, BenchSpec
from wbf_mission.progress import Progress, silent
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice, load_scenario
from wbf_mission.scenario.choice import choose
from wbf_mission.version import behaviour

_SEED_BITS = 63
_CHANCE = 0.05


@dataclass(frozen=True, slots=True)
class Gap:
    """Scores of a method on the environments of its rows (open), and on fresh environments."""

    method: Method
    open_scores: tuple[float, ...]
    fresh_scores: tuple[float, ...]
    """A failed run gets the worst score that its method had at any scored time of any run."""
    failed: tuple[str, ...]
    """Causes of failed fresh runs."""
    gap: Interval
    """Mean fresh score minus mean open score, with Welch's interval (95 % for all methods together)."""

    @property
    def verdict(self) -> str:
        """Verdict on the gap between the scores, in words."""
        if self.gap.high < 0.0:
            return "worse on unknown environments"
        return "no significant difference"


@dataclass(frozen=True, slots=True)
class Fresh:
    """Results of `fly_fresh`: score gaps, drawn seeds, and the methods that were not flown, with reasons."""

    gaps: tuple[Gap, ...]
    seeds: dict[str, tuple[int, ...]]
    left_out: tuple[tuple[Method, str], ...]


def fly_fresh(
    rows: Sequence[BenchRow], folder: Path, environments: int, *, progress: Progress = silent
) -> Fresh:
    """Fly the submitted methods of a folder on fresh environments, each method in a separate process.

    The seeds of a scenario come from the system's randomness, and are the same for all its methods.
    """
    methods = by_method(row for row in rows if row.codes.keys() & {"planner", "estimator"})
    if not methods:
        raise ResultError("all its methods are built in; check them with 'bench board --verify'")
    seeds = {
        scenario: tuple(secrets.randbits(_SEED_BITS) for _ in range(environments))
        for scenario in dict.fromkeys(method[0] for method in methods)
    }
    gaps, left_out, done = [], [], 0
    for method, own in methods.items():
        try:
            if own[0].codes.get("code") != behaviour():
                raise ResultError(OTHER_CODE)
            fresh = []
            for row in _flown(own[0], folder, seeds[method[0]]):
                fresh.append(row)
                progress("flying on fresh environments", done + len(fresh), len(methods) * environments)
        except WbfMissionError as error:
            left_out.append((method, one_line(str(error), 300)))
        else:
            gaps.append(_gap(method, own, fresh, len(methods)))
        done += environments
    return Fresh(tuple(gaps), seeds, tuple(left_out))


def _flown(row: BenchRow, folder: Path, seeds: Sequence[int]) -> Iterator[BenchRow]:
    """Fly the method of `row` on `seeds`, and yield the new rows."""
    with ExitStack() as stack:
        given: dict[str, Any] = {}
        for kind in ("planner", "estimator"):
            label, digest = getattr(row, kind), row.codes.get(kind)
            if digest is None:
                given[kind] = choose(label, kind)
            else:
                fields = load_field_set(load_scenario(row.scenario).farm.fields)
                made = stack.enter_context(_apart(folder, kind, label, digest, fields))
                given[kind] = Choice(label, {}, made)
        spec = BenchSpec.of([row.scenario], [given["planner"]], [given["estimator"]], list(seeds))
        for run in spec.runs():
            yield _row_of(run)


def _apart(folder: Path, kind: str, label: str, digest: str, fields: FieldSet) -> Apart:
    if kind == "estimator":
        return EstimatorApart(folder, kind, label, digest, fields)
    found = PolicyApart(folder, kind, label, digest)
    if found.said.triggers is not None:
        return found
    found.close()
    return PlannerApart(folder, kind, label, digest)


def _row_of(run: BenchRun) -> BenchRow:
    """Fly a run without caches, in which submitted code could read the environments."""
    try:
        return flown(run, use_cache=False)[0]
    except WbfMissionError as error:
        return failed_row(run, str(error))
    except Exception as error:  # Raised by submitted code
        return failed_row(run, told_error(error))


def _gap(method: Method, own: Sequence[BenchRow], fresh: Sequence[BenchRow], methods: int) -> Gap:
    told = [score for row in (*own, *fresh) for score in (*row.scores, row.score) if score is not None]
    worst = min(told, default=np.nan)
    old, new = (
        tuple(worst if row.error is not None or row.score is None else row.score for row in each)
        for each in (own, fresh)
    )
    return Gap(method, old, new, tuple(row.error for row in fresh if row.error), _welch(old, new, methods))


def _welch(old: Sequence[float], new: Sequence[float], methods: int) -> Interval:
    """Return the difference of two means, `new` minus `old`, with Welch's interval."""
    mean = float(np.mean(new) - np.mean(old))
    if min(len(old), len(new)) < 2:
        return Interval(mean, np.nan, np.nan)
    parts = [float(np.var(each, ddof=1)) / len(each) for each in (old, new)]
    if (error := sum(parts)) == 0.0:  # Equal scores, for example if all runs failed
        return Interval(mean, mean, mean)
    freedom = error**2 / sum(part**2 / (len(each) - 1) for part, each in zip(parts, (old, new), strict=True))
    reach = float(stats.t.ppf(1.0 - _CHANCE / methods / 2.0, freedom)) * error**0.5
    return Interval(mean, mean - reach, mean + reach)
