"""The authors' estimators: against published estimates, scikit-learn, and the estimators of the core."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from estimator_inputs import grid_of, observations, random_observations
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel

from sensors.errors import EstimatorError
from sensors.fields import PAPER_FIELDS
from wbf_mission.addons.authors.adaptive_disk import AuthorsAdaptiveDiskEstimator
from wbf_mission.addons.authors.sklearn_gp import SklearnGaussianProcessEstimator

GOLDEN = Path(__file__).parents[3] / "data" / "golden"


@pytest.mark.parametrize("name", ["lawnmower", "spiral"])
def test_authors_ad_is_the_published_estimate(name):
    with np.load(GOLDEN / f"Miniberry-30_{name}_AD.npz") as data:
        run = dict(data)
    x, y, _ = run["positions"].T
    seen = observations(x, y, run["observations"])
    at_once = AuthorsAdaptiveDiskEstimator().fit(grid_of(31, 31), seen).predict()
    stepwise = AuthorsAdaptiveDiskEstimator().fit(grid_of(31, 31))
    for i in range(len(seen)):
        stepwise.partial_fit(seen[i : i + 1]).predict()
    for model in (at_once, stepwise.predict()):
        for k, field in enumerate(PAPER_FIELDS.names):
            np.testing.assert_array_equal(model.value[k], run[f"est_{field}"].astype(np.float32))
            np.testing.assert_array_equal(model.uncertainty[k], run[f"unc_{field}"])


def test_scikit_learn_variant_is_the_papers_regressor():
    shape = (9, 8)
    seen = random_observations(12, shape, seed=3)
    model = SklearnGaussianProcessEstimator(n_restarts=2, random_state=4).fit(grid_of(*shape), seen).predict()
    seed = int(np.random.default_rng(4).integers(2**31))
    kernel = RBF([2, 2], (1, 10)) + WhiteKernel(0.5, (1e-5, 1e5))
    regressor = GaussianProcessRegressor(kernel, alpha=1e-10, n_restarts_optimizer=2, random_state=seed)
    with warnings.catch_warnings(action="ignore", category=ConvergenceWarning):
        regressor.fit(np.stack([seen.x, seen.y], axis=1), seen.values[:, 0].astype(float))
    mean, std = regressor.predict(np.argwhere(np.ones(shape)), return_std=True)
    np.testing.assert_allclose(model.value[0], mean.reshape(shape), atol=1e-6)
    np.testing.assert_allclose(model.uncertainty[0], std.reshape(shape), atol=1e-6)


def test_scikit_learn_variant_refuses_what_it_cannot_finish():
    many = random_observations(60, (20, 20))
    with pytest.raises(EstimatorError, match="use the estimator 'gp' or 'adaptive-disk'"):
        SklearnGaussianProcessEstimator(max_points=50).fit(grid_of(20, 20), many).predict()
    with pytest.raises(EstimatorError, match="60 observations on 20 x 20 cells"):
        SklearnGaussianProcessEstimator(max_entries=1000).fit(grid_of(20, 20), many).predict()
    with pytest.raises(EstimatorError, match="n_restarts cannot be -1"):
        SklearnGaussianProcessEstimator(n_restarts=-1).fit(grid_of(20, 20))
