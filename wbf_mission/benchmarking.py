"""Many runs in one table: planners against estimators over seeds."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geo.interrupts import ignore_interrupts
from wbf_mission.scenario import Choice, Scenario, scenario_with


@dataclass(frozen=True, slots=True)
class BenchmarkRow:
    """One planner with one estimator over all seeds.

    Parameters
    ----------
    planner, estimator : str
    score, final_score : tuple of float
        Of each seed, in the order of the seeds; 0 is perfect.
    losses : tuple of dict
        Mean loss a cell of each field at the end, of each seed.
    observations : tuple of int
    wall_time_s : float
        Of all runs together.
    """

    planner: str
    estimator: str
    score: tuple[float, ...]
    final_score: tuple[float, ...]
    losses: tuple[dict[str, float], ...]
    observations: tuple[int, ...]
    wall_time_s: float

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "planner": self.planner,
            "estimator": self.estimator,
            "seeds": len(self.score),
            "score_mean": float(np.mean(self.score)),
            "score_std": float(np.std(self.score)),
            "final_score_mean": float(np.mean(self.final_score)),
            "final_score_std": float(np.std(self.final_score)),
            "losses_mean": {
                name: float(np.mean([row[name] for row in self.losses])) for name in self.losses[0]
            },
            "observations_mean": float(np.mean(self.observations)),
            "wall_time_s": self.wall_time_s,
            "scores": list(self.score),
            "final_scores": list(self.final_score),
        }


class BenchmarkInterrupted(KeyboardInterrupt):
    """Ctrl-C in a benchmark.

    Parameters
    ----------
    rows : list of BenchmarkRow
        What was flown before, with fewer seeds or planners than were wanted.
    done, total : int
        How many runs were finished, and how many were wanted.
    """

    def __init__(self, rows: list[BenchmarkRow], done: int, total: int) -> None:
        super().__init__(f"interrupted after {done} of {total} runs")
        self.rows = rows
        self.done = done
        self.total = total


def benchmark(
    base: Scenario,
    planners: Sequence[str | Choice],
    estimators: Sequence[str | Choice],
    seeds: Sequence[int],
    *,
    jobs: int = 1,
    progress: Callable[[str, float, float], None] | None = None,
) -> list[BenchmarkRow]:
    """Fly every planner with every estimator on the environments of all seeds.

    The environment of a seed is the same for all planners and estimators, so rows can be compared in pairs.

    Parameters
    ----------
    base : Scenario
        Everything but planner, estimator and seed.
    jobs : int
        Processes that run at once.

    Raises
    ------
    WbfMissionError
        If a name is unknown or a run cannot be planned.
    BenchmarkInterrupted
        At Ctrl-C, with what was flown before.
    """
    from joblib import Parallel, delayed

    pairs = list(itertools.product(planners, estimators))
    scenarios = [
        scenario_with(base, {"planner": planner, "estimator": estimator, "seed": seed})
        for planner, estimator in pairs
        for seed in seeds
    ]
    runs: list[dict[str, Any]] = []
    parallel = Parallel(n_jobs=jobs, return_as="generator", initializer=ignore_interrupts)
    try:
        for summary in parallel(delayed(_run)(s) for s in scenarios):
            runs.append(summary)
            if progress is not None:
                progress("flying", len(runs), len(scenarios))
    except KeyboardInterrupt:
        raise BenchmarkInterrupted(_rows(pairs, runs, len(seeds)), len(runs), len(scenarios)) from None
    return _rows(pairs, runs, len(seeds))


def _rows(
    pairs: Sequence[tuple[str | Choice, str | Choice]], runs: Sequence[dict[str, Any]], seeds: int
) -> list[BenchmarkRow]:
    """The rows of the runs, which come in the order of the pairs; none of a pair that was not flown."""
    parts = [runs[number * seeds : (number + 1) * seeds] for number in range(len(pairs))]
    return [
        BenchmarkRow(
            planner=str(planner),
            estimator=str(estimator),
            score=tuple(run["score"] for run in part),
            final_score=tuple(run["final_score"] for run in part),
            losses=tuple(run["losses"] for run in part),
            observations=tuple(run["observations"] for run in part),
            wall_time_s=sum(run["wall_time_s"] for run in part),
        )
        for (planner, estimator), part in zip(pairs, parts, strict=True)
        if part
    ]


def _run(scenario: Scenario) -> dict[str, Any]:
    from mission.outcome import Outcome
    from wbf_mission.flight import FlightError, fly

    result = fly(scenario)
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    if not result.outcome.is_good:
        planner, estimator = scenario.mission.planner, scenario.estimate.estimator
        msg = (
            f"{planner} with {estimator}, seed {scenario.seed}: "
            f"the flight ended as {result.outcome.value} ({result.reason}); fly it alone to see why"
        )
        raise FlightError(msg)
    return result.summary()
