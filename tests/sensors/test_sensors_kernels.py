"""The compiled functions of estimators and score on farms that are small enough for plain Python, too."""

import numpy as np
import pytest

from geo.grid import FarmGrid
from sensors.estimators.adaptive_disk import AdaptiveDiskEstimator
from sensors.estimators.gp.cell_posterior import ExactPosterior
from sensors.estimators.gp.local import LocalPosterior, WholePosterior
from sensors.estimators.gp.rbf import RbfKernel
from sensors.observations import Observations
from sensors.scoring.score import RunningScore

pytestmark = pytest.mark.kernel

SHAPE = (20, 14)
FINE = RbfKernel(2.3, 3.1, 0.003, 0.009)
SMOOTH = RbfKernel(17.0, 13.0, 2e-4, 0.05)


def whole(shape, kernel):
    return WholePosterior(shape, kernel, WholePosterior.spectrum_of_farm(shape, kernel, 1000))


def check_posterior(make, shape, kernel, n):
    rng = np.random.default_rng(n)
    x, y = rng.integers(0, shape[0], n).astype(np.int32), rng.integers(0, shape[1], n).astype(np.int32)
    values = np.sqrt(kernel.amplitude) * rng.standard_normal(n)
    posterior, exact = make(shape, kernel), ExactPosterior(shape, kernel)
    for part in np.array_split(np.arange(n), 2):
        posterior.condition(x[part], y[part], values[part])
        posterior.solve()
    exact.condition(x, y, values)
    value, uncertainty = np.empty(shape, np.float32), np.empty(shape, np.float32)
    posterior.lattice.write(0.0, clip=False, whole=True, value=value, uncertainty=uncertainty)
    deviation = np.sqrt(np.maximum(exact.variance, 0) + kernel.noise).reshape(shape)
    scale = np.sqrt(kernel.amplitude)
    np.testing.assert_allclose(value, exact.response[0].reshape(shape), atol=2e-2 * scale)
    np.testing.assert_allclose(uncertainty, deviation, atol=1e-2 * (scale + deviation.max()))


@pytest.mark.parametrize(
    ("make", "kernel"), [(LocalPosterior, FINE), (LocalPosterior, SMOOTH), (whole, SMOOTH)]
)
@pytest.mark.parametrize("n", [1, 40, 150])
def test_the_posterior_of_a_small_farm_is_the_exact_one(make, kernel, n):
    check_posterior(make, SHAPE, kernel, n)


def test_so_it_is_with_more_observed_cells_than_functions():
    check_posterior(LocalPosterior, (24, 17), RbfKernel(17.0, 13.0, 50.0, 0.02), 1500)


def farm_and_path(n=12):
    rng = np.random.default_rng(3)
    truth = rng.choice([0.0, 0.5, 1.0], (3, *SHAPE)).astype(np.float32)
    x, y = rng.integers(0, SHAPE[0], n), rng.integers(0, SHAPE[1], n)
    seen = Observations(x, y, np.arange(n), np.full(n, 6), truth[:, x, y].T)
    grid = FarmGrid(SHAPE, 0.3048, np.ones(SHAPE, np.int8), np.ones(SHAPE, bool))
    masks = rng.random((3, *SHAPE)) < 0.7
    return truth, masks, grid, seen


@pytest.mark.parametrize("radius", [1, 3, 4])
def test_disks_show_the_latest_observation_within_their_radius(radius):
    _, _, grid, seen = farm_and_path()
    estimator = AdaptiveDiskEstimator(default_values=(1, 0.75, 0.125), radius=radius).fit(grid)
    estimator.partial_fit(seen[:5])
    estimator.partial_fit(seen[5:])
    model = estimator.predict()
    for k, default in enumerate((1, 0.75, 0.125)):
        expected = np.full(SHAPE, default, np.float32)
        for i in range(len(seen)):
            ix, iy = np.indices(SHAPE)
            near = (ix - seen.x[i]) ** 2 + (iy - seen.y[i]) ** 2 <= radius**2
            expected[near] = seen.values[i, k]
        np.testing.assert_array_equal(model.value[k], expected)


def test_the_score_is_summed_anew_where_the_estimate_changed():
    truth, masks, grid, seen = farm_and_path()
    estimator = AdaptiveDiskEstimator(radius=3).fit(grid)
    running = RunningScore(truth, masks)
    for k in range(0, len(seen), 4):
        estimator.partial_fit(seen[k : k + 4])
        model = estimator.predict()
        score = running.add(model)
        error = np.float64(model.value) - truth
        for field, too_healthy in enumerate((10.0, 10.0, 1.0)):
            cost = np.where(error[field] > 0, too_healthy, 1.0) * error[field] ** 2
            assert score.field_loss[field] == pytest.approx(cost[masks[field]].mean(), rel=1e-9)
        assert score == RunningScore(truth, masks).evaluate(model.value)
