"""Standings of benchmark rows: scores, losses and ranks of each planner with each estimator, and tables.

An environment (seed) counts only if every pair of planner and estimator has a row on it. A failed run gets
the worst loss of any row on its environment at any scored time; the worst loss is normally that before the
first observation. Therefore, neither a lucky choice of seeds nor a failed run can improve a result.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs
from numpy.typing import NDArray
from scipy import stats

from wbf_mission.addons.base.intervals import Interval, mean_intervals, score_text
from wbf_mission.addons.base.pages import Table
from wbf_mission.bench.rows import BenchRow, build_of, by_scenario, shown_digest
from wbf_mission.bench.spec import seed_ranges

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NAMED = (("scenario", "code"), ("scenario", "scenario"), ("planner", "planner"), ("estimator", "estimator"))


def _digest(row: BenchRow, key: str) -> str:
    """Return the digest of a row's code, scenario, planner or estimator."""
    return row.codes.get(key, "built in")


def apart(rows: Sequence[BenchRow]) -> Sequence[BenchRow]:
    """Return the rows; ambiguous names are extended, so that rows with equal names ran the same code.

    A name is ambiguous if the program, a file or the user's code changed between runs, or if objects of this
    name have different parameters. The extension is the version and commit (``WBF/Miniberry-30-v1 [0.1.0,
    4622a3d6]``), an object's parameters (``UCB(beta=9.0)``), or else the start of the digest. Rows without
    ambiguous names are returned unchanged.
    """
    for name, key in _NAMED:
        words: dict[str, dict[str, str]] = {}
        for row in rows:
            text = build_of(row) if key == "code" else row.objects.get(key, "")
            words.setdefault(getattr(row, name), {}).setdefault(_digest(row, key), text)
        several = {given: _labels(given, found) for given, found in words.items() if len(found) > 1}
        if several:
            rows = [
                structs.replace(row, **{name: several[getattr(row, name)][_digest(row, key)]})
                if getattr(row, name) in several
                else row
                for row in rows
            ]
    return rows


def _labels(name: str, words: dict[str, str]) -> dict[str, str]:
    """Return a distinct label for each digest of an ambiguous name."""
    count = Counter(words.values())
    found = {}
    for digest, text in words.items():
        if text and count[text] == 1:
            found[digest] = text if text.startswith(f"{name}(") else f"{name} [{text}]"
        else:
            found[digest] = f"{name} [{', '.join(filter(None, (text, shown_digest(digest))))}]"
    return found


def builds_in_words(rows: Iterable[BenchRow]) -> str:
    """Return, in words, the versions that flew the rows, with numbers of rows; empty for one version."""
    count = Counter((build_of(row), _digest(row, "code")) for row in rows)
    if len(count) <= 1:
        return ""
    codes = {code for _, code in count}
    several = Counter(build for build, _ in count)
    builds = "; ".join(
        f"{build}{f', {shown_digest(code)}' if several[build] > 1 else ''}: {number} rows"
        for (build, code), number in count.items()
    )
    same = "of the same behaviour" if len(codes) == 1 else f"of {len(codes)} behaviours"
    return f"rows of {len(count)} versions ({builds}), {same}"


Pair = tuple[str, str]
_NOBODY = ""
_SHOWN = 3


@dataclass(frozen=True, slots=True)
class Scored:
    """The counted rows of one scenario, as arrays float64[pairs, seeds]; nan if a field has no loss."""

    scenario: str
    pairs: tuple[Pair, ...]
    """Pairs of a planner (or policy) and an estimator."""
    seeds: tuple[int, ...]
    """Seeds of the counted environments."""
    rows: tuple[tuple[BenchRow, ...], ...]
    """Rows by pair and seed."""
    scores: NDArray[np.float64]
    """Scores over the run; `final_scores` are the scores at the end of the run."""
    final_scores: NDArray[np.float64]
    losses: dict[str, NDArray[np.float64]]
    """Losses by field over the run; `final_losses` are the losses at the end of the run."""
    final_losses: dict[str, NDArray[np.float64]]
    left_out: dict[int, tuple[Pair, ...]]
    """Seeds that do not count, each with the pairs that have no row on it; no pairs if all runs failed."""

    def environments_in_words(self) -> str:
        """Return, in words, which environments count, and which pairs lack rows on the other environments."""
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
        missing_text = f"there is no row of {'; '.join(missing[:_SHOWN])}{more}"
        parts = [missing_text] if missing else []
        parts += [f"no run has a score ({_seeds(unscored)})"] if unscored else []
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
"""Key of the score in mappings by field; the loss under this key is the negative score."""


def _value(row: BenchRow, name: str, over_run: bool) -> float:
    """Return the loss of a field, or the negative score, of a successful run."""
    if name == _SCORE:
        value = row.score if over_run else row.final_score
        return np.nan if value is None else -value
    if not over_run:
        return row.losses.get(name, np.nan)
    return float(np.mean(row.history[name])) if row.history.get(name) else np.nan


def _worst(rows: Iterable[BenchRow]) -> dict[int, dict[str, float]]:
    """Return the largest loss of any row at any scored time, by seed and by field or `_SCORE`."""
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


@dataclass(frozen=True, slots=True)
class Standing:
    """Result of a planner with an estimator, over the counted environments of a scenario (`scored`)."""

    scenario: str
    planner: str
    estimator: str
    environments: int
    failed: int
    """Number of failed runs, including runs on environments where every run failed; they count as worst."""
    score: Interval
    """Mean over the environments of a run's mean score; 0 is perfect."""
    final_score: Interval
    """Mean over the environments of the score at a run's end; 0 is perfect."""
    behind: Interval
    """Score of the scenario's best pair minus the score of this pair, on the same environments.

    The intervals of a scenario hold jointly in 95 of 100 cases. The best pair has 0 and no interval."""
    losses: dict[str, float]
    """Mean loss per cell at the end, by field."""
    losses_over_run: dict[str, float]
    """Mean loss per cell over the scored times, by field."""
    rank: float
    """Mean rank by score over the seeds, among all pairs of the scenario; 1 is the best."""
    wins: float
    """Number of seeds with the best score; k pairs that share a win get 1/k each."""
    wall_time_s: float
    """Mean wall time of the successful runs (s)."""
    cpu_time_s: float
    """Mean CPU time of the successful runs (s)."""
    decisions: int
    """Number of answers of the policy in all runs."""
    bad_answers: dict[str, int]
    """Number of answers that were not flown or came too late, by fault; answers in failed runs count."""

    @property
    def named(self) -> str:
        """Names of the planner and the estimator."""
        return f"{self.planner}, {self.estimator}"

    @property
    def bad_share(self) -> float:
        """Fraction of bad answers; nan for a planner, which answers only once per run."""
        if self.decisions <= self.environments and not self.bad_answers:
            return np.nan
        return sum(self.bad_answers.values()) / max(self.decisions, 1)


def standings(rows: Sequence[BenchRow]) -> list[Standing]:
    """Return the standing of each planner with each estimator, by scenario, best score first.

    Rows of different code get different names (`apart`).
    """
    return [standing for group in scored(apart(rows)) for standing in standings_of(group)]


def standings_of(group: Scored) -> list[Standing]:
    """Return the standings in one scenario, best score first."""
    ranks, wins = _places(group.scores)
    means, ends = mean_intervals(group.scores), mean_intervals(group.final_scores)
    best = max(range(len(means)), key=lambda k: (np.isfinite(means[k].mean), means[k].mean))
    behind = mean_intervals([group.scores[best] - own for own in group.scores], together=True)
    all_failed = sum(not lacking for lacking in group.left_out.values())
    found = []
    for k, (planner, estimator) in enumerate(group.pairs):
        own = group.rows[k]
        good = [row for row in own if row.error is None]
        found.append(
            Standing(
                scenario=group.scenario,
                planner=planner,
                estimator=estimator,
                environments=len(own),
                failed=len(own) - len(good) + all_failed,
                score=means[k],
                final_score=ends[k],
                behind=Interval(0.0, np.nan, np.nan) if k == best else behind[k],
                losses=_means(group.final_losses, k),
                losses_over_run=_means(group.losses, k),
                rank=float(ranks[k]),
                wins=float(wins[k]),
                wall_time_s=_mean(row.wall_time_s for row in good),
                cpu_time_s=_mean(row.cpu_time_s for row in good),
                decisions=sum(row.decisions or 0 for row in own),
                bad_answers=dict(sum((Counter(row.bad_answers) for row in own), Counter[str]())),
            )
        )
    return sorted(found, key=lambda standing: (np.isnan(standing.score.mean), -standing.score.mean))


def _means(losses: dict[str, NDArray[np.float64]], k: int) -> dict[str, float]:
    """Return the mean loss of pair `k`, by field; fields without a finite loss are left out."""
    return {name: _mean(table[k]) for name, table in losses.items() if np.isfinite(table[k]).any()}


def _mean(values: Iterable[float]) -> float:
    known = np.array([value for value in values if np.isfinite(value)])
    return float(known.mean()) if len(known) else np.nan


def _places(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean rank and the wins of each row of `scores`, float64[rows, seeds]; nan without seeds."""
    if not scores.shape[1]:
        return np.full(len(scores), np.nan), np.zeros(len(scores))
    ranks = stats.rankdata(-scores, axis=0, method="average")
    best = scores == scores.max(axis=0)
    return ranks.mean(axis=1), (best / best.sum(axis=0)).sum(axis=1)


SCORES = "Scores over the run and at its end"
_POINTS = 200
_FEWEST_FOR_A_BAND = 5


def standing_table(title: str, found: Sequence[Standing], *, whole: bool = False) -> Table:
    """Return a table of standings; with `whole`, it has a column `scenario` for several scenarios."""
    named = ("scenario", "planner or policy", "estimator") if whole else ("planner, estimator",)
    header = (*named, "run", "95 %", "end", "95 %", "rank", "wins", "runs", "bad answers", "CPU, s")
    rows = tuple(
        (
            *((standing.scenario, standing.planner, standing.estimator) if whole else (standing.named,)),
            *interval_cells(standing.score),
            *interval_cells(standing.final_score),
            number_text(standing.rank, 1),
            f"{standing.wins:.3g}",
            f"{standing.environments}" + (f", {standing.failed} failed" if standing.failed else ""),
            "-" if math.isnan(standing.bad_share) else f"{standing.bad_share:.1%}",
            number_text(standing.cpu_time_s, 2),
        )
        for standing in found
    )
    return Table(title, header, rows)


def field_table(found: Sequence[Standing]) -> Table:
    """Return a table of the loss of each field in one scenario, over the run and at its end."""
    fields = list(dict.fromkeys(name for standing in found for name in standing.losses))
    rows = tuple(
        (
            standing.named,
            *(
                score_text(losses.get(name, math.nan))
                for name in fields
                for losses in (standing.losses_over_run, standing.losses)
            ),
        )
        for standing in found
    )
    header = ("planner, estimator", *(f"{name}, {when}" for name in fields for when in ("run", "end")))
    return Table("Mean loss per cell of each field", header, rows)


def interval_cells(of: Interval) -> tuple[str, str]:
    """Return two table cells: a mean, and its interval."""
    limits = "-" if math.isnan(of.low) else f"{score_text(of.low)} to {score_text(of.high)}"
    return score_text(of.mean), limits


def number_text(value: float, digits: int) -> str:
    """Return a number with `digits` digits after the point; nan becomes "-"."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def score_over_time(rows: Sequence[BenchRow]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return evenly spaced times (s), and the rows' scores at these times, float64[runs, times]."""
    last_s = max(row.times_s[-1] for row in rows)
    times_s = np.linspace(0.0, last_s, _POINTS)
    return times_s, np.array([scores_at(row, times_s) for row in rows])


def scores_at(row: BenchRow, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a run's latest score at each time; before the first scored time, the first score."""
    at = np.searchsorted(row.times_s, times_s, side="right") - 1
    return np.array(row.scores)[np.maximum(at, 0)]


def draw_mean_score(
    axes: Axes,
    rows: Sequence[BenchRow],
    label: str,
    colour: str,
    *,
    alpha: float,
    linewidth: float | None = None,
) -> None:
    """Draw the mean score of rows over time, with a 95 % band for five or more rows."""
    times_s, scores = score_over_time(rows)
    means = scores.mean(axis=0)
    axes.plot(times_s, means, color=colour, label=label, linewidth=linewidth)
    if len(rows) >= _FEWEST_FOR_A_BAND:
        band = mean_intervals(scores.T)
        limits = [interval.low for interval in band], [interval.high for interval in band]
        axes.fill_between(times_s, *limits, color=colour, alpha=alpha, linewidth=0.0)
