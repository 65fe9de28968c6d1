"""The checks of estimators, and ours under them."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.estimators import make_estimator
from sensors.estimators.point import PointEstimator
from sensors.fields import PAPER_FIELDS, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel, tile_shape
from wbf_mission import check_estimator


@pytest.mark.parametrize("name", ["adaptive-disk", "authors-ad", "gp", "point"])
def test_our_estimators_conform(name):
    check_estimator(make_estimator(name, random_state=np.random.SeedSequence(1)))


def test_scikit_learn_variant_conforms():
    check_estimator(make_estimator("gp-sklearn", random_state=1, n_restarts=0), n_observations=4)


@pytest.mark.slow
def test_scikit_learn_variant_conforms_with_restarts():
    check_estimator(make_estimator("gp-sklearn", random_state=np.random.SeedSequence(1), n_restarts=1))


def test_an_estimator_of_any_fields_keeps_its_promises_with_four():
    four = FieldSet((*PAPER_FIELDS, replace(PAPER_FIELDS["soil"], name="nitrogen", default=0.25)))
    check_estimator(make_estimator("gp", fields=four))


class Broken(PointEstimator):
    """Breaks one promise of the protocol, named by `promise`."""

    def __init__(self, promise="none"):
        super().__init__()
        self.promise = promise

    def fit(self, grid, observations=None):
        kept = getattr(self, "cells_", None), getattr(self, "values_", None)
        super().fit(grid, observations)
        if self.promise == "fit must forget" and kept[0] is not None:
            for k in range(3):
                self.cells_[k] = np.append(self.cells_[k], np.setdiff1d(kept[0][k], self.cells_[k]))
                self.values_[k] = np.append(
                    self.values_[k], np.zeros(len(self.cells_[k]) - len(self.values_[k]))
                )
        return None if self.promise == "fit must return" else self

    def partial_fit(self, observations):
        if self.promise == "outside the farm" and hasattr(self, "grid_"):
            inside = (observations.x >= 0) & (observations.y >= 0)
            inside &= (observations.x < self.grid_.shape[0]) & (observations.y < self.grid_.shape[1])
            observations = observations[inside]
        if self.promise == "NaN":
            filled = np.nan_to_num(observations.values, nan=0.3)
            observations = Observations(
                observations.x, observations.y, observations.time_s, observations.day, filled
            )
        if self.promise == "in pieces" and len(observations) == 1:
            return self
        if self.promise == "in pieces":
            observations = observations[1:]
        return super().partial_fit(observations)

    def predict(self):
        if self.promise == "before fit" and not hasattr(self, "grid_"):
            return None
        model = super().predict()
        if self.promise == "is negative":
            model.uncertainty[0, 0, 0] = -1
        if self.promise == "finite":
            model.value[0, 0, 0] = np.nan
        if self.promise == "maps of shape":
            return InformationModel(model.value[:, :-1], model.uncertainty[:, :-1])
        if self.promise == "not reported as changed":
            return InformationModel(model.value, model.uncertainty, np.zeros(tile_shape(model.shape), bool))
        if self.promise == "a returned writeable array":
            self.kept = getattr(self, "kept", model.value)
            if self.kept.shape == model.value.shape:
                self.kept[:] = model.value
                return InformationModel(self.kept, model.uncertainty)
        if self.promise == "same random_state":
            model.uncertainty[:] += np.float32(np.random.default_rng().random())
        if self.promise == "must change the value":
            model.value[:] = 1
        if self.promise == "changing a returned model":
            self.model = getattr(self, "model", model)
            return self.model
        return model


@pytest.mark.parametrize(
    "promise",
    [
        "fit must return",
        "fit must forget",
        "outside the farm",
        "NaN",
        "in pieces",
        "before fit",
        "is negative",
        "finite",
        "maps of shape",
        "not reported as changed",
        "a returned writeable array",
        "same random_state",
        "must change the value",
    ],
)
def test_the_kit_finds_what_is_broken(promise):
    check_estimator(Broken())
    with pytest.raises(AssertionError, match=f"Broken: .*{promise}"):
        check_estimator(Broken(promise))


def test_the_kit_finds_shared_arrays():
    with pytest.raises(AssertionError, match="Broken: "):
        check_estimator(Broken("changing a returned model"))


def test_the_kit_leaves_the_estimator_alone():
    estimator = PointEstimator()
    check_estimator(estimator)
    assert not hasattr(estimator, "grid_")
