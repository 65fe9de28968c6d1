"""Rows of a benchmark that nobody flew."""

from array import array

import msgspec
import numpy as np

from wbf_mission.bench.rows import BenchRow


def decided(rows):
    """Return what the runs alone decide, without their costs."""
    costs = ("wall_time_s", "cpu_time_s", "timings_s")
    values = [msgspec.structs.asdict(row) for row in rows]
    return sorted(
        ({name: value for name, value in row.items() if name not in costs} for row in values),
        key=lambda row: row["key"],
    )


def made_row(planner, seed, scores, **given):
    """Return a row with these scores over time."""
    values = {
        "key": f"{planner}{seed}",
        "scenario": "WBF/Some-v1",
        "planner": planner,
        "estimator": "gp",
        "seed": seed,
        "score": float(np.mean(scores)),
        "final_score": scores[-1],
        "losses": {"tylcv": -scores[-1]},
        "times_s": array("d", [10.0 * (k + 1) for k in range(len(scores))]),
        "scores": array("d", scores),
        "decisions": 1,
        "flight_time_s": 33.0,
        "predicted_time_s": 30.0,
        "path_length_m": 100.0,
        "wall_time_s": 2.0,
        "cpu_time_s": 1.0,
        "timings_s": {"plan": 0.5, "flight": 1.5},
    }
    return BenchRow(**{**values, **given})


def rows(planner, values, estimator="gp", scenario="s", error=(), **given):
    """Return a row for each value, with seeds from 0 on; those in `error` failed."""
    return [
        BenchRow(
            key=f"{scenario}{planner}{estimator}{seed}",
            scenario=scenario,
            planner=planner,
            estimator=estimator,
            seed=seed,
            score=None if seed in error else score,
            final_score=None if seed in error else score / 2,
            losses={} if seed in error else {"tylcv": -score},
            error="it failed" if seed in error else None,
            wall_time_s=2.0,
            cpu_time_s=1.0,
            **given,
        )
        for seed, score in enumerate(values)
    ]
