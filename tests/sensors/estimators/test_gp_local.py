"""The Gaussian process at scale: against the exact one, and what an update touches."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from estimator_inputs import grid_of
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import slow

from geo.farms import get_farm
from sensors.errors import EstimatorError
from sensors.estimators import make_estimator
from sensors.estimators.gp import prior
from sensors.estimators.gp.cell_posterior import LEAST_NOISE as WINDOWED_NOISE
from sensors.estimators.gp.cell_posterior import ExactPosterior, WindowedPosterior
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.estimators.gp.lattice import POINTS, NodeLattice, lagrange_weights
from sensors.estimators.gp.local import LEAST_NOISE, LocalPosterior, Spectrum, WholePosterior
from sensors.estimators.gp.rbf import RbfKernel
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import TILE_CELLS
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
    spectrum = WholePosterior.spectrum_of_farm(shape, kernel, 1000)
    assert spectrum is not None
    return WholePosterior(shape, kernel, spectrum)


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


def test_many_observations_of_a_tile_are_solved_by_functions_and_agree():
    shape, kernel = (40, 40), RbfKernel(4.0, 4.0, 0.01, 0.02)
    x, y = (part.ravel().astype(np.int32) for part in np.indices(shape))
    assert len(LocalPosterior(shape, kernel)._spectrum.terms) < len(x)
    # A third of the cells is observed twice, with other noise.
    x, y = np.append(x, x[::3]), np.append(y, y[::3])
    values = np.append(drawn(kernel, shape).ravel(), drawn(kernel, shape, 1).ravel()[::3])
    posterior = LocalPosterior(shape, kernel)
    posterior.condition(x, y, values)
    posterior.solve()
    right, deviation = exact_posterior(kernel, shape, x, y, values)
    value, uncertainty = written(posterior, shape)
    assert np.abs(value - right).max() < 2e-3 * np.sqrt(kernel.amplitude)
    assert np.abs(uncertainty - deviation).max() < 1e-3 * np.sqrt(kernel.amplitude)


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 60), st.integers(0, 2**32 - 1), st.sampled_from(["local", "whole"]))
def test_pieces_and_repeated_cells_make_no_difference(n, seed, kind):
    rng = np.random.default_rng(seed)
    shape, kernel = ((50, 40), SICK) if kind == "local" else ((50, 40), SMOOTH)
    x, y = rng.integers(20, 28, n).astype(np.int32), rng.integers(20, 26, n).astype(np.int32)
    values = rng.standard_normal(n)
    make = LocalPosterior if kind == "local" else whole
    once, often = make(shape, kernel), make(shape, kernel)
    once.condition(x, y, values)
    once.solve()
    for part in np.array_split(np.arange(n), 4):
        often.condition(x[part], y[part], values[part])
        often.solve()
    right, deviation = exact_posterior(kernel, shape, x, y, values)
    for posterior in (once, often):
        value, uncertainty = written(posterior, shape)
        np.testing.assert_allclose(value, right, atol=2e-2 * np.sqrt(kernel.amplitude))
        np.testing.assert_allclose(uncertainty, deviation, atol=2e-3)


def test_an_update_touches_only_what_it_reaches():
    shape = (900, 700)
    posterior = LocalPosterior(shape, SICK)
    value, uncertainty = written(posterior, shape, 0.5)
    posterior.condition(np.array([100], np.int32), np.array([100], np.int32), np.array([0.3]))
    posterior.solve()
    posterior.lattice.write(0.5, clip=True, whole=False, value=value, uncertainty=uncertainty)
    posterior.condition(np.array([600], np.int32), np.array([400], np.int32), np.array([0.3]))
    posterior.solve()
    was = value.copy()
    changed = posterior.lattice.write(0.5, clip=True, whole=False, value=value, uncertainty=uncertainty)
    moved = np.argwhere(value != was)
    assert len(moved) and (np.abs(moved - [600, 400]) <= 5 * 3.1 + 1).all()
    assert 0 < changed.sum() <= 12
    outside = ~np.kron(changed, np.ones((TILE_CELLS, TILE_CELLS), bool))[: shape[0], : shape[1]]
    np.testing.assert_array_equal(value[outside], was[outside])
    full = written(posterior, shape, 0.5)
    np.testing.assert_array_equal(value, full[0])
    np.testing.assert_array_equal(uncertainty, full[1])
    nothing = posterior.lattice.write(0.5, clip=True, whole=False, value=value, uncertainty=uncertainty)
    assert not nothing.any()


@pytest.mark.parametrize(
    ("kernel", "shape"), [(SICK, (90, 70)), (RbfKernel(9.0, 14.0, 1e-3, 0.01), (200, 260))]
)
def test_tiles_on_which_no_host_depends_keep_the_prior_and_hosts_get_the_same_estimate(kernel, shape):
    rng = np.random.default_rng(2)
    x, y = (rng.integers(0, side, 300).astype(np.int32) for side in shape)
    values = rng.standard_normal(300)

    def solved(hosts=None):
        posterior = LocalPosterior(shape, kernel, hosts)
        for part in (slice(200), slice(200, None)):
            posterior.condition(x[part], y[part], values[part])
            posterior.solve()
        return posterior

    whole = solved()
    lattice = whole.lattice
    edge_x, edge_y = (axis.first + int(axis.edges[1]) * axis.step for axis in (lattice.x, lattice.y))
    near = [-9, -6, -5, -3, -1, 0, 1, 3, 5, 6, 9, 30]
    hosts = {(edge_x + a, edge_y + b) for a, b in [*((a, 30) for a in near), *((30, b) for b in near)]}
    for cell in [(0, 0), (shape[0] - 1, shape[1] - 1), *sorted(hosts)]:
        mask = np.zeros(shape, np.bool_)
        mask[cell] = True
        posterior = solved(mask.__getitem__)
        assert 0 < posterior._wanted.sum() < posterior._wanted.size
        for some, every in zip(written(posterior, shape), written(whole, shape), strict=True):
            assert some[cell] == every[cell]
    assert not solved(np.zeros(shape, np.bool_).__getitem__).lattice._touched.any()


def test_land_without_the_crop_changes_no_estimate(monkeypatch):
    grid = get_farm("miniberry-100").grid()

    def flown():
        estimator, rng = GaussianProcessEstimator(method="local").fit(grid), np.random.default_rng(3)
        for day in (6, 6, 7):
            x, y = rng.integers(0, 100, (2, 300))
            readings = rng.choice([0.5, 1.0], (300, 3))
            seen = Observations(x, y, np.arange(300.0), np.full(300, day), readings)
            model = estimator.partial_fit(seen).predict()
        tiles = [int(process._posterior.lattice._touched.sum()) for process in estimator._fields[:2]]
        return model.value, model.uncertainty, model.loss_map(), tiles

    *found, few = flown()
    monkeypatch.setattr(NodeLattice, "tiles_of", lambda self, _hosts: np.ones(self._touched.shape, np.bool_))
    *right, many = flown()
    for some, every in zip(found, right, strict=True):
        np.testing.assert_array_equal(some, every)
    assert 0 < few[0] < many[0] and 0 < few[1] < many[1]


def test_an_update_between_nodes_writes_all_cells_that_depend_on_them():
    kernel, shape = RbfKernel(9.0, 14.0, 1e-3, 0.01), (800, 600)
    posterior = LocalPosterior(shape, kernel)
    value, uncertainty = written(posterior, shape)
    rng = np.random.default_rng(3)
    for _ in range(6):
        x, y = rng.integers(0, 800, 5).astype(np.int32), rng.integers(0, 600, 5).astype(np.int32)
        posterior.condition(x, y, rng.standard_normal(5))
        posterior.solve()
        posterior.lattice.write(0.0, clip=False, whole=False, value=value, uncertainty=uncertainty)
    full = written(posterior, shape)
    np.testing.assert_allclose(value, full[0], atol=1e-7)
    np.testing.assert_allclose(uncertainty, full[1], atol=1e-7)


def test_interpolation_is_exact_for_polynomials_of_degree_five():
    rng = np.random.default_rng(1)
    for step in (1, 2, 7):
        weights = lagrange_weights(step).astype(float)
        polynomial = np.polynomial.Polynomial(rng.standard_normal(6))
        nodes = polynomial(np.arange(-2, POINTS - 2))
        np.testing.assert_allclose(nodes @ weights, polynomial(np.arange(step) / step), rtol=1e-4, atol=1e-4)


def test_functions_that_no_observation_can_move_are_left_out():
    few, many = (Spectrum(SMOOTH, (150.0, 150.0), density) for density in (1e-4, 1.0))
    assert len(few.terms) < len(many.terms)
    assert len(Spectrum(RbfKernel(500.0, 500.0, 1.0, 1e-9), (10.0, 10.0)).terms) == 1
    covariance = 0.0
    for i, j in many.terms:
        covariance += (many.roots[0][i] * many.roots[1][j]) ** 2 / 150**2
    assert covariance == pytest.approx(SMOOTH.amplitude, rel=0.3)


@pytest.mark.parametrize("learn_from", ["model", "observations"])
def test_the_kit_accepts_it(learn_from, tmp_path, monkeypatch):
    # What is promised holds for whatever kernel, so few simulations are enough.
    monkeypatch.setattr(prior, "_MOST_SIMULATIONS", 20)
    monkeypatch.setattr(prior, "_SOIL_SIMULATIONS", 16)
    monkeypatch.setattr(prior, "_in_memory", {})
    check_estimator(
        make_estimator("gp", method="local", learn_from=learn_from, cache=tmp_path), n_observations=40
    )


def test_the_same_arrays_follow_a_flight_read_only():
    shape = (400, 300)
    grid = grid_of(*shape)
    estimator = GaussianProcessEstimator((1, 1, 1), SICK, optimise=False, method="local").fit(grid)
    x, y = way(shape, 900, 40)
    seen = observe(x, y, np.where(x % 7 == 0, 0.5, 1.0))
    first = estimator.partial_fit(seen[:500]).predict()
    assert first.changed is None
    assert not first.value.flags.writeable
    assert not first.uncertainty.flags.writeable
    later = estimator.partial_fit(seen[500:]).predict()
    assert np.shares_memory(first.value, later.value)
    assert later.revision == first.revision + 1
    assert 0 < later.changed.sum() < later.changed.size
    again = estimator.predict()
    assert not again.changed.any()
    fresh = (
        GaussianProcessEstimator((1, 1, 1), SICK, optimise=False, method="local").fit(grid, seen).predict()
    )
    np.testing.assert_array_equal(later.value, fresh.value)
    other = copy.deepcopy(estimator).partial_fit(seen[:5]).predict()
    assert not np.shares_memory(other.value, later.value)


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


@pytest.mark.parametrize("length", [1.5, 4.0, 20.0, 90.0])
@pytest.mark.parametrize("density", [1e-4, 1.0])
def test_the_functions_of_a_farm_are_refused_by_their_number_without_counting_them(length, density):
    kernel = RbfKernel(length, 1.3 * length, 0.01, 0.2)
    functions = len(Spectrum(kernel, (300.0, 200.0), density).terms)
    assert Spectrum.fewest_functions(kernel, (300.0, 200.0), density) <= functions
    observations = round(density * 300 * 200)
    farm = WholePosterior.spectrum_of_farm((300, 200), kernel, observations)
    few = len(farm.terms)
    assert WholePosterior.spectrum_of_farm((300, 200), kernel, observations, few) is not None
    assert WholePosterior.spectrum_of_farm((300, 200), kernel, observations, few - 1) is None


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


@pytest.mark.parametrize(
    ("length", "share"),
    [(1.5, 1e-6), slow(1.5, 0.1), slow(4.0, 1e-6), (4.0, 0.1)],
)
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
