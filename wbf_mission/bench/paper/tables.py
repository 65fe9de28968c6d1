"""The numbers of the comparison, as tables."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from wbf_mission.bench.page import Table
from wbf_mission.bench.paper.shown import ShownRun
from wbf_mission.bench.report import scores_at, standing_table
from wbf_mission.bench.row import BenchRow
from wbf_mission.bench.standings import Interval, mean_interval, standings

__all__ = ["authors_table", "early_table", "lead_table", "standings_table"]

_PARTS = (0.1, 0.2, 0.5, 1.0)


def standings_table(rows: Sequence[BenchRow]) -> Table:
    """Return the standings of one scenario's runs."""
    return standing_table("Scores over the run and at its end", standings(rows))


def early_table(rows: Sequence[BenchRow]) -> Table:
    """Return the mean score as it stands at parts of the time, with intervals of 95 %.

    Parameters
    ----------
    rows : sequence of BenchRow
        Of one scenario.
    """
    good = [row for row in rows if row.scores]
    last_s = max((row.times_s[-1] for row in good), default=0.0)
    header = ("planner, estimator", *(f"at {part * last_s:.0f} s" for part in _PARTS))
    lines = []
    for planner, estimator in sorted({(row.planner, row.estimator) for row in good}):
        own = [row for row in good if (row.planner, row.estimator) == (planner, estimator)]
        at = np.array([scores_at(row, np.array(_PARTS) * last_s) for row in own])
        cells = (_interval(mean_interval(one)) for one in at.T)
        lines.append((f"{planner}, {estimator}", *cells))
    return Table("How the score stands on the way", header, tuple(lines))


def lead_table(rows: Sequence[BenchRow]) -> Table:
    """Return who has the best mean score at parts of the time, and by how much the others are behind it.

    Differences are taken in pairs of runs in the same environment, with intervals of 95 %.

    Parameters
    ----------
    rows : sequence of BenchRow
        Of one scenario.
    """
    good = [row for row in rows if row.scores]
    last_s = max((row.times_s[-1] for row in good), default=0.0)
    at = {(row.planner, row.estimator, row.seed): row for row in good}
    planners = list(dict.fromkeys(row.planner for row in good))
    lines = []
    for estimator, part in itertools.product(dict.fromkeys(row.estimator for row in good), _PARTS):
        # Environments in which all planners have a score.
        seeds = [
            seed
            for seed in sorted({row.seed for row in good})
            if all((planner, estimator, seed) in at for planner in planners)
        ]
        if not seeds:
            continue
        time_s = np.array([part * last_s])
        scores = {
            planner: np.array([scores_at(at[planner, estimator, seed], time_s)[0] for seed in seeds])
            for planner in planners
        }
        first = max(planners, key=lambda planner: float(scores[planner].mean()))
        behind = [
            "leads" if one == first else _interval(mean_interval(scores[first] - scores[one]))
            for one in planners
        ]
        lines.append((f"{estimator}, at {part * last_s:.0f} s", *behind))
    return Table("Who leads, and by how much", ("estimator, time", *planners), tuple(lines))


def authors_table(rows: Iterable[BenchRow], shown: Mapping[tuple[str, str], ShownRun]) -> Table:
    """Return the score at the end of the runs that are shown, and what the published code makes of them."""
    lines = tuple(
        (
            f"{row.planner}, {row.estimator}",
            "-" if row.final_score is None else f"{row.final_score:.4f}",
            f"{shown[row.planner, row.estimator].axis_max:.2f}",
        )
        for row in rows
        if (row.planner, row.estimator) in shown
    )
    header = ("planner, estimator", "score at the end", "by the published code")
    return Table("The runs that are shown", header, lines)


def _interval(one: Interval) -> str:
    if np.isnan(one.low):
        return f"{one.mean:.3f}"
    return f"{one.mean:.3f} ({one.low:.3f} to {one.high:.3f})"
