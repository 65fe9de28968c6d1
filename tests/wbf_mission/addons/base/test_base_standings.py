"""What the rows of a benchmark tell."""

import math
from array import array

import numpy as np
import pytest
from bench_rows import made_row, rows
from msgspec import structs

from wbf_mission.addons.base.intervals import mean_intervals, ratio_intervals
from wbf_mission.addons.base.standings import score_over_time, scored, standings


def mean_interval(values):
    return mean_intervals([values])[0]


def ratio_interval(values, others):
    return ratio_intervals([(values, others)])[0]


def coverage(found, true):
    """Return in which part of the cases an interval holds what it is of."""
    return np.mean([one.low <= true <= one.high for one in found])


CASES = 400


@pytest.mark.parametrize("count", [3, 5, 8, 20])
@pytest.mark.parametrize(
    ("kind", "least"), [("normal", (0.93,) * 4), ("exponential", (0.86, 0.89, 0.925, 0.925))]
)
def test_intervals_cover_the_mean_they_are_of(count, kind, least):
    draw = np.random.default_rng(11)
    drawn = (
        draw.normal(-1.0, 0.3, (CASES, count)) if kind == "normal" else -draw.exponential(1.0, (CASES, count))
    )
    # Percentiles of resampled means cover 0.84 to 0.93 of 8 and 20 values.
    assert dict(zip((3, 5, 8, 20), least, strict=True))[count] < coverage(mean_intervals(drawn), -1.0) < 0.98


@pytest.mark.parametrize(
    ("spread", "rare", "least"),
    # Percentiles cover 0.87, 0.92; 0.79, 0.87; 0.67, 0.77; and 0.84 of 40 with rare misses.
    [(0.4, 0.0, (0.94, 0.93, 0.93)), (1.0, 0.0, (0.87, 0.89, 0.90)), (0.4, 0.1, (0.78, 0.79, 0.84))],
)
def test_intervals_of_ratios_cover_the_ratio_of_the_means(spread, rare, least):
    draw = np.random.default_rng(5)
    true = (math.exp(0.08 - 0.5 + spread**2 / 2.0) + 3.0 * rare) / math.exp(0.08 + 0.045)
    for count, part in zip((8, 20, 40), least, strict=True):
        shape = CASES, count
        hard = draw.lognormal(0.0, 0.4, shape)
        misses = (draw.random(shape) < rare) * draw.exponential(3.0, shape)
        above = hard * draw.lognormal(-0.5, spread, shape) + misses
        below = hard * draw.lognormal(0.0, 0.3, shape)
        assert part < coverage(ratio_intervals(list(zip(above, below, strict=True))), true) < 0.985


def test_intervals_of_a_table_hold_together():
    draw = np.random.default_rng(3)
    alone = together = 0
    for _ in range(CASES // 2):
        hard = draw.normal(0.0, 1.0, 12)
        table = [hard + draw.normal(0.0, 1.0, 12) for _ in range(6)]
        alone += coverage(mean_intervals(table), 0.0) == 1.0
        together += coverage(mean_intervals(table, together=True), 0.0) == 1.0
    assert alone / (CASES // 2) < 0.9
    assert 0.92 < together / (CASES // 2) < 0.99


def test_a_ratio_by_what_may_be_nothing_has_no_upper_limit():
    found = ratio_interval(np.full(8, 1.0), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0]))
    assert math.isinf(found.high)
    assert found.low >= 0.0


def test_one_of_five_that_is_far_off_makes_the_interval_long_on_its_side():
    found = mean_interval(np.array([-0.031, -0.033, -0.034, -0.036, -0.2]))
    assert -1.0 < found.low < -0.3
    assert 0.0 < found.high < 0.1


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
    assert found[0].losses_over_run == {}  # without a history


def test_a_run_that_failed_counts_as_the_worst_of_all_on_its_environment():
    knows_nothing = {"scores": array("d", [-9.0, -3.0]), "history": {"tylcv": array("d", [8.0, 3.0])}}
    found = standings([*rows("good", [-3.0, -3.0], **knows_nothing), *rows("frail", [-1.0, -1.0], error=[1])])
    good, frail = found
    assert (frail.planner, frail.environments, frail.failed) == ("frail", 2, 1)
    assert (frail.score.mean, frail.final_score.mean) == ((-1.0 - 9.0) / 2, (-0.5 - 9.0) / 2)
    assert frail.losses == {"tylcv": (1.0 + 8.0) / 2}
    assert frail.losses_over_run == {"tylcv": 8.0}  # the other row has no history
    assert (good.rank, good.wins, frail.wins, good.losses_over_run) == (1.5, 1.0, 1.0, {"tylcv": 5.5})
    assert (good.cpu_time_s, frail.cpu_time_s) == (1.0, 1.0)


def test_what_failed_everywhere_stands_last():
    found = standings([*rows("never", [-1.0], error=[0]), *rows("good", [-9.0]), *rows("best", [-1.0])])
    assert [(one.planner, one.rank) for one in found] == [("best", 1.0), ("good", 2.5), ("never", 2.5)]
    assert (found[2].wins, found[2].failed, found[2].score.mean) == (0.0, 1, -9.0)


def test_its_own_history_is_worst_where_nobody_else_flew():
    told = {"scores": array("d", [-4.0, -1.0])}
    (one,) = standings(rows("a", [-2.0], error=[0], **told))
    assert (one.score.mean, one.final_score.mean) == (-4.0, -4.0)


def test_only_environments_count_that_all_have_in_common():
    easy = [-0.1] * 4
    told = [*rows("both", [-2.0, -2.0, *easy]), *rows("half", [-3.0, -1.0])]
    (group,) = scored(told)
    assert group.seeds == (0, 1)
    assert group.left_out == dict.fromkeys(range(2, 6), (("half", "gp"),))
    assert group.environments_in_words() == (
        "2 environments count (seeds 0..1); 4 do not: there is no row of half, gp (seeds 2..5)."
    )
    assert [(one.planner, one.score.mean, one.wins) for one in standings(told)] == [
        ("both", -2.0, 1.0),
        ("half", -2.0, 1.0),
    ]


def test_without_an_environment_in_common_nobody_has_a_score():
    shifted = [structs.replace(one, seed=one.seed + 5) for one in rows("b", [-1.0])]
    found = standings([*rows("a", [-1.0]), *shifted])
    assert [(one.environments, math.isnan(one.score.mean), one.wins) for one in found] == [(0, True, 0.0)] * 2
    assert all(math.isnan(one.rank) for one in found)


def test_an_environment_on_which_nobody_has_a_score_does_not_count():
    (group,) = scored([*rows("a", [-1.0, -1.0], error=[1]), *rows("b", [-2.0, -1.0], error=[1])])
    assert (group.seeds, group.left_out) == ((0,), {1: ()})
    assert "no run has a score (seed 1)" in group.environments_in_words()


@pytest.mark.parametrize("score", [None, math.nan, math.inf, -math.inf])
def test_a_run_without_a_score_failed_and_takes_no_environment_from_the_others(score):
    good = rows("good", [-1.0, -2.0], scores=array("d", [-9.0, math.nan]))
    odd = rows("odd", [-1.0, -1.0])
    odd[1] = structs.replace(odd[1], score=score, final_score=-1.0, scores=array("d", [math.nan]))
    assert odd[1].error == "no score: no cell of the farm was observed"
    (group,) = scored([*good, *odd])
    assert group.seeds == (0, 1)
    found = {one.planner: one for one in standings([*good, *odd])}
    assert (found["odd"].failed, found["odd"].score.mean) == (1, (-1.0 - 9.0) / 2)
    assert (found["good"].failed, found["good"].score.mean) == (0, -1.5)
    # Whoever comes first.
    (turned,) = scored([*odd[::-1], *good[::-1]])
    assert (turned.scores == group.scores).all()


def test_the_share_of_bad_answers_is_that_of_all_answers():
    policy = rows("policy", [-1.0, -1.0], decisions=20, bad_answers={"crashed": 1})
    found = {one.planner: one for one in standings([*policy, *rows("fixed", [-1.0, -1.0], decisions=1)])}
    assert found["policy"].bad_share == 2 / 40
    assert math.isnan(found["fixed"].bad_share)
    (quiet,) = standings(rows("policy", [-1.0], decisions=20))
    assert quiet.bad_share == 0.0


def test_the_interval_of_a_ratio_is_that_of_pairs():
    draw = np.random.default_rng(3)
    hard = draw.uniform(1.0, 9.0, 20)
    pairs = ratio_interval(hard * 0.5 + draw.normal(0.0, 0.01, 20), hard)
    assert pairs.low < pairs.mean < pairs.high
    assert pairs.mean == pytest.approx(0.5, abs=0.01)
    assert pairs.high - pairs.low < 0.01
    few = ratio_interval(hard[:6], hard[:6])
    assert (few.mean, math.isnan(few.low)) == (1.0, True)
    assert math.isnan(ratio_interval(hard, np.zeros(20)).mean)


def test_the_score_over_time_holds_until_the_next_scored_time():
    times_s, scores = score_over_time([made_row("a", 0, [-3.0, -1.0]), made_row("a", 1, [-5.0, -4.0, -2.0])])
    assert (times_s[0], times_s[-1]) == (0.0, 30.0)
    one, two = scores
    assert set(one[times_s < 20.0]) == {-3.0}
    assert set(one[times_s >= 20.0]) == {-1.0}
    assert (two[0], two[-1]) == (-5.0, -2.0)
