"""Audits benchmark rows: they must be complete, consistent and possible."""

from __future__ import annotations

import functools
import itertools
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geo.errors import WbfMissionError
from geo.texts import one_line
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from wbf_mission.addons.boards.limits import Limits, impossible, limits_of
from wbf_mission.bench.digests import meaning_of
from wbf_mission.bench.requests import read_asked
from wbf_mission.bench.rows import BenchRow, by_pair, by_scenario
from wbf_mission.bench.spec import require_mover, run_keys, seed_ranges, seeds_of
from wbf_mission.results.storage import ResultError
from wbf_mission.run.estimation import estimator_of
from wbf_mission.scenario import Choice, load_scenario, scenario_ids
from wbf_mission.scenario.choice import choose, names_of, registered_elsewhere

_LEAST_ERROR = 1e-9
_MOST_LOSS = 1e6
_MOST_ROWS, _MOST_METHODS, _MOST_SEEDS = 100_000, 300, 10_000
_DIGEST = re.compile(r"[0-9a-f]{24}")
_KINDS = ("planner", "estimator")
FILES = "its parameters name local files"


def require_asked(rows: Sequence[BenchRow], folder: Path) -> None:
    """Raise ResultError unless the rows cover every run requested in their folder."""
    there = {(row.scenario, row.planner, row.estimator, row.seed) for row in rows}
    for one in read_asked(folder).asked:
        table = tomllib.loads(one.specification)
        # The lists leave out Python objects: the specification names these only in a comment.
        names = [table.get(key, []) for key in ("scenarios", "planners", "estimators")]
        missing = [
            run for run in itertools.product(*names, seeds_of(str(table["seeds"]))) if run not in there
        ]
        if missing:
            scenario, planner, estimator, seed = missing[0]
            first = f"such as {scenario}, {planner}, {estimator}, seed {seed}"
            msg = f"has no rows for {len(missing)} requested runs, {first}; fly them, or use a new folder"
            raise ResultError(msg)


def require_whole(rows: Sequence[BenchRow], *, sealed: bool = False) -> None:
    """Raise ResultError unless rows are complete, consistent, possible and share their behaviour numbers.

    The seeds of each scenario must have no gap, except in a `sealed` round. The error message is one line,
    which names the fault and then the remedy. Rows of failed runs pass: boards show them as failed.
    """
    _require_one_behaviour(rows)
    if len(rows) > _MOST_ROWS:
        raise ResultError(f"holds {len(rows)} rows, more than {_MOST_ROWS}; make several submissions")
    scenarios = by_scenario(rows)
    for scenario, here in scenarios.items():
        _require_meaning(scenario, here[0].codes["scenario"])
        _require_methods(scenario, here)
    for scenario, here in scenarios.items():
        _require_complete(scenario, here)
        if not sealed:
            _require_all_seeds(scenario, {row.seed for row in here})
        limits = limits_of(scenario)
        for row in here:
            strange = "" if row.key in run_keys(row) else "its key does not belong to this run"
            if why := strange or _inconsistency(row, limits) or impossible(row, limits):
                raise ResultError(f"{one_line(row.named)}: {why}; fly it again into a new folder")


def _require_one_behaviour(rows: Sequence[BenchRow]) -> None:
    if not all({"code", "scenario"} <= row.codes.keys() for row in rows):
        raise ResultError("some rows do not name the code that flew them; fly them again into a new folder")
    behaviours = {row.codes["code"] for row in rows}
    if len(behaviours) > 1:
        several = ", ".join(sorted(behaviours)[:3])
        msg = f"rows of {len(behaviours)} program behaviours ({several}); fly all of them into a new folder"
        raise ResultError(msg)
    names: dict[tuple[str, str], set[str]] = {}
    for row in rows:
        for kind in ("scenario", *_KINDS):
            names.setdefault((kind, getattr(row, kind)), set()).add(row.codes.get(kind, ""))
    for (kind, name), digests in names.items():
        if len(digests) > 1:
            msg = f"{kind} {name} has {len(digests)} code digests; fly its runs again into a new folder"
            raise ResultError(msg)


def _require_meaning(scenario: str, meaning: str) -> None:
    if scenario not in scenario_ids():
        msg = f"{one_line(scenario)} is not in the catalogue; fly scenarios that 'bench list' prints"
        raise ResultError(msg)
    if meaning != _meaning(scenario):
        raise ResultError(f"the settings of {scenario} have changed since the flights; fly it again")


@functools.cache
def _built_in(kind: str) -> frozenset[str]:
    kinds = (kind, "policy") if kind == "planner" else (kind,)
    names = (name for one in kinds for name in names_of(one) if registered_elsewhere(name, one) is None)
    return frozenset(name.lower() for name in names)


@functools.cache
def _meaning(scenario: str) -> str:
    return meaning_of(load_scenario(scenario))


def _require_methods(scenario: str, rows: Sequence[BenchRow]) -> None:
    """Raise ResultError unless every planner and estimator of a scenario can be created."""
    pairs, seeds = by_pair(rows), {row.seed for row in rows}
    if len(pairs) > _MOST_METHODS or len(seeds) > _MOST_SEEDS:
        msg = f"{scenario} has {len(pairs)} methods on {len(seeds)} environments"
        raise ResultError(f"{msg}; at most {_MOST_METHODS} on {_MOST_SEEDS} fit: make several submissions")
    fields = load_field_set(load_scenario(scenario).farm.fields)
    for kind in _KINDS:
        for label, code in dict.fromkeys((getattr(row, kind), row.codes.get(kind)) for row in rows):
            why = _unusable(kind, label, fields) if code is None else ""
            if code is not None and not _DIGEST.fullmatch(code):
                why = "its code digest is malformed"
            elif code is not None and label.partition(":")[0].lower() in _built_in(kind):
                why = "it is your own code with the name of a built-in method; rename it"
            if why:
                msg = f"{kind} {one_line(label, 60) or 'without a name'}: {why}; use one that all can fly"
                raise ResultError(msg)


def names_files(choice: Choice) -> bool:
    """Return whether a method's parameters name files or folders, which untrusted rows must not access."""
    return any(key == "cache" or "/" in str(value) for key, value in choice.params.items())


def _unusable(kind: str, label: str, fields: FieldSet) -> str:
    """Return the reason why a label names no built-in planner, policy or estimator; empty if it names one."""
    try:
        choice = choose(label, kind)
        if names_files(choice):
            return FILES
        if kind == "estimator":
            estimator_of(choice, 0, fields)
        else:
            require_mover(choice)
    except WbfMissionError as error:
        return one_line(str(error), 200)
    except (TypeError, ValueError) as error:  # A constructor refuses its parameters
        return one_line(f"{type(error).__name__}: {error}", 200)
    return ""


def _require_complete(scenario: str, rows: Sequence[BenchRow]) -> None:
    """Raise ResultError unless every pair of planner and estimator has one row for each seed."""
    every = {row.seed for row in rows}
    for (planner, estimator), own in by_pair(rows).items():
        seeds = [row.seed for row in own]
        missing, label = sorted(every - set(seeds)), one_line(f"{scenario}, {planner}, {estimator}")
        if len(set(seeds)) < len(seeds):
            raise ResultError(f"{label}: two rows have the same seed; fly them again into a new folder")
        if missing:
            which = one_line(seed_ranges(missing), 60)
            raise ResultError(f"{label}: no rows for seeds {which}, which other methods have; fly them, too")


def _require_all_seeds(scenario: str, seeds: set[int]) -> None:
    """Raise ResultError if a seed between the first and the last is missing: gaps may hide bad scores."""
    first, last = min(seeds), max(seeds)
    if last - first >= len(seeds):
        which = one_line(seed_ranges(sorted(seeds)), 60)
        msg = f"{scenario}: seeds {which} have gaps between {first} and {last}; fly the missing seeds, too"
        raise ResultError(msg)


def _inconsistency(row: BenchRow, limits: Limits) -> str:
    """Return a contradiction within a row; empty if there is none."""
    scores = np.array(row.scores)
    if row.score is None or row.final_score is None or not len(scores):
        return "" if row.error is not None else "it has neither a score nor an error"
    names = tuple(limits.losses)
    if set(row.history) != set(names) or set(row.losses) != set(names):
        return f"its losses are for other fields than {', '.join(names)}"
    history = [np.array(row.history[name]) for name in names]
    if {len(row.times_s), *map(len, history)} != {len(scores)}:
        return "the lists of its history have different lengths"
    losses = np.array(history)
    numbers = (scores, losses, np.array(row.times_s), np.array([row.score, row.final_score]))
    if (
        not all(np.isfinite(number).all() for number in numbers)
        or not ((losses >= 0.0) & (losses <= _MOST_LOSS)).all()
    ):
        return "its history has a number that is not finite, or an impossible loss"
    if row.score != float(np.mean(scores)):
        return f"its score {row.score} is not the mean of the scores in its history"
    if row.final_score != scores[-1]:
        return f"its final score {row.final_score} is not the last score in its history"
    for name in names:
        if row.losses[name] != row.history[name][-1]:
            return f"its loss of {name} is not the last loss in its history"
    if (np.abs(scores + limits.parts @ losses) > _LEAST_ERROR * np.maximum(1.0, np.abs(scores))).any():
        return "its scores do not follow from its losses"
    return ""
