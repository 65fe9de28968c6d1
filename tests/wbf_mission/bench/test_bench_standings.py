"""What the rows of a benchmark tell."""

import math

import numpy as np
import pytest

from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.standings import compare, mean_interval, standings, verdict


def rows(planner, scores, estimator="gp", scenario="s", error=()):
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
        )
        for seed, score in enumerate(scores)
    ]


@pytest.mark.parametrize("count", [3, 5, 7, 8, 20])
@pytest.mark.parametrize("kind", ["normal", "exponential"])
def test_intervals_cover_the_mean_they_are_of(count, kind):
    draw = np.random.default_rng(11)
    trials, hits = 600, 0
    for _ in range(trials):
        values = draw.normal(-1.0, 0.3, count) if kind == "normal" else -draw.exponential(1.0, count)
        found = mean_interval(values)
        hits += found.low <= -1.0 <= found.high
    if count < 7 and kind == "exponential":
        assert hits / trials > 0.85  # so few skewed values tell too little
    else:
        # Percentiles of resampled means cover 0.84 to 0.93 of 8 and 20 values.
        assert 0.925 < hits / trials < 0.98


def test_one_value_that_is_far_off_does_not_make_an_interval_of_five_useless():
    found = mean_interval(np.array([-0.031, -0.033, -0.034, -0.036, -0.2]))
    assert found.high - found.low < 0.25


def test_equal_values_have_an_interval_of_nothing():
    found = mean_interval(np.full(6, -2.0))
    assert (found.mean, found.low, found.high) == (-2.0, -2.0, -2.0)


def test_few_values_have_no_interval():
    one = mean_interval(np.array([np.nan, -2.0]))
    assert one.mean == -2.0
    assert math.isnan(one.low)
    assert math.isnan(mean_interval(np.array([np.nan])).mean)


def test_the_best_comes_first_with_its_wins_and_ranks():
    found = standings([*rows("slow", [-3.0, -3.0, -1.0]), *rows("fast", [-1.0, -2.0, -1.0])])
    assert [(one.planner, one.rank, one.wins) for one in found] == [
        ("fast", pytest.approx((1 + 1 + 1.5) / 3), 2.5),
        ("slow", pytest.approx((2 + 2 + 1.5) / 3), 0.5),
    ]
    assert found[0].score.mean == pytest.approx(-4 / 3)
    assert found[0].losses == {"tylcv": pytest.approx(4 / 3)}


def test_failures_count_and_take_no_part():
    found = standings([*rows("good", [-3.0, -3.0]), *rows("frail", [-1.0, -1.0], error=[1])])
    frail, good = found
    assert (frail.planner, frail.runs, frail.failed, frail.score.mean) == ("frail", 1, 1, -1.0)
    assert (good.rank, good.wins, good.runs) == (1.5, 1.0, 2)


def test_what_failed_everywhere_stands_last():
    found = standings([*rows("never", [-1.0], error=[0]), *rows("good", [-9.0])])
    assert [one.planner for one in found] == ["good", "never"]
    assert math.isnan(found[1].rank)
    assert (found[1].wins, found[1].failed) == (0.0, 1)


def test_scenarios_are_told_apart():
    found = standings([*rows("a", [-1.0], scenario="two"), *rows("a", [-5.0], scenario="one")])
    assert [(one.scenario, one.rank) for one in found] == [("one", 1.0), ("two", 1.0)]


def test_a_comparison_is_made_in_pairs():
    # The environments differ much more than the two do.
    hard = np.array([-9.0, -1.0, -5.0, -3.0, -7.0, -2.0, -8.0, -4.0])
    gain = np.array([0.1, 0.2, 0.15, 0.05, 0.1, 0.2, 0.1, 0.15])
    told = [*rows("mine", hard + gain), *rows("theirs", hard), *rows("frail", hard - 1.0, error=range(1, 8))]
    theirs, frail = compare(told, "mine", ["theirs", "frail"])
    assert (theirs.environments, theirs.better, verdict(theirs.score)) == (8, 1.0, "better")
    assert theirs.score.mean == pytest.approx(gain.mean())
    assert theirs.score.low > 0.05
    assert theirs.final_score.mean == pytest.approx(gain.mean() / 2)
    assert (frail.environments, verdict(frail.score)) == (1, "cannot be told")
    (back,) = compare(told, "theirs", ["mine"])
    assert verdict(back.score) == "worse"
    (none,) = compare(told, "mine", ["nobody"])
    assert none.environments == 0
    assert math.isnan(none.better)


def test_verdicts_of_equal_runs():
    (same,) = compare([*rows("a", [-1.0] * 6), *rows("b", [-1.0] * 6)], "a", ["b"])
    assert verdict(same.score) == "equal"
