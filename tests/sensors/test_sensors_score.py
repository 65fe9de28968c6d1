"""The score: the paper's formula against the golden data, and its properties."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sensors.errors import EstimatorError
from sensors.estimators.authors import misplaced_disk
from sensors.estimators.disks import DiskMap
from sensors.fields import FIELDS
from sensors.score import PAPER_WEIGHTS, RunningScore, ScoreWeights, paper_loss

GOLDEN = Path(__file__).parents[1] / "data" / "golden"
RUNS = ("Miniberry-30_lawnmower_AD", "Miniberry-30_spiral_AD")


@pytest.fixture(scope="module")
def farm():
    with np.load(GOLDEN / "env_Miniberry-30_mrem.npz") as data:
        truth = np.stack([data[name] for name in FIELDS])
        masks = np.stack([data["mask_tomato"], data["mask_strawberry"], data["mask_soil"]])
    return truth, masks


def authors_estimates(run):
    """The authors' adaptive disk after each step, in float64, with their default of 0."""
    disks = DiskMap((31, 31), misplaced_disk, None)
    for step in range(1, len(run["positions"]) + 1):
        x, y, _ = run["positions"][step - 1 : step].T
        disks.append(x, y)
        table = np.vstack([run["observations"][:step], np.zeros(3)])
        yield np.moveaxis(table[disks.owner()], -1, 0)


@pytest.mark.parametrize("name", RUNS)
def test_every_published_score_of_a_run_is_reproduced(farm, name):
    truth, masks = farm
    running = RunningScore(truth, masks)
    with np.load(GOLDEN / f"{name}.npz") as data:
        run = dict(data)
    scores = [running.add(estimate) for estimate in authors_estimates(run)]

    def same(key, values):
        np.testing.assert_allclose(values, run[key], rtol=0, atol=1e-9, err_msg=key)

    same("x_paper_formula", [score.score for score in scores])
    same("scores_code", [score.authors_axis_max for score in scores])
    same("x_maximum_fixed", [-np.dot(PAPER_WEIGHTS.field, score.field_weighted_mae) for score in scores])
    for k, field in enumerate(FIELDS):
        same(f"x_{field}_mae", [score.field_mae[k] for score in scores])
        same(f"x_{field}_mse", [score.field_mse[k] for score in scores])
        same(f"x_{field}_wmae", [score.field_weighted_mae[k] for score in scores])
        same(f"x_{field}_wmse", [score.field_loss[k] for score in scores])
    assert running.score == pytest.approx(run["x_paper_formula"].mean(), abs=1e-12)
    assert len(running.losses) == 500


def unit(shape):
    return arrays(np.float64, shape, elements=st.floats(0, 1, width=32))


SHAPE = (3, 4, 5)


@given(unit(SHAPE), unit(SHAPE), arrays(np.bool_, SHAPE).filter(np.any))
def test_loss_is_the_formula_cell_by_cell(truth, estimate, masks):
    cost = weight = 0.0
    for i, (w, high) in enumerate(zip((1.0, 0.2, 0.1), (10, 10, 1), strict=True)):
        for x, y in np.argwhere(masks[i]):
            error = estimate[i, x, y] - truth[i, x, y]
            cost += w * (high if error > 0 else 1) * error**2
            weight += w
    assert paper_loss(truth, estimate, masks) == pytest.approx(cost / weight, abs=1e-12)


@given(unit(SHAPE), arrays(np.bool_, SHAPE).filter(np.any))
def test_perfect_is_zero_and_nothing_is_better(truth, masks):
    assert paper_loss(truth, truth, masks) == 0.0
    assert paper_loss(truth, np.clip(truth + 0.25, None, 2), masks) > 0


def test_a_missed_disease_costs_ten_times_a_false_alarm():
    truth = np.full(SHAPE, 0.5)
    masks = np.ones(SHAPE, bool)
    scorer = RunningScore(truth, masks)
    missed, alarm = scorer.evaluate(truth + 0.5), scorer.evaluate(truth - 0.5)
    assert missed.field_loss == (2.5, 2.5, 0.25)
    assert alarm.field_loss == (0.25, 0.25, 0.25)
    assert missed.field_mse == alarm.field_mse == (0.25, 0.25, 0.25)
    assert missed.field_rmse == missed.field_mae == (0.5, 0.5, 0.5)
    assert scorer.losses == []


def test_what_is_not_relevant_is_not_looked_at():
    truth, masks = np.zeros(SHAPE), np.zeros(SHAPE, bool)
    masks[:, 1:3, 2] = True
    estimate = np.full(SHAPE, np.nan)
    estimate[masks] = 0.5
    assert paper_loss(truth, estimate, masks) > 0
    estimate[2, 1, 2] = np.nan
    with pytest.raises(EstimatorError, match="soil is not finite"):
        paper_loss(truth, estimate, masks)


def test_a_field_without_cells_does_not_count():
    truth, masks = np.zeros(SHAPE), np.ones(SHAPE, bool)
    masks[0] = False
    score = RunningScore(truth, masks).evaluate(np.ones(SHAPE))
    assert score.loss == pytest.approx((0.2 * 10 + 0.1 * 1) / 0.3)
    assert score.field_loss[0] == 0.0


def test_chunks_do_not_show(monkeypatch):
    rng = np.random.default_rng(1)
    truth, estimate = rng.random((2, 3, 37, 23))
    masks = rng.random((3, 37, 23)) < 0.4
    whole = RunningScore(truth, masks).evaluate(estimate)
    monkeypatch.setattr("sensors.score._CHUNK_CELLS", 50)
    parts = RunningScore(truth, masks).evaluate(estimate)
    np.testing.assert_allclose(parts.field_loss, whole.field_loss, rtol=1e-12)
    assert parts.authors_axis_max == pytest.approx(whole.authors_axis_max)


def test_the_mean_is_taken_over_the_scored_times_and_days():
    truth, masks = np.zeros(SHAPE), np.ones(SHAPE, bool)
    running = RunningScore(truth, masks)
    assert np.isnan(running.score)
    running.add(truth + 1)
    running.advance(truth + 1)
    running.add(truth + 1)
    running.add(truth)
    expected = (0.2 * 10 + 10 + 0.1) / 1.3
    assert running.losses == pytest.approx([expected, 0.0, 1.0])
    assert running.score == pytest.approx(-(expected + 1) / 3)


def test_other_costs_can_be_given():
    truth, masks = np.zeros(SHAPE), np.ones(SHAPE, bool)
    weights = ScoreWeights(field=(1, 1, 1), too_healthy=(2, 3, 4), too_sick=(1, 1, 1))
    assert paper_loss(truth, truth + 1, masks, weights) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("truth", "estimate", "masks", "message"),
    [
        (np.zeros(SHAPE), np.zeros((3, 4, 4)), np.ones(SHAPE, bool), "estimate has shape"),
        (np.zeros((3, 4, 4)), np.zeros(SHAPE), np.ones(SHAPE, bool), "truth has shape"),
        (np.zeros(SHAPE), np.zeros(SHAPE), np.ones(SHAPE), "expected bool"),
        (np.zeros(SHAPE), np.zeros(SHAPE), np.zeros(SHAPE, bool), "no cell of the farm is relevant"),
    ],
)
def test_misuse_is_named(truth, estimate, masks, message):
    with pytest.raises(EstimatorError, match=message):
        paper_loss(truth, estimate, masks)
