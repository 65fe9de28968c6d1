"""What a day does to the belief in a smooth field."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.seeds import stream
from sensors.estimators import advance_estimator, estimator_names, make_estimator
from sensors.estimators.days import Crowding, pass_day
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.estimators.gp.rbf import RbfKernel
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations

GRID = get_farm("miniberry-30").grid()
SOIL = PAPER_FIELDS.index("soil")
LEARNING = sorted({"gp", "epidemic"} & {*estimator_names()})  # with a model of the soil


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 6), st.integers(0, 30), st.floats(0.0, 0.999), st.integers(0, 2**32 - 1))
def test_a_day_is_the_prediction_of_a_kalman_filter(size, readings, correlation, seed):
    rng = np.random.default_rng(seed)
    seen = rng.normal(size=(readings, size))
    precision, response = np.eye(size) + 50.0 * seen.T @ seen, rng.normal(size=(size, 2))
    later, told = pass_day(precision, response, correlation)
    covariance = np.linalg.inv(precision)
    expected = correlation**2 * covariance + (1.0 - correlation**2) * np.eye(size)
    np.testing.assert_allclose(np.linalg.inv(later), expected, atol=1e-8)
    np.testing.assert_allclose(np.linalg.solve(later, told), correlation * covariance @ response, atol=1e-8)


def test_the_more_readings_a_stretch_has_the_less_a_further_one_counts():
    crowd = Crowding((100, 100), (40.0, 40.0))
    x, y = np.array([3, 55, 4, 9, 10]), np.array([3, 55, 5, 9, 3])
    assert crowd.weights(x, y).tolist() == [1.0, 1.0, 1.0 / 2, 1.0 / 3, 1.0]
    assert crowd.weights(x, y).tolist() == [1.0 / 4, 1.0 / 2, 1.0 / 5, 1.0 / 6, 1.0 / 2]


@pytest.mark.parametrize("name", LEARNING)
def test_the_day_after_many_readings_the_soil_is_as_uncertain_as_its_change_makes_it(name):
    # Diseases are not observed; so nothing is trained for them.
    estimator = make_estimator(name, **({"outbreaks": 50, "epochs": 2} if name == "epidemic" else {}))
    rows = np.argwhere(np.ones(GRID.shape, np.bool_))[::2]
    errors, stated = {6: [], 7: []}, {6: [], 7: []}
    for number in range(8):
        rng = stream(4100 + number, "test", "weather")
        truth = PAPER_FIELDS["soil"].continuous.simulate_coarse(GRID.shape, (6, 7), max(GRID.shape), [rng])
        x, y = rows.T
        values = np.full((len(rows), 3), np.nan)
        values[:, SOIL] = truth[0, 0, x, y]
        times_s = np.arange(len(rows), dtype=float)
        estimator.fit(GRID, Observations(x, y, times_s, np.full(len(rows), 6), values))
        for day, field in zip((6, 7), truth[:, 0], strict=True):
            advance_estimator(estimator, day)
            model = estimator.predict()
            errors[day].append(np.mean((model.value[SOIL] - field) ** 2))
            stated[day].append(np.mean(model.uncertainty[SOIL] ** 2))
    assert np.mean(errors[7]) > 5.0 * np.mean(errors[6])
    assert 0.5 < np.mean(stated[7]) / np.mean(errors[7]) < 4.0


@pytest.mark.parametrize("name", LEARNING)
@pytest.mark.parametrize("first", [10, 30])
def test_a_reading_of_yesterday_that_arrives_late_counts_as_if_it_had_come_in_time(name, first):
    parameters = {"outbreaks": 50, "epochs": 2} if name == "epidemic" else {}
    rng = np.random.default_rng(8)
    cells = rng.integers(0, 30, (60, 2))
    values = np.full((60, 3), np.nan)
    values[:, SOIL] = rng.uniform(0.4, 0.6, 60)
    seen = Observations(*cells.T, np.arange(60.0), np.repeat([5, 6], 30), values)
    in_time = make_estimator(name, **parameters).fit(GRID, seen).predict()
    late = make_estimator(name, **parameters).fit(GRID, seen[first:])
    late.predict()
    found = late.partial_fit(seen[:first]).predict()
    np.testing.assert_allclose(found.value[SOIL], in_time.value[SOIL], atol=1e-4)
    np.testing.assert_allclose(found.uncertainty[SOIL], in_time.uncertainty[SOIL], atol=1e-4)


def some_seen(count, day, *, soil=True, diseases=True, seed=0, low=0.4):
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, 30, (2, count))
    values = np.full((count, 3), np.nan)
    if soil:
        values[:, SOIL] = rng.uniform(low, low + 0.2, count)
    if diseases:
        values[:, :SOIL] = 1.0
    return Observations(x, y, np.arange(float(count)), np.full(count, day), values)


def test_soil_of_a_later_day_is_whole_when_windows_take_over_without_further_readings_of_it():
    found = []
    for asked_before in (False, True):
        estimator = GaussianProcessEstimator(memory_limit_mb=3.0).fit(GRID)
        estimator.partial_fit(some_seen(40, 6))
        advance_estimator(estimator, 7)
        if asked_before:
            estimator.predict()
        estimator.partial_fit(some_seen(200, 7, soil=False, seed=1))
        model = estimator.predict()
        found.append((model.value[SOIL].copy(), model.uncertainty[SOIL].copy()))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def on_a_large_farm(count, day, field, *, from_x=20):
    k = np.arange(count)
    values = np.full((count, 3), np.nan)
    values[:, field] = 0.5 + 0.1 * np.sin(k / 15.0)
    return Observations(from_x + k // 30, 20 + k % 30, k.astype(float), np.full(count, day), values)


def large(side, **given):
    cells = np.ones((side, side), np.bool_)
    farm = FarmGrid((side, side), GRID.cell_size_m, np.resize(GRID.crop, (side, side)), cells)
    kernel = RbfKernel(40.0, 40.0, 0.003, 0.03)
    estimator = GaussianProcessEstimator(
        (1.0, 1.0, 0.5), kernel=kernel, optimise=False, method="local", **given
    )
    return estimator.fit(farm)


def test_on_a_large_farm_readings_of_today_count_for_less_beside_those_of_earlier_days_too():
    found = []
    for asked_between in (False, True):
        estimator = large(140, learn_from="observations")
        estimator.partial_fit(on_a_large_farm(400, 6, SOIL))
        if asked_between:
            advance_estimator(estimator, 7)
            estimator.predict()
        estimator.partial_fit(on_a_large_farm(400, 7, SOIL, from_x=60))
        found.append(estimator.predict().uncertainty[SOIL].copy())
    np.testing.assert_allclose(*found, atol=1e-6)


@pytest.mark.parametrize(("field", "less"), [(0, False), (SOIL, True)])
def test_only_readings_of_the_soil_crowd(field, less):
    looked_at = np.s_[35, 35]
    uncertain = []
    for side in (128, 129):
        estimator = large(side).partial_fit(on_a_large_farm(900, 6, field))
        uncertain.append(float(estimator.predict().uncertainty[field][looked_at]))
    assert (uncertain[1] > uncertain[0] + 1e-4) == less
