"""Means and kernels that are learned from simulated environments."""

import json

import numpy as np
import pytest

from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.environment import TYLCV, SoilParameters, generate_environment
from sensors.errors import EstimatorError
from sensors.estimators.gp import prior as gp_prior
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.estimators.gp.prior import _nearest_kernel, continuous_prior, disease_prior, learn_priors
from sensors.estimators.gp.rbf import RbfKernel
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations

MODEL = PAPER_FIELDS


@pytest.fixture(autouse=True)
def _forget(monkeypatch):
    monkeypatch.setattr(gp_prior, "_in_memory", {})
    monkeypatch.setattr(gp_prior, "_MOST_SIMULATIONS", 60)
    monkeypatch.setattr(gp_prior, "_LINK_SIMULATIONS", 20)
    monkeypatch.setattr(gp_prior, "_SOIL_SIMULATIONS", 40)
    monkeypatch.setattr(gp_prior, "_SOIL_LATTICE", 7)


def small_grid():
    return get_farm("miniberry-10").grid()


def test_the_nearest_kernel_to_a_kernels_moments_is_itself():
    true = RbfKernel(2.5, 4.0, 0.02, 0.3)
    x, y = (part.ravel() for part in np.indices((12, 12)))
    found = _nearest_kernel(x, y, true.between(x, y) + true.noise * np.eye(144), (0.5, 64.0))
    for name in ("length_x", "length_y", "noise", "amplitude"):
        assert getattr(found, name) == pytest.approx(getattr(true, name), rel=1e-2)


def test_means_and_variances_are_those_of_environments(tmp_path, monkeypatch):
    monkeypatch.setattr(gp_prior, "_SOIL_LATTICE", 14)
    grid = get_farm("miniberry-30").grid()
    priors = learn_priors(grid, MODEL, 6, 0, tmp_path)
    fields = np.array(
        [generate_environment(grid, days=6, seed=s, keep_days=[6]).values(6) for s in range(500, 560)]
    )
    hosts = {0: grid.crop == 2, 1: grid.crop == 1, 2: np.ones(grid.shape, bool)}
    for k, prior in enumerate(priors):
        seen = fields[:, k][:, hosts[k]]
        assert prior.mean == pytest.approx(seen.mean(), abs=0.1 if k == 2 else 0.02)
        total = prior.kernel.amplitude + prior.kernel.noise
        assert total == pytest.approx(((seen - prior.mean) ** 2).mean(), rel=0.4)
    assert 1.0 < priors[0].kernel.length_x < 3.0
    assert priors[2].kernel.noise < 0.02 * priors[2].kernel.amplitude


def test_the_soil_grows_with_the_farm():
    small, large = (
        continuous_prior(SoilParameters(), (96, 48), 6, 0),
        continuous_prior(SoilParameters(), (9600, 4800), 6, 0),
    )
    assert large.mean == small.mean
    assert large.kernel.length_x == pytest.approx(100 * small.kernel.length_x)
    assert large.kernel.length_y == pytest.approx(100 * small.kernel.length_y)


def test_large_farms_are_simulated_in_windows(monkeypatch):
    monkeypatch.setattr(gp_prior, "_WINDOW", 120)
    hosts = np.zeros((400, 300), bool)
    hosts[:, :150] = True
    window = disease_prior(TYLCV, hosts, 6, 0, "tylcv")
    monkeypatch.setattr(gp_prior, "_WINDOW", 1000)
    full = disease_prior(TYLCV, hosts, 6, 0, "tylcv")
    assert 1 - window.mean == pytest.approx(1 - full.mean, rel=0.2)
    assert window.kernel.length_x == pytest.approx(full.kernel.length_x, rel=0.3)
    assert window.kernel.amplitude == pytest.approx(full.kernel.amplitude, rel=0.4)


def test_a_crop_that_is_not_grown_has_nothing_to_learn():
    prior = disease_prior(TYLCV, np.zeros((30, 20), bool), 6, 0, "tylcv")
    assert prior.mean == 1.0
    assert prior.kernel.amplitude < 1e-6


@pytest.mark.parametrize("day", [0, 40])
def test_any_day_and_a_tiny_farm_can_be_learned_where_nothing_can_be_kept(day, tmp_path):
    (tmp_path / "file").write_text("")
    grid = FarmGrid((7, 4), 0.3048, np.array([[1, 1, 2, 2]] * 7, np.int8), np.ones((7, 4), bool))
    for prior in learn_priors(grid, MODEL, day, 0, tmp_path / "file" / "below"):
        assert 0 <= prior.mean <= 1
        assert prior.kernel.noise > 0
    with pytest.raises(EstimatorError, match=r"gp: day 5000 is not in 0\.\."):
        learn_priors(grid, MODEL, 5000, 0, tmp_path)


def test_what_was_learned_is_kept_and_other_days_seeds_and_models_are_learned_anew(tmp_path, monkeypatch):
    grid = small_grid()
    first = learn_priors(grid, MODEL, 6, 0, tmp_path)
    (path,) = tmp_path.iterdir()
    assert set(json.loads(path.read_text())) == {"tylcv", "ccr", "soil"}
    assert learn_priors(grid, MODEL, 8, 0, tmp_path) != first
    assert learn_priors(grid, MODEL, 6, 1, tmp_path) != first
    dry = PAPER_FIELDS.with_dynamics(soil=SoilParameters(evaporation=0.2))
    assert learn_priors(grid, dry, 6, 0, tmp_path)[2].mean < first[2].mean
    assert len(list(tmp_path.iterdir())) == 4
    monkeypatch.setattr(gp_prior, "_in_memory", {})
    monkeypatch.setattr(gp_prior, "disease_prior", None)
    assert learn_priors(grid, MODEL, 6, 0, tmp_path) == first


def test_a_damaged_file_is_replaced(tmp_path, monkeypatch):
    for few in ("_MOST_SIMULATIONS", "_LINK_SIMULATIONS", "_SOIL_SIMULATIONS"):
        monkeypatch.setattr(gp_prior, few, 10)
    grid = small_grid()
    first = learn_priors(grid, MODEL, 6, 0, tmp_path)
    (path,) = tmp_path.iterdir()
    for text in ("", "{", "[]", '{"tylcv": 1}', '{"tylcv": {"mean": NaN, "kernel": {}}}', "\x00\xff"):
        path.write_text(text, encoding="latin-1")
        monkeypatch.setattr(gp_prior, "_in_memory", {})
        assert learn_priors(grid, MODEL, 6, 0, tmp_path) == first
        assert json.loads(path.read_text())["soil"]["mean"] == first[2].mean


def test_the_estimator_takes_the_prior_of_the_latest_day(tmp_path):
    grid = small_grid()
    estimator = GaussianProcessEstimator(states="mean", cache=tmp_path).fit(grid)
    nothing = estimator.predict()
    priors = learn_priors(grid, MODEL, 6, 0, tmp_path)
    assert estimator.kernels_ == [prior.kernel for prior in priors]
    np.testing.assert_allclose(nothing.value[:, 3, 3], [prior.mean for prior in priors], rtol=1e-6)
    for days in ([6, 6], [9, 7]):
        seen = Observations([3, 4], [5, 5], [0.0, 1.0], days, [[1, 1, 0.5]] * 2)
        model = estimator.partial_fit(seen).predict()
    latest = learn_priors(grid, MODEL, 9, 0, tmp_path)
    assert estimator.kernels_ == [prior.kernel for prior in latest]
    assert estimator.n_observations_ == 4
    once = GaussianProcessEstimator(states="mean", cache=tmp_path).fit(
        grid, Observations([3, 4, 3, 4], [5] * 4, range(4), [6, 6, 9, 7], [[1, 1, 0.5]] * 4)
    )
    np.testing.assert_allclose(model.value, once.predict().value, atol=1e-6)


def test_farms_of_any_size_learn_from_the_model_and_keep_a_mean_that_was_given(tmp_path):
    grid = get_farm("miniberry-30").grid()
    fitted = GaussianProcessEstimator(learn_from="observations").fit(grid).predict()
    assert fitted.value[:, 0, 0].tolist() == [1.0, 1.0, 0.0]
    small = GaussianProcessEstimator(states="mean", cache=tmp_path).fit(grid).predict()
    assert 0.9 < small.value[0, 0, 0] < 1.0
    shape = (130, 130)
    large = FarmGrid(shape, 0.3048, np.full(shape, 2, np.int8), np.ones(shape, bool))
    model = GaussianProcessEstimator(states="mean", cache=tmp_path).fit(large).predict()
    assert 0.9 < model.value[0, 0, 0] < 1.0
    given = GaussianProcessEstimator((0.5, 0.5, 0.5), cache=tmp_path).fit(large).predict()
    assert given.value[:, 0, 0].tolist() == [0.5, 0.5, 0.5]
    assert given.uncertainty[0, 0, 0] == model.uncertainty[0, 0, 0]
