"""What a Gaussian process says of the three classes of a plant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from geo.farms import get_farm
from geo.seeds import child_seed
from sensors.environment import generate_environment
from sensors.estimators.gp.classes import ClassLink, ClassMap
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore

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


@given(st.lists(st.floats(-0.5, 1.5), min_size=2, max_size=20))
def test_a_lower_mean_never_makes_a_plant_likelier_healthy(means):
    sick = ClassLink(0.05, 0.09, 1.4).sick_of_mean(np.sort(np.array(means)))
    assert (np.diff(sick) <= 1e-6).all()
    assert (sick > 0).all()
    assert (sick < 1).all()


def test_before_anything_is_seen_a_plant_is_sick_as_often_as_in_environments():
    grid = get_farm("miniberry-30").grid()
    model = GaussianProcessEstimator().fit(grid).predict()
    fields = np.array(
        [generate_environment(grid, days=DAY, seed=s, keep_days=[DAY]).values(DAY) for s in range(500, 540)]
    )
    for k, field in enumerate(PAPER_FIELDS.diseases):
        hosts = field.hosts(grid)
        sick, healthy = (fields[:, k][:, hosts] < 1.0).mean(), model.probabilities[field.name][0]
        assert np.ptp(healthy[hosts]) < 1e-6
        assert 1.0 - healthy[hosts].mean() == pytest.approx(sick, rel=0.25)
        assert (healthy[~hosts] == 1.0).all()
        assert (model.uncertainty[k][~hosts] == 0.0).all()


def test_plants_that_were_not_observed_are_sick_as_often_as_it_says_and_cost_less():
    grid = get_farm("miniberry-30").grid()
    masks = PAPER_FIELDS.masks(grid)
    told, sick, losses = np.zeros(2), np.zeros(2), {"classes": 0.0, "mean": 0.0}
    for seed in range(700, 712):
        environment = generate_environment(
            grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY]
        )
        truth = np.asarray(environment.values(DAY))
        seen = look(environment, rows(grid.shape))
        for states in losses:
            model = GaussianProcessEstimator(states=states).fit(grid, seen).predict()
            losses[states] += RunningScore(truth, masks).evaluate(model).loss
            if states == "mean":
                assert model.probabilities is None
                continue
            unseen = np.ones(grid.shape, bool)
            unseen[seen.x, seen.y] = False
            for k, field in enumerate(PAPER_FIELDS.diseases):
                told[k] += 1.0 - model.probabilities[field.name][0][masks[k] & unseen].mean()
                sick[k] += (truth[k][masks[k] & unseen] < 1.0).mean()
                assert (model.value[k][masks[k] & ~unseen] == truth[k][masks[k] & ~unseen]).all()
    np.testing.assert_allclose(told, sick, rtol=0.3)
    assert losses["classes"] < 0.8 * losses["mean"]


@pytest.mark.parametrize("pieces", [1, 4])
def test_the_local_way_decides_as_the_exact_one(pieces):
    grid = get_farm("miniberry-30").grid()
    environment = generate_environment(grid, days=DAY, seed=3, keep_days=[DAY])
    seen = look(environment, rows(grid.shape))
    exact = GaussianProcessEstimator(method="exact").fit(grid, seen).predict()
    local = GaussianProcessEstimator(method="local").fit(grid)
    for part in np.array_split(np.arange(len(seen)), pieces):
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
    noisy = Observations(x[2:], y[2:], [2.0], [DAY], [[0.8, 1.0, 0.3]])
    estimator = GaussianProcessEstimator(method=method).fit(grid, exact)
    model = estimator.predict()
    assert model.value[0, x[:2], y[:2]].tolist() == [0.5, 1.0]
    assert (model.uncertainty[0, x[:2], y[:2]] == 0.0).all()
    model = estimator.partial_fit(noisy).predict()
    assert (model.uncertainty[0, x, y] > 0.0).all()


def test_readings_of_the_day_before_are_not_those_of_today():
    grid = get_farm("miniberry-30").grid()
    x, y = np.argwhere(grid.crop == 2)[[5, 60]].T
    seen = Observations(x, y, [0.0, 1.0], [DAY, DAY], [[1.0, 1.0, 0.3]] * 2)
    estimator = GaussianProcessEstimator(method="local").fit(grid, seen)
    assert (estimator.predict().uncertainty[0, x, y] == 0.0).all()
    assert (estimator.advance(DAY + 1).predict().uncertainty[0, x, y] > 0.0).all()
