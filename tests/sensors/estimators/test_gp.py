"""The Gaussian processes: against scikit-learn and against each other."""

import numpy as np
import pytest
from estimator_inputs import grid_of, observations, random_observations
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from sensors.errors import EstimatorError
from sensors.estimators.gp.estimator import ZERO_MEAN, GaussianProcessEstimator
from sensors.estimators.gp.rbf import RbfKernel, fit_kernel

KERNEL = RbfKernel(length_x=3.0, length_y=5.0, noise=0.05, amplitude=1.3)


def reference(kernel, x, y, values, shape):
    """Mean and standard deviation of scikit-learn's regressor with this kernel, repeated cells and all."""
    sk = ConstantKernel(kernel.amplitude) * RBF([kernel.length_x, kernel.length_y]) + WhiteKernel(
        kernel.noise
    )
    regressor = GaussianProcessRegressor(sk, alpha=1e-12, optimizer=None).fit(
        np.stack([x, y], axis=1), values
    )
    mean, std = regressor.predict(np.argwhere(np.ones(shape)), return_std=True)
    return mean.reshape(shape), std.reshape(shape), regressor


@pytest.mark.parametrize("prior_mean", [ZERO_MEAN, (1.0, 0.5, 0.25)])
@pytest.mark.parametrize("step", [1, 7, 200])
def test_it_is_scikit_learns_posterior(prior_mean, step):
    shape = (20, 15)
    seen = random_observations(200, shape)
    estimator = GaussianProcessEstimator(prior_mean, KERNEL, optimise=False, clip=False).fit(grid_of(*shape))
    for start in range(0, len(seen), step):
        estimator.partial_fit(seen[start : start + step])
        if start < 60:
            estimator.predict()
    model = estimator.predict()
    for k, mean in enumerate(prior_mean):
        value, std, _ = reference(KERNEL, seen.x, seen.y, seen.values[:, k].astype(float) - mean, shape)
        np.testing.assert_allclose(model.value[k], value + mean, atol=1e-6)
        np.testing.assert_allclose(model.uncertainty[k], std, atol=1e-6)


def test_the_fit_finds_the_kernel_of_the_data():
    true = RbfKernel(3.0, 6.0, 0.01, 0.5)
    rng = np.random.default_rng(7)
    x, y = rng.integers(0, 40, (2, 400)).astype(np.int32)
    covariance = true.between(x, y) + true.noise * np.eye(400)
    drawn = rng.multivariate_normal(np.zeros(400), covariance, method="cholesky")
    bounds = {"length_bounds": (1, 10), "noise_bounds": (1e-5, 1e5), "amplitude_bounds": (0.01, 1.0)}
    found = fit_kernel(x, y, drawn, starts=(RbfKernel(),), **bounds)
    assert (found.length_x, found.length_y, found.noise) == pytest.approx((3.0, 6.0, 0.01), rel=0.3)
    bounds["amplitude_bounds"] = (1.0, 1.0)
    assert fit_kernel(x, y, drawn, starts=(RbfKernel(),), **bounds).amplitude == pytest.approx(1.0)


def test_the_kernel_is_fitted_rarely_and_from_the_past_only():
    shape = (20, 15)
    seen = random_observations(80, shape)
    estimator = GaussianProcessEstimator(learn_from="observations").fit(grid_of(*shape))
    kernels = []
    for i in range(len(seen)):
        estimator.partial_fit(seen[i : i + 1]).predict()
        kernels.append(tuple(estimator.kernels_))
    changes = [i + 1 for i in range(1, len(seen)) if kernels[i] != kernels[i - 1]]
    assert changes == [16, 32, 64]
    assert kernels[0] == (RbfKernel(),) * 3
    again = GaussianProcessEstimator(learn_from="observations").fit(grid_of(*shape), seen[:64])
    again.predict()
    assert tuple(again.kernels_) == kernels[-1]


def test_nothing_is_fitted_to_a_field_that_never_varied():
    shape = (20, 15)
    seen = random_observations(40, shape)
    values = np.concatenate([np.ones((40, 1)), seen.values[:, 1:]], axis=1)
    estimator = GaussianProcessEstimator(learn_from="observations")
    model = estimator.fit(grid_of(*shape), observations(seen.x, seen.y, values)).predict()
    assert estimator.kernels_[0] == RbfKernel()
    assert (model.of("tylcv") == 1.0).all()


def test_a_large_farm_is_no_reason_to_give_up():
    shape = (1500, 1200)
    seen = random_observations(300, (200, 200))
    model = GaussianProcessEstimator(optimise=False).fit(grid_of(*shape), seen).predict()
    assert model.value[:2, 1000:, :].min() == 1.0
    assert (model.value[0, :200, :200] < 0.9).any()
    np.testing.assert_allclose(model.uncertainty[0, -1, -1], np.sqrt(1.5), rtol=1e-6)


def test_the_exact_method_says_what_it_would_need():
    estimator = GaussianProcessEstimator(method="exact").fit(
        grid_of(3000, 2500), random_observations(300, (200, 200))
    )
    with pytest.raises(
        EstimatorError, match=r"needs \d+ MiB for 300 observations on 3000 x 2500 cells.*'local'"
    ):
        estimator.predict()


@pytest.mark.parametrize(
    ("params", "name"),
    [
        ({"method": "quick"}, "method"),
        ({"prior_mean": (1, 1)}, "prior_mean"),
        ({"length_bounds": (10, 1)}, "length_bounds"),
        ({"noise_bounds": (0, 1)}, "noise_bounds"),
        ({"kernel": "rbf"}, "kernel"),
        ({"memory_limit_mb": 0}, "memory_limit_mb"),
        ({"learn_from": "books"}, "learn_from"),
        ({"day": -1}, "day"),
        ({"training_seed": -1}, "training_seed"),
    ],
)
def test_impossible_parameters_are_named(params, name):
    with pytest.raises(EstimatorError, match=f"gp: {name} cannot be"):
        GaussianProcessEstimator(**params).fit(grid_of(4, 4))


@pytest.mark.parametrize("value", [0, -1, float("nan"), float("inf")])
def test_impossible_kernels_are_named(value):
    with pytest.raises(EstimatorError, match="noise is"):
        RbfKernel(noise=value)


@pytest.mark.parametrize("method", ["exact", "local"])
def test_the_expected_loss_is_the_variance_times_the_mean_cost(method):
    shape = (12, 9)
    estimator = GaussianProcessEstimator(learn_from="observations", optimise=False, method=method)
    model = estimator.fit(grid_of(*shape), random_observations(10, shape)).predict()
    expected = np.array([5.5, 5.5, 1.0])[:, None, None] * model.uncertainty**2
    np.testing.assert_allclose(model.expected_loss, expected, rtol=1e-5)
    lengths = [np.sqrt(one.length_x * one.length_y) for one in estimator.kernels_]
    assert model.correlation_length == tuple(lengths)
