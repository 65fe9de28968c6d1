"""Smooth static fields have the moments that they claim, and go through a field file."""

import numpy as np
import pytest

from geo.farms import get_farm
from sensors.dynamics.continuous import SmoothParameters
from sensors.environment import generate_environment
from sensors.errors import EnvironmentDataError
from sensors.field_files import field_from_table, field_to_table
from sensors.fields import FieldSet

TABLE = {"name": "haze", "kind": "smooth", "crops": ["all"], "default": 0.5}


@pytest.mark.parametrize("length", [0.08, 0.15, 0.3])
def test_mean_spread_and_correlation_are_those_of_the_covariance(length):
    smooth = SmoothParameters(length, mean=0.4, spread=0.1)
    fields = np.array([next(smooth.days((30, 20), np.random.default_rng(k))) for k in range(1000)]) - 0.4
    assert fields.mean() == pytest.approx(0.0, abs=0.01)
    assert np.sqrt(np.square(fields).mean(axis=0)) == pytest.approx(0.1, rel=0.12)
    for axis, cells in ((1, 30), (2, 20)):
        moved = fields.swapaxes(1, axis)
        lag = max(1, round(length * cells))
        found = (moved[:, :-lag] * moved[:, lag:]).mean() / np.square(fields).mean()
        assert found == pytest.approx(np.exp(-((lag / (length * cells)) ** 2) / 2.0), abs=0.05)


def test_it_is_static_and_each_seed_has_its_own():
    fields = FieldSet((field_from_table(TABLE, "here"),))
    grid = get_farm("miniberry-10").grid()
    one, other = (generate_environment(grid, days=6, seed=seed, fields=fields) for seed in (1, 2))
    np.testing.assert_array_equal(one.level("haze", 0), one.level("haze", 6))
    assert not np.allclose(one.level("haze", 0), other.level("haze", 0))


def test_a_field_file_has_it():
    field = field_from_table({**TABLE, "dynamics": {"correlation_length": 0.2}}, "here")
    assert field.kind == "continuous" and field.dynamics == SmoothParameters(0.2)
    assert field_from_table(field_to_table(field), "here") == field


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"correlation_length": 0.0}, "correlation_length 0.0 is not in 0.001..2"),
        ({"mean": 1.5}, "mean 1.5 is not in 0..1"),
        ({"spread": 0.0}, "spread 0.0 is not above 0"),
    ],
)
def test_what_cannot_be_is_refused(values, text):
    with pytest.raises(EnvironmentDataError, match=text):
        SmoothParameters(**values)
