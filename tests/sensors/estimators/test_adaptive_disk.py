"""The adaptive disk: against its definition, and against the authors' published estimates."""

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


def painted(shape, seen, radius=None, default_values=(1, 1, 0)):
    """Disk by disk over the whole farm: the latest observation of a field within the radius."""
    value = np.empty((3, *shape), np.float32)
    value[:] = np.array(default_values)[:, None, None]
    uncertainty = np.ones_like(value)
    i, j = np.indices(shape)
    for k in range(3):
        sensed = seen[seen.sensed[:, k]]
        r = radius or (adaptive_radius(len(sensed), shape) if len(sensed) else 0)
        for x, y, row in zip(sensed.x, sensed.y, sensed.values, strict=True):
            disk = (i - x) ** 2 + (j - y) ** 2 <= r * r
            value[k, disk], uncertainty[k, disk] = row[k], 0
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
    value, uncertainty = painted(shape, seen, radius, (1, 0.75, 0.125))
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


@pytest.mark.parametrize("radius", [0, -1, 2.5, 21, "wide"])
def test_impossible_radii_are_named(radius):
    with pytest.raises(EstimatorError, match=r"radius .*from 1 to 20"):
        AdaptiveDiskEstimator(radius=radius).fit(grid_of(20, 10))


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
