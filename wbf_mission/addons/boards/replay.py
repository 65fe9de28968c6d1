"""A run of a benchmark that is flown again from its row, and compared with it to the bit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mission.policies.decision import AcquisitionMap
from wbf_mission.bench.engine import flown
from wbf_mission.bench.provenance import KERNELS
from wbf_mission.bench.rows import KEY_DIGITS, BenchRow
from wbf_mission.bench.spec import BenchRun, BenchSpec
from wbf_mission.events import Decided, EventStream
from wbf_mission.flight import Simulated
from wbf_mission.replanning.loop import TOO_LATE
from wbf_mission.results.result import Result
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Choice, ScenarioError
from wbf_mission.scenario.choice import names_of

_NAMED = 5
_MOST_BLOCKS = 256
_VALUES = (
    "outcome",
    "error",
    "score",
    "final_score",
    "observations",
    "cells_observed",
    "path_length_m",
    "flight_time_s",
    "predicted_time_s",
    "budget",
    "battery_used",
    "decisions",
)
_LISTS = ("times_s", "scores")
_CODES = {
    "code": "the program's behaviour",
    "scenario": "what the scenario means",
    "planner": "the planner or policy",
    "estimator": "the estimator",
}


@dataclass(frozen=True, slots=True)
class Replay:
    """A run that was flown again."""

    row: BenchRow
    """As it was kept."""
    again: BenchRow
    """As it is now."""
    result: Result
    acquisitions: tuple[AcquisitionMap | None, ...]
    """What each of its decisions was made by, where that is a map; of a large farm in larger blocks."""
    differences: tuple[str, ...]
    """In which values they differ."""
    causes: tuple[str, ...]
    """In what else they differ, which can be why."""

    @property
    def equal(self) -> bool:
        """Whether all values are equal to the bit."""
        return not self.differences

    @property
    def verdict(self) -> str:
        """What the comparison says, in a line."""
        points = len(self.row.scores)
        if self.equal:
            told = f"equal to the bit: score, final score and history ({points} scored times)"
            return f"{told}, though there is {' and '.join(self.causes)}" if self.causes else told
        why = " and ".join(self.causes) or "nothing that is known: the same code, versions, scenario and seed"
        return f"differs in {'; '.join(self.differences)}. Why: {why}"


def row_named(rows: Sequence[BenchRow], key: str, folder: Path) -> BenchRow:
    """Return the row whose key begins so.

    ResultError if there is none, or there are several.
    """
    found = [row for row in rows if row.key.startswith(key.lower())]
    if len(found) == 1:
        return found[0]
    if not found:
        msg = f"{folder}: no row has a key that begins with {key!r}; 'bench replay {folder}' lists the keys"
        raise ResultError(msg)
    named = "; ".join(f"{row.key[: max(KEY_DIGITS, len(key) + 1)]} {row.named}" for row in found[:_NAMED])
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    msg = f"{folder}: {len(found)} rows have keys that begin with {key!r}: {named}{more}; give more digits"
    raise ResultError(msg)


def run_of(row: BenchRow, *, planner: Choice | None = None, estimator: Choice | None = None) -> BenchRun:
    """Return the run that a row is of.

    Parameters
    ----------
    planner, estimator : Choice, optional
        The user's own, of which a row has only the name.

    Raises
    ------
    ScenarioError
        If its scenario is not there, or an object is missing or another one.
    """
    movers = (*names_of("planner"), *names_of("policy"))
    given = {
        "planner": _given(row, "planner", planner, movers),
        "estimator": _given(row, "estimator", estimator, names_of("estimator")),
    }
    spec = BenchSpec.of([row.scenario], [given["planner"]], [given["estimator"]], [row.seed])
    return next(spec.runs())


def _given(row: BenchRow, what: str, own: Choice | None, known: Sequence[str]) -> Any:
    """Return the planner or estimator of a row: its name with parameters, or the user's own of this name."""
    name = getattr(row, what)
    if own is not None:
        if str(own) != name:
            raise ScenarioError(f"--{what} {own} is not that of the row, {name}")
        return own
    if name.partition(":")[0].lower() not in known:
        msg = f"the {what} {name} was an object, which a row does not hold; give --{what} FILE.py:NAME"
        raise ScenarioError(msg)
    return name


def replay(row: BenchRow, run: BenchRun, *, events: EventStream, tlog: Path | None = None) -> Replay:
    """Fly a run again, and compare it with its row.

    Parameters
    ----------
    events : EventStream
        Takes what happens.
    tlog : Path, optional
        Write every MAVLink frame there.

    Raises
    ------
    WbfMissionError
        If it cannot be flown: it failed then, too, if the row has an error.
    KeyboardInterrupt
        At Ctrl-C.
    """
    maps: dict[int, AcquisitionMap | None] = {}

    def keep(event: Decided) -> None:
        maps[id(event.record)] = None if event.acquisition is None else _pooled(event.acquisition)

    events.listen(keep, Decided)
    again, result = flown(run, events=events, by=Simulated(tlog=tlog))
    acquisitions = tuple(maps.get(id(one)) for one in result.decisions)
    return Replay(row, again, result, acquisitions, tuple(differences(row, again)), tuple(causes(row, again)))


def _pooled(acquisition: AcquisitionMap) -> AcquisitionMap:
    """Return a map of fewer blocks, each worth as much as the best in it: a run makes many."""
    values = acquisition.values
    blocks = -(-max(values.shape) // _MOST_BLOCKS)
    if blocks == 1:
        return AcquisitionMap(values.copy(), acquisition.cell_m)
    wide = np.pad(values, [(0, -side % blocks) for side in values.shape])
    parts = wide.reshape(wide.shape[0] // blocks, blocks, wide.shape[1] // blocks, blocks)
    return AcquisitionMap(parts.max(axis=(1, 3)), acquisition.cell_m * blocks)


def differences(row: BenchRow, again: BenchRow, near: float = 0.0) -> Iterator[str]:
    """Yield in which values that the run decides two rows differ, in words.

    They are compared to the bit, or within `near` where they are no whole numbers: relatively, and near 0
    absolutely.
    """
    for name in _VALUES:
        old, new = getattr(row, name), getattr(again, name)
        if old != new and not (isinstance(old, float) and isinstance(new, float) and _near(old, new, near)):
            yield f"{name} ({old!r} then, {new!r} now)"
    # How long an answer takes is the machine's.
    then, now = ({**each.bad_answers, TOO_LATE: 0} for each in (row, again))
    if then != now:
        yield f"bad_answers ({row.bad_answers} then, {again.bad_answers} now)"
    losses, others = row.losses, again.losses
    if losses != others and (
        losses.keys() != others.keys()
        or not all(_near(one, others[name], near) for name, one in losses.items())
    ):
        yield "losses"
    pairs = [(name, getattr(row, name), getattr(again, name)) for name in _LISTS]
    fields = dict.fromkeys([*row.history, *again.history])
    pairs += [(f"history of {name}", row.history.get(name), again.history.get(name)) for name in fields]
    for name, old, new in pairs:
        if old is None or new is None:
            yield name
        # Bytes: what is no number is equal to itself, and 0.0 is not -0.0.
        elif old.tobytes() != new.tobytes() and not _near(old, new, near):
            yield f"{name} ({_where(old, new)})"


def _near(old: float | Sequence[float], new: float | Sequence[float], near: float) -> bool:
    """Return whether numbers, or lists of as many, differ by no more than this; within 0 none do."""
    same_size = np.shape(old) == np.shape(new)
    return near > 0.0 and same_size and np.allclose(old, new, rtol=near, atol=near, equal_nan=True)


def _where(old: Sequence[float], new: Sequence[float]) -> str:
    """Tell from where on two histories differ, and by how much."""
    if len(old) != len(new):
        return f"{len(old)} values then, {len(new)} now"
    apart = [k for k, (one, two) in enumerate(zip(old, new, strict=True)) if one != two]
    most = max((abs(old[k] - new[k]) for k in apart), default=0.0)
    first = apart[0] + 1 if apart else 1
    return f"{len(apart)} of {len(old)} values from the {first}. on, by at most {most:.3g}"


def causes(row: BenchRow, again: BenchRow) -> Iterator[str]:
    """Yield in what else two rows differ, which can be why their values do, in words."""
    if not row.codes:
        yield "no behaviour numbers in the row"
    else:
        changed = [what for key, what in _CODES.items() if row.codes.get(key) != again.codes.get(key)]
        if changed:
            yield f"another state of {', '.join(changed)}"
    for name in dict.fromkeys([*row.versions, *again.versions]):
        old, new = row.versions.get(name, "unknown"), again.versions.get(name, "unknown")
        if old != new:
            yield f"another {name} ({old} then, {new} now)"
    old, new = (one.hardware.get(KERNELS, "") for one in (row, again))
    if old and new and old != new:
        yield f"other kernels of linear algebra ({old} then, {new} now)"
