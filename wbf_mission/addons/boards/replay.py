"""Replay of a benchmark run: fly the run of a row again, and compare the new row with it bit for bit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

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
    "scenario": "the scenario's settings",
    "planner": "the planner or policy",
    "estimator": "the estimator",
}


@dataclass(frozen=True, slots=True)
class Replay:
    """A stored row, the row `again` of its repeated run, and the differences between the two rows."""

    row: BenchRow
    again: BenchRow
    result: Result
    acquisitions: tuple[AcquisitionMap | None, ...]
    """Acquisition map of each decision, if any; pooled to larger blocks on large farms."""
    differences: tuple[str, ...]
    """Values that differ between the two rows."""
    causes: tuple[str, ...]
    """Possible causes of the differences, such as other versions."""

    @property
    def equal(self) -> bool:
        """Whether all values are equal, bit for bit."""
        return not self.differences

    @property
    def verdict(self) -> str:
        """Result of the comparison, in one line."""
        points = len(self.row.scores)
        if self.equal:
            text = f"equal to the bit: score, final score and history ({points} scored times)"
            return f"{text}, though there is {' and '.join(self.causes)}" if self.causes else text
        why = " and ".join(self.causes) or "unknown: code, versions, scenario and seed are the same"
        return f"differs in {'; '.join(self.differences)}. Possible causes: {why}"


def row_named(rows: Sequence[BenchRow], key: str, folder: Path) -> BenchRow:
    """Return the only row with a key that begins with `key`; ResultError if no row or several rows match."""
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
    """Return the benchmark run that a row describes.

    If the row's planner or estimator is an object, `planner` or `estimator` must be this object: a row stores
    only its name. ScenarioError if the row's scenario is unknown, or an object is missing or has
    another name.
    """
    mover = _given(row, "planner", planner, (*names_of("planner"), *names_of("policy")))
    learner = _given(row, "estimator", estimator, names_of("estimator"))
    return next(BenchSpec.of([row.scenario], [mover], [learner], [row.seed]).runs())


def _given(row: BenchRow, what: str, own: Choice | None, known: Sequence[str]) -> Choice | str:
    """Return the planner or estimator of a row: a name with parameters, or the user's object `own`."""
    name: str = getattr(row, what)
    if own is not None:
        if str(own) != name:
            raise ScenarioError(f"--{what} {own} is not the {what} of the row, {name}")
        return own
    if name.partition(":")[0].lower() not in known:
        msg = f"the {what} {name} was an object, which rows do not store; give --{what} FILE.py:NAME"
        raise ScenarioError(msg)
    return name


def replay(row: BenchRow, run: BenchRun, *, events: EventStream, tlog: Path | None = None) -> Replay:
    """Fly a run again and compare it with its row; WbfMissionError if the run fails.

    All events of the run go to `events`, and all its MAVLink frames to the file `tlog`.
    """
    maps: dict[int, AcquisitionMap | None] = {}

    def keep(event: Decided) -> None:
        maps[id(event.record)] = None if event.acquisition is None else _pooled(event.acquisition)

    events.listen(keep, Decided)
    again, result = flown(run, events=events, by=Simulated(tlog=tlog))
    acquisitions = tuple(maps.get(id(decision)) for decision in result.decisions)
    return Replay(row, again, result, acquisitions, tuple(differences(row, again)), tuple(causes(row, again)))


def _pooled(acquisition: AcquisitionMap) -> AcquisitionMap:
    """Return a coarser map to save memory: each block of cells has its greatest value."""
    values = acquisition.values
    blocks = -(-max(values.shape) // _MOST_BLOCKS)
    if blocks == 1:
        return AcquisitionMap(values.copy(), acquisition.cell_m)
    wide = np.pad(values, [(0, -side % blocks) for side in values.shape])
    parts = wide.reshape(wide.shape[0] // blocks, blocks, wide.shape[1] // blocks, blocks)
    return AcquisitionMap(parts.max(axis=(1, 3)), acquisition.cell_m * blocks)


def differences(row: BenchRow, again: BenchRow, near: float = 0.0) -> Iterator[str]:
    """Yield the values that differ between two rows, in words; costs are not compared.

    Values must be equal bit for bit. If `near` is above 0, floats may differ by this relative or absolute
    tolerance.
    """
    for name in _VALUES:
        old, new = getattr(row, name), getattr(again, name)
        if old != new and not (isinstance(old, float) and isinstance(new, float) and _near(old, new, near)):
            yield f"{name} ({old!r} then, {new!r} now)"
    # Late answers are not compared: the time of an answer depends on the machine.
    then, now = ({**flown.bad_answers, TOO_LATE: 0} for flown in (row, again))
    if then != now:
        yield f"bad_answers ({row.bad_answers} then, {again.bad_answers} now)"
    losses, others = row.losses, again.losses
    if losses != others and (
        losses.keys() != others.keys()
        or not all(_near(loss, others[name], near) for name, loss in losses.items())
    ):
        yield "losses"
    pairs = [(name, getattr(row, name), getattr(again, name)) for name in _LISTS]
    fields = dict.fromkeys([*row.history, *again.history])
    pairs += [(f"history of {name}", row.history.get(name), again.history.get(name)) for name in fields]
    for name, old, new in pairs:
        if old is None or new is None:
            yield name
        # Bytes are compared, so nan equals nan, and 0.0 differs from -0.0.
        elif old.tobytes() != new.tobytes() and not _near(old, new, near):
            yield f"{name} ({_where(old, new)})"


def _near(old: float | Sequence[float], new: float | Sequence[float], near: float) -> bool:
    """Return whether numbers, or lists of equal length, agree within `near`; False if `near` is 0."""
    same_size = np.shape(old) == np.shape(new)
    return near > 0.0 and same_size and np.allclose(old, new, rtol=near, atol=near, equal_nan=True)


def _where(old: Sequence[float], new: Sequence[float]) -> str:
    """Return, in words, where two histories begin to differ, and their largest difference."""
    if len(old) != len(new):
        return f"{len(old)} values then, {len(new)} now"
    apart = [k for k, (then, now) in enumerate(zip(old, new, strict=True)) if then != now]
    most = max((abs(old[k] - new[k]) for k in apart), default=0.0)
    first = apart[0] + 1 if apart else 1
    return f"{len(apart)} of {len(old)} values from the {first}. on, by at most {most:.3g}"


def causes(row: BenchRow, again: BenchRow) -> Iterator[str]:
    """Yield possible causes of differences between two rows, such as other versions, in words."""
    if not row.codes:
        yield "no record of behaviour numbers in the row"
    else:
        changed = [what for key, what in _CODES.items() if row.codes.get(key) != again.codes.get(key)]
        if changed:
            yield f"a change of {', '.join(changed)}"
    for name in dict.fromkeys([*row.versions, *again.versions]):
        old, new = row.versions.get(name, "unknown"), again.versions.get(name, "unknown")
        if old != new:
            yield f"another {name} ({old} then, {new} now)"
    old, new = (flown.hardware.get(KERNELS, "") for flown in (row, again))
    if old and new and old != new:
        yield f"other linear algebra kernels ({old} then, {new} now)"
