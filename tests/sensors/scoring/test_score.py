"""The score: the paper's formula against the golden data, and its properties."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import slow

from geo.grid import FarmGrid
from sensors.errors import EstimatorError
from sensors.estimators.adaptive_disk import AdaptiveDiskEstimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import PAPER_WEIGHTS, RunningScore
from wbf_mission.addons.authors.adaptive_disk import AuthorsAdaptiveDiskEstimator

GOLDEN = Path(__file__).parents[2] / "data" / "golden"
RUNS = (slow("Miniberry-30_lawnmower_AD"), "Miniberry-30_spiral_AD")


@pytest.fixture(scope="module")
def farm():
    with np.load(GOLDEN / "env_Miniberry-30_mrem.npz") as data:
        truth = np.stack([data[name] for name in PAPER_FIELDS.names])
        masks = np.stack([data["mask_tomato"], data["mask_strawberry"], data["mask_soil"]])
    return truth, masks


def authors_estimates(run):
    """The authors' adaptive disk after each step, in float64, with their default of 0."""
    n = len(run["positions"])
    x, y, _ = run["positions"].T
    # Disks of the observations' numbers, which float32 holds exactly.
    numbers = np.repeat(np.arange(n, dtype=np.float32)[:, None], 3, axis=1)
    seen = Observations(x, y, np.arange(n), np.full(n, 6), numbers)
    grid = FarmGrid((31, 31), 0.3048, np.ones((31, 31), np.int8), np.ones((31, 31), bool))
    estimator = AuthorsAdaptiveDiskEstimator(default_values=(-1, -1, -1)).fit(grid)
    for step in range(n):
        owner = estimator.partial_fit(seen[step : step + 1]).predict().value[0].astype(int)
        table = np.vstack([run["observations"][: step + 1], np.zeros(3)])
        yield np.moveaxis(table[owner], -1, 0)


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
    for k, field in enumerate(PAPER_FIELDS.names):
        same(f"x_{field}_mae", [score.field_mae[k] for score in scores])
        same(f"x_{field}_mse", [score.field_mse[k] for score in scores])
        same(f"x_{field}_wmae", [score.field_weighted_mae[k] for score in scores])
        same(f"x_{field}_wmse", [score.field_loss[k] for score in scores])
    assert running.score == pytest.approx(run["x_paper_formula"].mean(), abs=1e-12)
    assert len(running.losses) == 500


SHAPE = (3, 4, 5)


def test_a_field_without_cells_does_not_count():
    truth, masks = np.zeros(SHAPE), np.ones(SHAPE, bool)
    masks[0] = False
    score = RunningScore(truth, masks).evaluate(np.ones(SHAPE))
    assert score.loss == pytest.approx((0.2 * 10 + 0.1 * 1) / 0.3)
    assert score.field_loss[0] == 0.0


def plainly(truth, estimate, mask, low, high):
    """One field's mean costs and the authors' maximum, over the whole arrays."""
    error = np.where(mask, np.float64(estimate) - truth, 0.0)
    cost = np.where(error > 0, high, low)
    everywhere = np.float64(estimate) - truth
    lines = low * (-everywhere).max(axis=0) + high * everywhere.max(axis=0)
    return (
        (cost * error**2).sum() / mask.sum(),
        (cost * abs(error)).sum() / mask.sum(),
        -(mask.sum(axis=0) @ lines) / mask.sum() if low != high else -abs(error).sum() / mask.sum(),
    )


@given(st.tuples(st.integers(1, 200), st.integers(1, 200)), st.integers(0, 100))
@settings(max_examples=25, deadline=None)
def test_tiles_do_not_show(shape, seed):
    rng = np.random.default_rng(seed)
    truth, estimate = rng.random((2, 3, *shape), dtype=np.float32)
    masks = rng.random((3, *shape)) < 0.4
    masks[:, 0, 0] = True
    score = RunningScore(truth, masks).evaluate(estimate)
    plain = [plainly(truth[k], estimate[k], masks[k], 1, (10, 10, 1)[k]) for k in range(3)]
    np.testing.assert_allclose(score.field_loss, [part[0] for part in plain], rtol=1e-12)
    np.testing.assert_allclose(score.field_weighted_mae, [part[1] for part in plain], rtol=1e-12)
    expected = np.dot(PAPER_WEIGHTS.field, [part[2] for part in plain])
    assert score.authors_axis_max == pytest.approx(expected, rel=1e-12)


def flight(shape, n, seed):
    """A farm's truth and masks, an estimator that changes its arrays in place, and observations of a path."""
    rng = np.random.default_rng(seed)
    truth = rng.choice([0.0, 0.5, 1.0], (3, *shape)).astype(np.float32)
    masks = rng.random((3, *shape)) < 0.7
    masks[:, 0, 0] = True
    grid = FarmGrid(shape, 0.3048, np.ones(shape, np.int8), np.ones(shape, bool))
    x, y = rng.integers(0, shape[0], n), rng.integers(0, shape[1], n)
    seen = Observations(x, y, np.arange(n), np.full(n, 6), truth[:, x, y].T)
    return truth, masks, AdaptiveDiskEstimator(radius=3).fit(grid), seen


@given(
    st.tuples(st.integers(3, 200), st.integers(3, 200)),
    st.lists(st.integers(0, 20), max_size=8),
    st.integers(0, 99),
)
@settings(max_examples=25, deadline=None)
def test_scoring_while_it_flies_is_scoring_everything(shape, cuts, seed):
    truth, masks, estimator, seen = flight(shape, 20, seed)
    running = RunningScore(truth, masks)
    for start, stop in zip([0, *sorted(cuts)], [*sorted(cuts), 20], strict=True):
        model = estimator.partial_fit(seen[start:stop]).predict()
        score = running.add(model)
        # Equal, not nearly equal: the same tiles are added in the same order.
        assert score == RunningScore(truth, masks).evaluate(model.value.copy())


def test_only_the_changed_tiles_of_the_next_model_are_looked_at():
    truth, masks, estimator, _ = flight((200, 200), 20, 3)
    running = RunningScore(truth, masks)
    model = estimator.predict()
    first = running.evaluate(model)
    value = model.value.copy()
    view = value.view()
    nothing = np.zeros((4, 4), bool)

    def model_of(array, changed, revision):
        return InformationModel(array, model.uncertainty, changed, revision)

    running.evaluate(model_of(view, None, 0))
    value[:] = 0.25
    assert running.evaluate(model_of(view, nothing, 1)) == first
    plain = RunningScore(truth, masks).evaluate(value)
    # Whatever is not surely the next model of the same array is summed as a whole.
    assert running.evaluate(model_of(view, nothing, 3)) == plain
    value[:] = 0.5
    plain = RunningScore(truth, masks).evaluate(value)
    assert running.evaluate(model_of(value, nothing, 4)) == plain
    value[:] = 0.75
    plain = RunningScore(truth, masks).evaluate(value)
    assert running.evaluate(value) == plain
    assert running.evaluate(model_of(value, nothing, 5)) == plain


def test_after_a_refused_estimate_everything_is_summed():
    truth, masks, estimator, _ = flight((100, 100), 20, 5)
    running = RunningScore(truth, masks)
    running.add(estimator.predict())
    with pytest.raises(EstimatorError, match="not finite"):
        running.add(np.full_like(truth, np.nan))
    model = estimator.predict()
    assert running.add(model) == RunningScore(truth, masks).evaluate(model)


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
        RunningScore(truth, masks).evaluate(estimate)


@pytest.mark.kernel
def test_what_is_no_number_outside_the_relevant_cells_changes_nothing():
    rng = np.random.default_rng(3)
    truth, estimate = rng.random((3, 70, 9)), rng.random((3, 70, 9))
    masks = rng.random((3, 70, 9)) < 0.6
    masks[:, :, 4] = False
    # As far from the truth as it can be, a cell that does not count would be the worst of its line.
    estimate[:, ~masks.all(axis=0)] = truth[:, ~masks.all(axis=0)]
    expected = RunningScore(truth, masks).evaluate(estimate)
    spoilt = np.where(masks, estimate, np.nan)
    found = RunningScore(truth, masks).evaluate(spoilt)
    assert np.isfinite(found.authors_axis_max)
    assert found.loss == expected.loss
    assert found.field_mae == expected.field_mae
    spoilt[2][masks[2]] = np.inf
    with pytest.raises(EstimatorError, match="soil is not finite"):
        RunningScore(truth, masks).evaluate(spoilt)
