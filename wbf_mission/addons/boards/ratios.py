"""Ratios of losses: a loss of a planner or policy divided by the loss of the best fixed planner."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbf_mission.addons.base.intervals import Interval, ratio_intervals
from wbf_mission.addons.base.pages import Table
from wbf_mission.addons.base.standings import Scored, number_text
from wbf_mission.bench.rows import BenchRow

WHOLE = "whole"
"""Key of the total score, beside the names of fields."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """Losses of a planner or policy, divided by the losses of the best fixed planner with its estimator."""

    planner: str
    estimator: str
    fixed: bool
    """Whether `planner` is fixed: it decides only once, before the flight."""
    ratios: dict[str, Interval]
    """Ratio for `WHOLE` and each field; below 1 is better. The intervals of an estimator are simultaneous."""
    best: dict[str, str]
    """Best fixed planner, whose loss is the divisor, for `WHOLE` and for each field."""

    @property
    def named(self) -> str:
        """Planner and estimator."""
        return f"{self.planner}, {self.estimator}"


def by_fixed(group: Scored, *, over_run: bool) -> list[Ratio]:
    """Return, for each planner and estimator, the ratios of losses to the best fixed planner, lowest first.

    Each field has its own best fixed planner. Estimators without a fixed planner are skipped.
    """
    scores, losses = (group.scores, group.losses) if over_run else (group.final_scores, group.final_losses)
    tables = {WHOLE: -scores, **losses}
    found = []
    for estimator in sorted({estimator for _, estimator in group.pairs}):
        places = [k for k, pair in enumerate(group.pairs) if pair[1] == estimator]
        fixed = [k for k in places if _is_fixed(group.rows[k])]
        if not fixed:
            continue
        means = {name: [table[k].mean() for k in fixed] for name, table in tables.items()}
        best = {name: fixed[np.argmin(np.nan_to_num(mean, nan=np.inf))] for name, mean in means.items()}
        pairs = [(table[k], table[best[name]]) for k in places for name, table in tables.items()]
        ratios = iter(ratio_intervals(pairs, together=True))
        found += [
            Ratio(
                planner=group.pairs[k][0],
                estimator=estimator,
                fixed=k in fixed,
                ratios={name: next(ratios) for name in tables},
                best={name: group.pairs[which][0] for name, which in best.items()},
            )
            for k in places
        ]
    return sorted(found, key=lambda ratio: (ratio.estimator, ratio.ratios[WHOLE].mean))


def _is_fixed(rows: Sequence[BenchRow]) -> bool:
    good = [row.decisions for row in rows if row.error is None]
    return bool(good) and set(good) == {1}


def ratio_table(ratios: Sequence[Ratio], when: str) -> Table:
    """Return a table of loss ratios; for each estimator, an extra line names the best fixed planners."""
    names = list(ratios[0].ratios) if ratios else []
    lines: list[tuple[str, ...]] = []
    estimators: set[str] = set()
    for ratio in ratios:
        if ratio.estimator not in estimators:
            estimators.add(ratio.estimator)
            best = (ratio.best[name] for name in names)
            lines.append((f"the best fixed planner, {ratio.estimator}", *best))
        lines.append((ratio.named, *(_ratio(ratio.ratios[name]) for name in names)))
    title = f"Losses divided by those of the best fixed planner of each column, {when} (below 1 is better)"
    return Table(title, ("planner, estimator", *names), tuple(lines))


def _ratio(ratio: Interval) -> str:
    low, high = ratio.low, ratio.high
    interval = "" if math.isnan(low) or low == high else f" ({low:.2f} to {high:.2f})"
    return number_text(ratio.mean, 2) + interval.replace(" to inf", " or more")


def worse_in_words(ratios: Sequence[Ratio], when: str) -> str:
    """Return a sentence that lists policies with significantly larger losses than the best fixed planner."""
    worse: dict[str, list[str]] = {}
    for policy in ratios:
        for name, ratio in policy.ratios.items():
            if ratio.low > 1.0 and not policy.fixed:
                text = f"{policy.named} ({ratio.mean:.2f} times {policy.best[name]})"
                worse.setdefault(name, []).append(text)
    listed = "; ".join(f"{name} with {' and '.join(policies)}" for name, policies in worse.items())
    return f"Losses {when} that are larger than those of the best fixed planner: {listed}." if worse else ""
