"""The registry and the parameters."""

from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.errors import EstimatorError
from sensors.estimators import base as registry
from sensors.estimators import estimator_names, make_estimator
from sensors.estimators.point import PointEstimator
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import Observations

OURS = ("adaptive-disk", "authors-ad", "gp", "gp-sklearn", "point")
GRID = FarmGrid((6, 5), 0.3048, np.ones((6, 5), np.int8), np.ones((6, 5), bool))


def test_our_estimators_are_registered():
    assert set(OURS) <= set(estimator_names())
    assert list(estimator_names()) == sorted(estimator_names())
    with pytest.raises(EstimatorError, match=r"unknown estimator 'kriging': choose adaptive-disk, .*point"):
        make_estimator("kriging")


def register(monkeypatch, *points, group=registry.ENTRY_POINT_GROUP):
    points = [EntryPoint(name, value, group) for name, value in points]
    monkeypatch.setattr(registry, "entry_points", lambda group: EntryPoints(points).select(group=group))


def test_a_broken_plugin_is_named(monkeypatch):
    register(monkeypatch, ("theirs", "no_such_module:Estimator"), ("gone", "sensors.estimators.point:Gone"))
    assert estimator_names() == ("gone", "theirs")
    with pytest.raises(EstimatorError, match=r"'theirs' \(no_such_module:Estimator\) cannot be loaded"):
        make_estimator("theirs")
    with pytest.raises(EstimatorError, match=r"'gone' .* cannot be loaded"):
        make_estimator("gone")


def test_one_name_twice_is_refused_unless_it_is_the_same(monkeypatch):
    same = ("point", "sensors.estimators.point:PointEstimator")
    register(monkeypatch, same, same)
    assert isinstance(make_estimator("point"), PointEstimator)
    register(monkeypatch, same, ("point", "theirs:Point"))
    with pytest.raises(EstimatorError, match="'point' is registered twice"):
        make_estimator("point")


@pytest.mark.parametrize("values", [(1, 1), (1, 1, np.nan), (1, 1, 1, 1)])
@pytest.mark.parametrize("name", ["adaptive-disk", "authors-ad", "point"])
def test_default_values_are_checked(name, values):
    with pytest.raises(EstimatorError, match="give one finite number for each of tylcv, ccr, soil"):
        make_estimator(name, default_values=values).fit(GRID)


def test_point_estimator_keeps_the_last_value_of_a_cell():
    seen = Observations(
        [1, 1, 2], [1, 1, 3], [0, 1, 2], [6] * 3, [[0, 1, 0.5], [0.5, np.nan, 0.25], [1, 0, 0.75]]
    )
    model = PointEstimator().fit(GRID, seen).predict()
    assert model.value[:, 1, 1].tolist() == [0.5, 1.0, 0.25]
    assert model.value[:, 2, 3].tolist() == [1.0, 0.0, 0.75]
    assert model.value[:, 0, 0].tolist() == [1.0, 1.0, 0.0]
    assert model.uncertainty.sum() == 3 * (30 - 2)


@pytest.mark.parametrize("name", estimator_names())
def test_estimators_are_cloned_as_scikit_learns(name):
    from sklearn.base import clone

    estimator = make_estimator(name, random_state=3)
    twin = clone(estimator)
    assert twin is not estimator
    assert repr(twin) == repr(estimator)
    assert twin.set_params(**estimator.get_params(deep=False)) is twin
    with pytest.raises(EstimatorError, match=r"unknown parameter 'nonsense'"):
        twin.set_params(nonsense=1)


@pytest.mark.parametrize(("name", "params"), [("point", {}), ("adaptive-disk", {"radius": 1})])
def test_noisy_readings_are_limited_to_what_a_field_can_be(name, params):
    grid = FarmGrid((5, 5), 0.3048, np.ones((5, 5), np.int8), np.ones((5, 5), bool))
    seen = Observations([2, 0], [2, 4], [0.0, 1.0], [6, 6], [[1.2, -0.3, 0.4], [np.nan, 0.5, 1.5]])
    value = make_estimator(name, **params).fit(grid, seen).predict().value
    assert value[:, 2, 2].tolist() == [1.0, 0.0, np.float32(0.4)]
    assert value[1:, 0, 4].tolist() == [0.5, 1.0]


def test_an_estimator_that_is_an_object_is_given_back():
    mine = make_estimator("point")
    assert make_estimator(mine) is mine
    four = FieldSet((*PAPER_FIELDS, replace(PAPER_FIELDS["soil"], name="nitrogen")))
    given = make_estimator(mine, fields=four)
    assert (type(given), given.fields, mine.fields) == (type(mine), four, PAPER_FIELDS)
    with pytest.raises(
        EstimatorError, match="PointEstimator is for the fields tylcv, ccr, soil, nitrogen, but"
    ):
        make_estimator(given)
    with pytest.raises(EstimatorError, match="parameter 'radius'"):
        make_estimator(mine, radius=3)
    with pytest.raises(EstimatorError, match="estimator of type dict"):
        make_estimator({})


def test_the_default_is_the_first_that_takes_the_farm_and_its_fields_else_gp(monkeypatch):
    def default(*points):
        register(monkeypatch, *points, group=registry.DEFAULTS_GROUP)
        return registry.default_estimator(get_farm("miniberry-10"), ["tylcv", "soil"])

    takes, refuses = "operator:ne", "operator:eq"  # of a farm and the names of its fields
    assert default(("c", takes), ("b", takes), ("a", refuses)) == "b"
    assert default(("a", refuses)) == default() == "gp"
    with pytest.raises(EstimatorError, match=r"default estimator 'a' \(no_such:thing\) cannot be loaded"):
        default(("a", "no_such:thing"), ("b", takes))
