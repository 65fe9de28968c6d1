"""Fields that nobody has a model of: of a small file, in their unit, mapped by estimators, not simulated."""

import numpy as np
import pytest
import shapely

from geo import Crop, Farm, LocalFrame, Patch
from sensors.dynamics.continuous import Measured
from sensors.environment.generate import generate_environment
from sensors.errors import EnvironmentDataError, FieldError
from sensors.estimators.base import make_estimator
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.field_files import field_from_table, field_to_table, read_fields
from sensors.fields import ALL_CROPS, PAPER_FIELDS, Field, FieldSet
from sensors.observations import Observations

PH = {"name": "ph", "unit": "pH", "range": [4.0, 9.0], "default": 6.5, "crops": ["maize"], "weight": 2.0}


def farm(cell_size_m=1.0):
    patches = (
        Patch("m", "maize", "me", shapely.box(0, 0, 20 * cell_size_m, 20 * cell_size_m)),
        Patch("k", "kale", "me", shapely.box(20 * cell_size_m, 0, 40 * cell_size_m, 20 * cell_size_m)),
        Patch("p", Crop.POND, "me", shapely.box(5 * cell_size_m, 0, 9 * cell_size_m, 4 * cell_size_m)),
    )
    return Farm("f", LocalFrame(48.0, 11.0), 40, 20, patches, "me", (0.0, 0.0), cell_size_m)


def test_a_name_is_enough(tmp_path):
    (tmp_path / "f.toml").write_text('[[field]]\nname = "ndvi"\n')
    (field,) = read_fields(tmp_path / "f.toml")
    assert field == Field("ndvi", Measured(), (ALL_CROPS,), 0.5)
    assert (field.kind, field.is_simulated) == ("continuous", False)
    grid = farm().grid()
    np.testing.assert_array_equal(field.mask(grid), grid.of_crops(["maize", "kale"]))
    assert field.mask(grid).sum() == 40 * 20 - 16


def test_defaults_and_ranges_are_in_the_unit():
    field = field_from_table({**PH, "dynamics": {"correlation_length_m": 40.0}}, "here")
    assert (field.default, field.range, field.to_unit(field.default)) == (0.5, (4.0, 9.0), 6.5)
    assert field.from_unit(np.array([3.0, 6.5, 9.0, np.nan])).tolist() == pytest.approx(
        [0, 0.5, 1, np.nan], nan_ok=True
    )
    table = field_to_table(field)
    assert (table["kind"], table["default"], table["range"]) == ("measured", 6.5, [4.0, 9.0])
    assert field_from_table(table, "again") == field
    assert "range" not in field_to_table(PAPER_FIELDS["soil"])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"range": [9.0, 4.0]}, "range 9, 4: give two finite numbers, the lower first"),
        ({"range": [4.0, float("inf")]}, "give two finite numbers"),
        ({"default": 3.0}, "default 3 is not in 4..9"),
        (
            {"kind": "disease", "dynamics": {"likelihood": 0.1, "duration_days": 3}},
            "lost); leave out its range",
        ),
        ({"dynamics": {"correlation_length_m": 0.0}}, "correlation_length_m 0.0 is not above 0"),
        ({"dynamics": {"spread": 0.0}}, "spread 0.0 is not in 0.001..1"),
        ({"dynamics": {"length": 3.0}}, "dynamics of a measured field: unknown parameter 'length'"),
    ],
)
def test_what_is_refused(changes, text):
    with pytest.raises(FieldError) as caught:
        field_from_table({**PH, **changes}, "here")
    assert text in str(caught.value)
    assert str(caught.value).startswith("here: ")


def test_it_cannot_be_simulated():
    fields = FieldSet((*PAPER_FIELDS, field_from_table(PH, "here")))
    with pytest.raises(FieldError, match=r"^fields: ph can only be measured, .* give a kind such as "):
        fields.require_simulated()
    PAPER_FIELDS.require_simulated()
    with pytest.raises(EnvironmentDataError, match="only measured cannot be simulated"):
        generate_environment(farm().grid(), days=1, seed=1, fields=fields)


def seen(values, x, days=None):
    """Return readings along a line."""
    columns = [[value] for value in values]
    return Observations(x, [10] * len(x), list(range(len(x))), days or [6] * len(x), columns, fields=("ph",))


@pytest.mark.parametrize("name", ["gp", "adaptive-disk", "point", "gp-sklearn"])
def test_estimators_map_it(name, tmp_path):
    fields = FieldSet((field_from_table(PH, "here"),))
    options = {"cache": str(tmp_path)} if name == "gp" else {}
    estimator = make_estimator(name, fields=fields, **options)
    model = estimator.fit(farm().grid(), seen([0.2, 0.3, 0.9], [2, 4, 17])).predict()
    found = model.of("ph")
    assert found.shape == (40, 20)
    assert np.all((found >= 0.0) & (found <= 1.0))
    assert found[2, 10] < 0.45 < found[17, 10]


def test_the_process_has_the_length_of_the_file_and_the_mean_of_the_readings(tmp_path):
    def value(length_m, cell_size_m, x):
        table = {**PH, "dynamics": {"correlation_length_m": length_m, "spread": 0.5, "noise": 0.001}}
        fields = FieldSet((field_from_table(table, "here"),))
        estimator = GaussianProcessEstimator(fields=fields, cache=tmp_path)
        # Two far readings about a mean of 0.6, which is not the default.
        model = estimator.fit(farm(cell_size_m).grid(), seen([0.9, 0.3], [2, 39])).predict()
        return float(model.of("ph")[x, 10])

    assert value(3.0, 1.0, 20) == pytest.approx(0.6, abs=1e-3)
    assert value(3.0, 1.0, 5) == pytest.approx(0.6 + 0.3 * np.exp(-0.5), abs=2e-3)
    assert value(6.0, 1.0, 5) == pytest.approx(0.6 + 0.3 * np.exp(-0.125), abs=2e-3)
    assert value(6.0, 2.0, 5) == pytest.approx(value(3.0, 1.0, 5), abs=1e-6)


def test_readings_of_earlier_days_count_as_those_of_the_day(tmp_path):
    fields = FieldSet((field_from_table(PH, "here"),))
    both = seen([0.2, 0.8], [2, 30], [3, 6])
    once = seen([0.2, 0.8], [2, 30], [6, 6])
    maps = [
        GaussianProcessEstimator(fields=fields, cache=tmp_path).fit(farm().grid(), one).predict().of("ph")
        for one in (both, once)
    ]
    np.testing.assert_allclose(*maps, atol=2e-3)
