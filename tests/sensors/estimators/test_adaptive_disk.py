"""The adaptive disk: against its definition, and against the authors' published estimates."""

import pickle
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from estimator_inputs import grid_of, observations
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from sensors.errors import EstimatorError
from sensors.estimators.adaptive_disk import AdaptiveDiskEstimator
from sensors.estimators.disks import adaptive_radius, centred_disk
from sensors.scoring.information import TILE_CELLS, tile_shape

GOLDEN = Path(__file__).parents[2] / "data" / "golden"


def by_definition(shape, seen, default_values, radius=None):
    """Cell by cell: the latest observation of the field within the radius."""
    value = np.empty((3, *shape), np.float32)
    uncertainty = np.ones_like(value)
    for k in range(3):
        value[k] = default_values[k]
        sensed = [i for i in range(len(seen)) if not np.isnan(seen.values[i, k])]
        r = radius or (adaptive_radius(len(sensed), shape) if sensed else 0)
        for x, y in np.ndindex(shape):
            for i in sensed:
                if (seen.x[i] - x) ** 2 + (seen.y[i] - y) ** 2 <= r * r:
                    value[k, x, y] = seen.values[i, k]
                    uncertainty[k, x, y] = 0
    return value, uncertainty


@st.composite
def farms_and_observations(draw):
    width, height = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    n = draw(st.integers(0, 12))
    x = draw(st.lists(st.integers(0, width - 1), min_size=n, max_size=n))
    y = draw(st.lists(st.integers(0, height - 1), min_size=n, max_size=n))
    number = st.sampled_from([0.0, 0.25, 0.5, 1.0, float("nan")])
    values = draw(st.lists(st.tuples(number, number, number), min_size=n, max_size=n))
    cuts = draw(st.lists(st.integers(0, n), max_size=4).map(sorted))
    return (width, height), observations(x, y, values), cuts


@pytest.mark.kernel
@sweep(few=40, many=200)
@given(case=farms_and_observations(), radius=st.sampled_from([None, 1, 3]))
def test_it_is_its_definition_whatever_the_pieces(case, radius):
    shape, seen, cuts = case
    radius = min(radius, *[max(shape)]) if radius else None
    estimator = AdaptiveDiskEstimator(default_values=(1, 0.75, 0.125), radius=radius).fit(grid_of(*shape))
    for start, stop in zip([0, *cuts], [*cuts, len(seen)], strict=True):
        estimator.partial_fit(seen[start:stop])
        if start % 2:
            estimator.predict()
    model = estimator.predict()
    value, uncertainty = by_definition(shape, seen, (1, 0.75, 0.125), radius)
    np.testing.assert_array_equal(model.value, value)
    np.testing.assert_array_equal(model.uncertainty, uncertainty)


@given(st.integers(0, 40))
def test_the_disk_is_round_and_centred(radius):
    disk = centred_disk(radius)
    i, j = np.indices((2 * radius + 1,) * 2) - radius
    assert disk.first == -radius
    assert np.array_equal((disk.low[:, None] <= j) & (j < disk.high[:, None]), i**2 + j**2 <= radius**2)


@given(st.integers(1, 10**6), st.integers(1, 6000), st.integers(1, 6000))
def test_the_disks_have_about_twice_the_farms_area(n, width, height):
    radius = adaptive_radius(n, (width, height))
    assert radius >= 1
    assert (radius - 1) ** 2 * np.pi * n <= 2 * width * height <= radius**2 * np.pi * n


def test_fields_sensed_together_share_their_disks():
    rng = np.random.default_rng(5)
    values = rng.random((30, 3))
    estimator = AdaptiveDiskEstimator().fit(grid_of(20, 20), observations([1] * 30, [1] * 30, values))
    assert len(set(estimator.maps_)) == 1
    values[3, 2] = np.nan
    estimator.partial_fit(observations([1] * 30, [1] * 30, values))
    assert len(set(estimator.maps_)) == 2
    assert estimator.maps_[0] is estimator.maps_[1]


@pytest.mark.parametrize("radius", [0, -1, 2.5, 21, "wide"])
def test_impossible_radii_are_named(radius):
    with pytest.raises(EstimatorError, match=r"radius .*from 1 to 20"):
        AdaptiveDiskEstimator(radius=radius).fit(grid_of(20, 10))


def test_memory_is_the_result_and_one_map():
    shape = (2000, 1500)
    rng = np.random.default_rng(6)
    seen = observations(rng.integers(0, 2000, 3000), rng.integers(0, 1500, 3000), rng.random((3000, 3)))
    tracemalloc.start()
    AdaptiveDiskEstimator().fit(grid_of(*shape), seen).predict()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.4 * (6 + 1) * 4 * shape[0] * shape[1]


def painted(shape, seen, radius=None):
    """Disk by disk over the whole farm, every field sensed by every observation."""
    value = np.empty((3, *shape), np.float32)
    value[:] = np.array([1, 1, 0])[:, None, None]
    uncertainty = np.ones_like(value)
    i, j = np.indices(shape)
    r = radius or (adaptive_radius(len(seen), shape) if len(seen) else 0)
    for x, y, row in zip(seen.x, seen.y, seen.values, strict=True):
        disk = (i - x) ** 2 + (j - y) ** 2 <= r * r
        value[:, disk] = row[:, None]
        uncertainty[:, disk] = 0
    return value, uncertainty


@sweep(few=15, many=80)
@given(
    shape=st.tuples(st.integers(1, 200), st.integers(1, 200)),
    n=st.integers(0, 60),
    seed=st.integers(0, 1000),
    radius=st.sampled_from([None, 1, 5, 70]),
    pieces=st.integers(1, 8),
)
def test_farms_of_many_tiles_are_kept_up_to_date(shape, n, seed, radius, pieces):
    rng = np.random.default_rng(seed)
    radius = min(radius, *[max(shape)]) if radius else None
    seen = observations(rng.integers(0, shape[0], n), rng.integers(0, shape[1], n), rng.random((n, 3)))
    estimator = AdaptiveDiskEstimator(radius=radius).fit(grid_of(*shape))
    stop = 0
    before = None
    for piece in range(1, pieces + 1):
        start, stop = stop, n * piece // pieces
        model = estimator.partial_fit(seen[start:stop]).predict()
        value, uncertainty = painted(shape, seen[:stop], radius)
        np.testing.assert_array_equal(model.value, value)
        np.testing.assert_array_equal(model.uncertainty, uncertainty)
        assert model.revision == piece - 1
        if before is None:
            assert model.changed is None
        else:
            cells = np.any((value != before[0]) | (uncertainty != before[1]), axis=0)
            tiles = np.zeros(tile_shape(shape), bool)
            x, y = np.nonzero(cells)
            tiles[x // TILE_CELLS, y // TILE_CELLS] = True
            np.testing.assert_array_equal(model.changed, tiles)
        before = value, uncertainty


def test_a_running_flight_writes_in_place_and_only_where_its_disks_are():
    rng = np.random.default_rng(8)
    grid = grid_of(2000, 1500)
    seen = observations(100 + np.arange(600), np.full(600, 90), rng.random((600, 3)))
    estimator = AdaptiveDiskEstimator().fit(grid, seen[:500])
    first = estimator.predict()
    tracemalloc.start()
    later = estimator.partial_fit(seen[500:]).predict()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert later.value is first.value
    assert later.uncertainty is first.uncertainty
    assert peak < 500_000
    assert 0 < later.changed.mean() < 0.1
    again = estimator.predict()
    assert not again.changed.any()
    assert again.revision == 2
    with pytest.raises(ValueError, match="read-only"):
        later.value[0, 0, 0] = 1


def test_copies_of_an_estimator_go_their_own_ways():
    rng = np.random.default_rng(9)
    seen = observations(rng.integers(0, 90, 40), rng.integers(0, 90, 40), rng.random((40, 3)))
    one = AdaptiveDiskEstimator().fit(grid_of(90, 90), seen[:20])
    one.predict()
    other = pickle.loads(pickle.dumps(one))
    value = one.predict().copy().value
    np.testing.assert_array_equal(other.partial_fit(seen[20:]).predict().value, painted((90, 90), seen)[0])
    np.testing.assert_array_equal(one.predict().value, value)


def test_fields_that_part_get_an_uncertainty_of_their_own():
    rng = np.random.default_rng(10)
    values = rng.random((30, 3))
    estimator = AdaptiveDiskEstimator().fit(grid_of(80, 70), observations([20] * 30, [30] * 30, values))
    model = estimator.predict()
    assert model.uncertainty.strides[0] == 0
    values[:, 1] = np.nan
    model = estimator.partial_fit(observations([60] * 30, [60] * 30, values)).predict()
    assert model.uncertainty[:, 60, 60].tolist() == [0, 1, 0]
    assert model.uncertainty[:, 20, 30].tolist() == [0, 0, 0]
