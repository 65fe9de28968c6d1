"""The compiled functions of estimators and score on farms that are small enough for plain Python, too."""

import numpy as np
import pytest

from sensors.estimators.gp.cell_posterior import ExactPosterior
from sensors.estimators.gp.local import LocalPosterior, WholePosterior
from sensors.estimators.gp.rbf import RbfKernel

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
