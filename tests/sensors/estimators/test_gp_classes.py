"""What a Gaussian process says of the three classes of a plant."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from geo.farms import get_farm
from sensors.environment import generate_environment
from sensors.estimators.gp.classes import ClassLink, ClassMap
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.observations import Observations

DAY = 6
CLASS_VALUES = np.array([1.0, 0.5, 0.0])


def look(environment, cells):
    x, y = cells.T
    n = len(x)
    return Observations(x, y, np.arange(n), np.full(n, DAY), environment.sample(DAY, x, y))


def rows(shape, gap=4, first=1):
    return np.array([(x, y) for y in range(first, shape[1], gap) for x in range(shape[0])])


@settings(max_examples=60, deadline=None)
@given(
    sick=st.floats(0.001, 0.6),
    lost=st.floats(0.0, 1.0),
    slope=st.floats(0.5, 3.0),
    too_healthy=st.sampled_from([1.0, 2.0, 10.0]),
    too_sick=st.sampled_from([0.5, 1.0]),
    mean=st.floats(-0.2, 1.2),
)
def test_value_deviation_and_loss_are_those_of_the_probabilities(
    sick, lost, slope, too_healthy, too_sick, mean
):
    link = ClassLink(0.5 * sick * (1.0 + lost), sick, slope)
    classes = ClassMap(link, lambda where: np.ones((1, 1), bool)[where], too_healthy, too_sick)
    value, uncertainty = np.full((1, 1), mean, np.float32), np.full((1, 1), 0.3, np.float32)
    p = float(link.sick_of_mean(value)[0, 0])
    classes.decide(value, uncertainty)
    right = np.array([1.0 - p, p * (1.0 - link.lost), p * link.lost])

    def charged(estimate):
        error = estimate - CLASS_VALUES
        return float(right @ (np.where(error > 0, too_healthy, too_sick) * error**2))

    best = minimize_scalar(charged, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9})
    assert value[0, 0] == pytest.approx(best.x, abs=2e-5)
    deviation = np.sqrt(right @ (CLASS_VALUES - right @ CLASS_VALUES) ** 2)
    assert uncertainty[0, 0] == pytest.approx(deviation, abs=2e-4)
    found = classes.probabilities(value, uncertainty)[:, 0, 0]
    np.testing.assert_allclose(found, right, atol=1e-4)
    loss = np.empty_like(value)
    classes.expected_loss(value, uncertainty, loss)
    assert loss[0, 0] == pytest.approx(best.fun, abs=2e-4)


def test_the_local_way_decides_as_the_exact_one():
    grid = get_farm("miniberry-30").grid()
    environment = generate_environment(grid, days=DAY, seed=3, keep_days=[DAY])
    seen = look(environment, rows(grid.shape))
    exact = GaussianProcessEstimator(method="exact").fit(grid, seen).predict()
    local = GaussianProcessEstimator(method="local").fit(grid)
    for part in np.array_split(np.arange(len(seen)), 3):
        model = local.partial_fit(seen[part]).predict()
        assert (model.expected_loss >= 0).all()
    np.testing.assert_allclose(model.value[:2], exact.value[:2], atol=2e-2)
    np.testing.assert_allclose(model.uncertainty[:2], exact.uncertainty[:2], atol=2e-2)
    np.testing.assert_allclose(model.expected_loss[:2], exact.expected_loss[:2], atol=3e-2)
    for name in ("tylcv", "ccr"):
        np.testing.assert_allclose(model.probabilities[name], exact.probabilities[name], atol=1e-2)


@pytest.mark.parametrize("method", ["exact", "local"])
def test_a_reading_that_shows_no_class_ends_the_belief_in_readings_themselves(method):
    grid = get_farm("miniberry-30").grid()
    x, y = np.argwhere(grid.crop == 2)[[5, 60, 100]].T
    exact = Observations(x[:2], y[:2], [0.0, 1.0], [DAY, DAY], [[0.5, 1.0, 0.3], [1.0, 1.0, 0.3]])
    elsewhere = Observations(*np.argwhere(grid.crop == 1)[:1].T, [0.0], [DAY], [[1.0, 1.0, 0.3]])
    exact = Observations.concatenate([elsewhere, exact])
    noisy = Observations(x[2:], y[2:], [2.0], [DAY], [[0.8, 1.0, 0.3]])
    estimator = GaussianProcessEstimator(method=method).fit(grid, exact)
    model = estimator.predict()
    assert model.value[0, x[:2], y[:2]].tolist() == [0.5, 1.0]
    assert (model.uncertainty[0, x[:2], y[:2]] == 0.0).all()
    # Nor are readings of the day before those of today.
    later = copy.deepcopy(estimator).advance(DAY + 1).predict()
    assert (later.uncertainty[0, x[:2], y[:2]] > 0.0).all()
    model = estimator.partial_fit(noisy).predict()
    assert (model.uncertainty[0, x, y] > 0.0).all()
