"""The Gaussian process at scale: against the exact one, and what an update touches."""

from dataclasses import replace

import numpy as np
import pytest
from estimator_inputs import grid_of

from geo.farms import get_farm
from sensors.errors import EstimatorError
from sensors.estimators import make_estimator
from sensors.estimators.gp import held_tile
from sensors.estimators.gp.cell_posterior import LEAST_NOISE as WINDOWED_NOISE
from sensors.estimators.gp.cell_posterior import ExactPosterior, WindowedPosterior
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.estimators.gp.lattice import NodeLattice
from sensors.estimators.gp.local import LEAST_NOISE, LocalPosterior, Spectrum, WholePosterior
from sensors.estimators.gp.rbf import RbfKernel
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission import check_estimator

SICK = RbfKernel(2.3, 3.1, 0.003, 0.009)
SMOOTH = RbfKernel(17.0, 13.0, 2e-4, 0.05)


def observe(x, y, values):
    n = len(x)
    return Observations(x, y, np.arange(n), np.full(n, 6), np.repeat(np.asarray(values)[:, None], 3, axis=1))


def way(shape, n, gap=3):
    """Return the cells of a lawnmower, int32[n] along each axis."""
    y = np.repeat(np.arange(0, shape[1], gap), shape[0])
    x = np.concatenate([np.arange(shape[0])[:: 1 if i % 2 == 0 else -1] for i in range(len(y) // shape[0])])
    return x[:n].astype(np.int32), y[:n].astype(np.int32)


def drawn(kernel, shape, seed=0):
    """Draw a field with noise from the process."""
    rng = np.random.default_rng(seed)
    roots = []
    for along, cells in zip((kernel.along_x, kernel.along_y), shape, strict=True):
        values, vectors = np.linalg.eigh(along(np.arange(cells), np.arange(cells)))
        roots.append(vectors * np.sqrt(np.maximum(values, 0)))
    smooth = np.sqrt(kernel.amplitude) * roots[0] @ rng.standard_normal(shape) @ roots[1].T
    return smooth + np.sqrt(kernel.noise) * rng.standard_normal(shape)


def exact_posterior(kernel, shape, x, y, values):
    posterior = ExactPosterior(shape, kernel)
    posterior.condition(x, y, values)
    return (
        posterior.response[0].reshape(shape),
        np.sqrt(np.maximum(posterior.variance, 0) + kernel.noise).reshape(shape),
    )


def written(posterior, shape, mean=0.0):
    value, uncertainty = np.empty(shape, np.float32), np.empty(shape, np.float32)
    posterior.lattice.write(mean, clip=False, whole=True, value=value, uncertainty=uncertainty)
    return value, uncertainty


def whole(shape, kernel):
    return WholePosterior(shape, kernel, WholePosterior.spectrum_of_farm(shape, kernel, 1000))


SMALL = [(LocalPosterior, SICK), (LocalPosterior, SMOOTH), (whole, SMOOTH)]


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("make", "kernel", "n"),
    [
        *((make, kernel, n) for make, kernel in SMALL for n in (1, 40, 150)),
        (LocalPosterior, RbfKernel(17.0, 13.0, 50.0, 0.02), 1500),  # more cells than functions
    ],
)
def test_the_posterior_of_a_small_farm_is_the_exact_one(make, kernel, n):
    shape = (24, 17)
    rng = np.random.default_rng(n)
    x, y = (rng.integers(0, side, n).astype(np.int32) for side in shape)
    values = np.sqrt(kernel.amplitude) * rng.standard_normal(n)
    posterior = make(shape, kernel)
    for part in np.split(np.arange(n), [n // 2, n - n // 50]):
        posterior.condition(x[part], y[part], values[part])
        posterior.solve()
    right, deviation = exact_posterior(kernel, shape, x, y, values)
    value, uncertainty = written(posterior, shape)
    scale = np.sqrt(kernel.amplitude)
    np.testing.assert_allclose(value, right, atol=2e-2 * scale)
    np.testing.assert_allclose(uncertainty, deviation, atol=1e-2 * (scale + deviation.max()))


@pytest.mark.parametrize(
    ("make", "kernel"),
    [
        (LocalPosterior, SICK),
        (LocalPosterior, SMOOTH),
        (LocalPosterior, RbfKernel(2.0, 10.0, 0.003, 0.009)),
        (whole, SMOOTH),
    ],
)
@pytest.mark.parametrize("gap", [3, 20])
def test_it_agrees_with_the_exact_posterior(make, kernel, gap):
    shape = (70, 60)
    x, y = way(shape, 1000, gap)
    values = drawn(kernel, shape)[x, y]
    if kernel is not SMOOTH:
        # Fields of diseases are no draws from their process: some values are many deviations off.
        values = values - 10 * np.sqrt(kernel.amplitude) * (np.sin(x / 4) * np.cos(y / 3) > 0.8)
    right, deviation = exact_posterior(kernel, shape, x, y, values)
    posterior = make(shape, kernel)
    posterior.condition(x, y, values)
    posterior.solve()
    value, uncertainty = written(posterior, shape)
    assert np.abs(value - right).max() < 5e-3 * np.sqrt(kernel.amplitude)
    assert np.abs(uncertainty - deviation).max() < 1e-2 * np.sqrt(kernel.amplitude + kernel.noise)


def test_land_without_the_crop_changes_no_estimate(monkeypatch):
    grid = get_farm("miniberry-100").grid()

    def flown():
        estimator, rng = GaussianProcessEstimator(method="local").fit(grid), np.random.default_rng(3)
        for day in (6, 7):
            x, y = rng.integers(0, 100, (2, 100))
            readings = rng.choice([0.5, 1.0], (100, 3))
            seen = Observations(x, y, np.arange(100.0), np.full(100, day), readings)
            model = estimator.partial_fit(seen).predict()
        tiles = [int(process._posterior.lattice._touched.sum()) for process in estimator._fields[:2]]
        return model.value, model.uncertainty, model.loss_map(), tiles

    *found, few = flown()
    monkeypatch.setattr(NodeLattice, "tiles_of", lambda self, _hosts: np.ones(self._touched.shape, np.bool_))
    *right, many = flown()
    for some, every in zip(found, right, strict=True):
        np.testing.assert_array_equal(some, every)
    assert 0 < few[0] < many[0] and 0 < few[1] < many[1]


@pytest.mark.parametrize(("noise", "most_added"), [(0.3, 256), (0.12, 256), (0.3, 10)])
def test_steps_end_with_the_estimate_of_all_observations_at_once(monkeypatch, noise, most_added):
    monkeypatch.setattr(held_tile, "_MOST_ADDED", most_added)
    rng, kernel, shape = np.random.default_rng(4), RbfKernel(1.9, 2.1, noise, 1.0), (60, 60)
    steps = [
        (*rng.integers(0, side, (2, n)).astype(np.int32), rng.standard_normal(n), np.full(n, weight))
        for side, n, weight in ((60, 2500, 1.0), (60, 600, 1.0), *[(15, 20, 1.0), (15, 20, 0.4)] * 6)
    ]
    # Readings of the same cells replace the readings of an earlier step.
    x, y, values, weights = steps[7]
    steps[9:9] = [(x, y, values + 0.5, weights), (x[:4], y[:4], values[:4], -weights[:4])]
    posterior, at_once = LocalPosterior(shape, kernel), LocalPosterior(shape, kernel)
    found, held = (np.empty(shape, np.float32), np.empty(shape, np.float32)), []
    for number, step in enumerate(steps):
        posterior.condition(*step)
        at_once.condition(*step)
        held.append(sum(not posterior._waiting[tile] for tile in posterior._held))
        if number != 9:
            posterior.solve()
            value, uncertainty = found
            posterior.lattice.write(0.0, clip=False, whole=number == 0, value=value, uncertainty=uncertainty)
    at_once.solve()
    assert held[1] == 0 and min(held[3:]) > 0
    for one, right in zip(found, written(at_once, shape), strict=True):
        np.testing.assert_allclose(one, right, atol=1e-4)


def test_functions_that_no_observation_can_move_are_left_out():
    few, many = (Spectrum(SMOOTH, (150.0, 150.0), density) for density in (1e-4, 1.0))
    assert len(few.terms) < len(many.terms)
    assert len(Spectrum(RbfKernel(500.0, 500.0, 1.0, 1e-9), (10.0, 10.0)).terms) == 1
    covariance = 0.0
    for i, j in many.terms:
        covariance += (many.roots[0][i] * many.roots[1][j]) ** 2 / 150**2
    assert covariance == pytest.approx(SMOOTH.amplitude, rel=0.3)


def test_the_kit_accepts_it():
    check_estimator(make_estimator("gp", method="local", learn_from="observations"), n_observations=40)


def test_a_running_mean_moves_the_whole_farm():
    shape = (200, 160)
    means = (None, None, None)
    estimator = GaussianProcessEstimator(means, SICK, optimise=False, method="local", clip=False)
    estimator.fit(grid_of(*shape))
    x, y = way(shape, 60)
    values = np.linspace(0, 1, 60)
    for part in (slice(0, 20), slice(20, 60)):
        model = estimator.partial_fit(observe(x[part], y[part], values[part])).predict()
    assert model.changed.all()
    assert model.value[0, -1, -1] == pytest.approx(values.mean(), abs=1e-6)
    right = GaussianProcessEstimator(means, SICK, optimise=False, method="exact", clip=False)
    exact = right.fit(grid_of(*shape), observe(x, y, values)).predict()
    np.testing.assert_allclose(model.value, exact.value, atol=1e-3)


def test_a_singular_covariance_is_named():
    kernel = RbfKernel(3.0, 3.0, 1e-300, 1.0)
    # Tiles bound the noise from below.
    estimator = GaussianProcessEstimator((0, 0, 0), kernel, optimise=False, method="exact")
    x, y = way((60, 60), 400, 1)
    with pytest.raises(EstimatorError, match="the covariance of tylcv is singular"):
        estimator.fit(grid_of(60, 60), observe(x, y, np.ones(400))).predict()


def test_a_local_model_tells_field_by_field_what_changed_and_the_score_follows():
    grid = get_farm("miniberry-100").grid()
    truth = np.ones((3, *grid.shape), np.float32)
    estimator = GaussianProcessEstimator(method="local", learn_from="model").fit(grid)
    running = RunningScore(truth, PAPER_FIELDS.masks(grid))
    rng = np.random.default_rng(3)
    for _ in range(4):
        x, y = rng.integers(0, 40, (2, 30))
        seen = Observations(x, y, np.arange(30.0), np.full(30, 6), rng.choice([0.5, 1.0], (30, 3)))
        model = estimator.partial_fit(seen).predict()
        fresh = RunningScore(truth, PAPER_FIELDS.masks(grid)).evaluate(model.value)
        assert running.add(model) == fresh
    assert model.changed.shape == (3, 2, 2)
    assert not model.changed_in(0)[1, 1]  # far from what was seen


@pytest.mark.parametrize(("length", "share"), [(1.5, 1e-6), (4.0, 0.1)])
def test_tiles_stay_near_the_exact_posterior_with_hardly_any_noise(length, share):
    rng = np.random.default_rng(5)
    shape = (64, 48)
    x, y = way(shape, 700)
    values = np.where(rng.random(700) < 0.1, rng.choice([0.0, 0.5], 700), 1.0)
    given = RbfKernel(length, length, share * 0.05, 0.05)
    local = GaussianProcessEstimator((1, 1, 1), given, optimise=False, clip=False, method="local")
    model = local.fit(grid_of(*shape), observe(x, y, values)).predict()
    used = local.kernels_[0]
    assert used.noise == max(given.noise, LEAST_NOISE * given.amplitude)
    exact = GaussianProcessEstimator(
        (1, 1, 1), used, optimise=False, clip=False, method="exact", memory_limit_mb=1e4
    )
    right = exact.fit(grid_of(*shape), observe(x, y, values)).predict()
    assert np.abs(model.value - right.value).max() <= 0.01 * np.sqrt(used.amplitude)


@pytest.mark.parametrize("kernel", [SICK, RbfKernel(1.6, 1.7, WINDOWED_NOISE * 0.01, 0.01)])
@pytest.mark.parametrize("gap", [1, 3])
def test_windows_of_cells_give_the_exact_posterior(kernel, gap):
    shape = (45, 40)
    x, y = way(shape, 500, gap)
    # Cells are read again, alone and within one batch.
    x, y = np.concatenate([x, x[:40], x[:9], x[:9]]), np.concatenate([y, y[:40], y[:9], y[:9]])
    values = drawn(kernel, shape)[x, y]
    right, windows = ExactPosterior(shape, kernel), WindowedPosterior(shape, kernel)
    for start in range(0, len(x), 31):
        part = slice(start, start + 31)
        weights = np.linspace(0.2, 1.0, len(x[part]))
        for posterior in (right, windows):
            posterior.condition(x[part], y[part], values[part], weights)
    assert np.abs(windows.response[0] - right.response[0]).max() < 2e-4 * np.sqrt(kernel.amplitude)
    assert np.abs(windows.response[1] - right.response[1]).max() < 2e-4
    assert np.abs(windows.variance - right.variance).max() < 1e-8 * kernel.amplitude


def test_windows_are_for_readings_of_one_day():
    kernel = RbfKernel(1.2, 1.2, 0.003, 0.009)
    few = {"kernel": kernel, "optimise": False, "clip": False}
    shape = (60, 50)
    x, y = way(shape, 400)
    values = drawn(kernel, shape)[x, y]
    estimator = GaussianProcessEstimator((1, 1, 1), memory_limit_mb=18.0, **few).fit(grid_of(*shape))
    estimator.partial_fit(observe(x, y, values))
    exact = GaussianProcessEstimator((1, 1, 1), memory_limit_mb=1e3, method="exact", **few)
    right = exact.fit(grid_of(*shape), observe(x, y, values)).predict()
    for _ in range(2):
        model = estimator.predict()
        assert isinstance(estimator._fields[0]._posterior, WindowedPosterior)
        assert np.abs(model.value - right.value).max() < 1e-4 * np.sqrt(kernel.amplitude)
        assert np.abs(model.uncertainty - right.uncertainty).max() < 1e-6
    later = replace(observe(x[:50], y[:50], values[:50]), day=np.full(50, 7))
    estimator.advance(7)
    estimator.partial_fit(later)
    estimator.predict()
    assert isinstance(estimator._fields[0]._posterior, LocalPosterior)


def test_without_room_for_windows_the_farm_is_solved_in_tiles():
    shape = (60, 50)
    assert not WindowedPosterior.fits(400, shape, SICK, 5e6)
    assert WindowedPosterior.fits(400, shape, SICK, 1e7)
    assert not WindowedPosterior.fits(1, (600, 500), SICK, 1e9)
    assert not WindowedPosterior.fits(1, shape, RbfKernel(2.0, 2.0, 0.01, 1.0), 1e9)
