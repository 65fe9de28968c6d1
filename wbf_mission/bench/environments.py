"""Selection of the rows of a scenario that count, and the scores of failed runs.

An environment (seed) counts only if every pair of planner and estimator has a row on it. A failed run counts
as the worst value of any row on its environment at any scored time, normally that of an estimate before any
observation. So neither a lucky choice of seeds nor failed runs can improve a result.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbf_mission.bench.rows import BenchRow, by_scenario
from wbf_mission.bench.spec import seed_ranges

Pair = tuple[str, str]
_NOBODY = ""
_SHOWN = 3


@dataclass(frozen=True, slots=True)
class Scored:
    """Counted rows of one scenario, as arrays float64[pairs, seeds]; nan where a field has no loss.

    Parameters
    ----------
    pairs : tuple of (str, str)
        Planners (or policies) with estimators.
    seeds : tuple of int
        Seeds of the counted environments.
    rows : tuple of tuples of BenchRow
        Rows by pair and seed.
    scores, final_scores : float64[pairs, seeds]
        Scores over the run and at its end.
    losses, final_losses : dict
        Losses by field, over the run and at its end.
    left_out : dict of int to tuple
        Environments that do not count, each with the pairs without a row on it; the tuple is empty if all
        have a row but none a score.
    """

    scenario: str
    pairs: tuple[Pair, ...]
    seeds: tuple[int, ...]
    rows: tuple[tuple[BenchRow, ...], ...]
    scores: NDArray[np.float64]
    final_scores: NDArray[np.float64]
    losses: dict[str, NDArray[np.float64]]
    final_losses: dict[str, NDArray[np.float64]]
    left_out: dict[int, tuple[Pair, ...]]

    def environments_in_words(self) -> str:
        """Return the counted environments, the others, and the pairs that lack them, in words."""
        count = f"{len(self.seeds)} environments count" + (f" ({_seeds(self.seeds)})" if self.seeds else "")
        if not self.left_out:
            return f"{count}."
        lacking: dict[str, list[int]] = {}
        for seed, pairs in sorted(self.left_out.items()):
            for name in [", ".join(pair) for pair in pairs] or [_NOBODY]:
                lacking.setdefault(name, []).append(seed)
        unscored = lacking.pop(_NOBODY, [])
        missing = [f"{name} ({_seeds(seeds)})" for name, seeds in lacking.items()]
        more = f" and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        missing_text = f"not all have a row there, missing are {'; '.join(missing[:_SHOWN])}{more}"
        parts = [missing_text] if missing else []
        parts += [f"nobody has a score there ({_seeds(unscored)})"] if unscored else []
        which = "does" if len(self.left_out) == 1 else "do"
        return f"{count}; {len(self.left_out)} {which} not: {' and '.join(parts)}."


def scored(rows: Sequence[BenchRow]) -> Iterator[Scored]:
    """Yield the counted rows of each scenario, sorted by the scenario's name."""
    for scenario, here in by_scenario(rows).items():
        yield _scored(scenario, here)


def _scored(scenario: str, rows: Sequence[BenchRow]) -> Scored:
    pairs = tuple(sorted({(row.planner, row.estimator) for row in rows}))
    at = {(row.planner, row.estimator, row.seed): row for row in rows}
    worst = _worst(rows)
    left_out: dict[int, tuple[Pair, ...]] = {}
    for seed in sorted({row.seed for row in rows}):
        lacking = tuple(pair for pair in pairs if (*pair, seed) not in at)
        if lacking or seed not in worst:
            left_out[seed] = lacking
    seeds = tuple(seed for seed in sorted({row.seed for row in rows}) if seed not in left_out)
    counted = tuple(tuple(at[(*pair, seed)] for seed in seeds) for pair in pairs)
    fields = list(dict.fromkeys(name for row in rows for name in (*row.losses, *row.history)))

    def table(name: str, *, over_run: bool) -> NDArray[np.float64]:
        values = [
            [
                worst[row.seed].get(name, np.nan) if row.error is not None else _value(row, name, over_run)
                for row in own
            ]
            for own in counted
        ]
        return np.array(values, dtype=np.float64).reshape(len(pairs), len(seeds))

    return Scored(
        scenario=scenario,
        pairs=pairs,
        seeds=seeds,
        rows=counted,
        scores=-table(_SCORE, over_run=True),
        final_scores=-table(_SCORE, over_run=False),
        losses={name: table(name, over_run=True) for name in fields},
        final_losses={name: table(name, over_run=False) for name in fields},
        left_out=left_out,
    )


_SCORE = ""
"""Key of the score among the field names; the loss of a score is its negative."""


def _value(row: BenchRow, name: str, over_run: bool) -> float:
    """Return the loss of a field, or of the score, for a successful run."""
    if name == _SCORE:
        value = row.score if over_run else row.final_score
        return np.nan if value is None else -value
    if not over_run:
        return row.losses.get(name, np.nan)
    return float(np.mean(row.history[name])) if row.history.get(name) else np.nan


def _worst(rows: Iterable[BenchRow]) -> dict[int, dict[str, float]]:
    """Return the largest loss of any row at any scored time, by seed and field; `_SCORE` included."""
    found: dict[int, dict[str, float]] = {}
    for row in rows:
        ends = [-score for score in (row.score, row.final_score) if score is not None]
        losses = {_SCORE: [*ends, *(-score for score in row.scores)]}
        for name in {*row.losses, *row.history}:
            losses[name] = [*row.history.get(name, ()), *([row.losses[name]] if name in row.losses else [])]
        for name, values in losses.items():
            # Losses of a failed run may be nan.
            if values := [loss for loss in values if np.isfinite(loss)]:
                of_seed = found.setdefault(row.seed, {})
                of_seed[name] = max(of_seed.get(name, -np.inf), *values)
    return found


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'s' if len(seeds) > 1 else ''} {seed_ranges(seeds)}"
