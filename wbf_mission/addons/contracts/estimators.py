"""Checks of the estimator contract on a small farm, also for estimators of other packages."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from geo.grid import FarmGrid
from sensors.errors import EstimatorError, ObservationError
from sensors.estimators.base import Estimator, estimator_fields, model_fault
from sensors.observations import Observations
from sensors.scoring.information import CLASSES, TILE_CELLS, InformationModel

SHAPE = (12, 9)
WIDE_SHAPE = (150, 70)


def check_estimator(estimator: Estimator, *, n_observations: int = 14) -> None:
    """Check that an estimator fulfils the contract of `Estimator`. The checks use copies of the object.

    Parameters
    ----------
    estimator : Estimator
        An unfitted estimator. An estimator with a parameter ``random_state`` needs a value for it.
    n_observations : int, optional
        Number of observations in the checks.

    Raises
    ------
    AssertionError
        If a rule is broken; the text names the first broken rule.

    Examples
    --------
    >>> from sensors.estimators import make_estimator
    >>> check_estimator(make_estimator("point"))
    """
    for check in _CHECKS:
        check(_Subject(estimator, n_observations))


class _Subject:
    """The tested estimator, with a farm and observations for the checks."""

    def __init__(self, estimator: Estimator, n_observations: int) -> None:
        self._estimator = estimator
        self.name = type(estimator).__name__
        self.fields = estimator_fields(estimator).names
        self.grid, self.wide_grid = _farm(SHAPE), _farm(WIDE_SHAPE)
        rng = np.random.default_rng(20)
        self.seen, self.spread = (
            self.observations(
                rng.integers(0, width, n_observations),
                rng.integers(0, height, n_observations),
                rng.choice([0.0, 0.5, 1.0], (n_observations, len(self.fields))),
            )
            for width, height in (SHAPE, WIDE_SHAPE)
        )

    def observations(
        self, x: np.typing.ArrayLike, y: np.typing.ArrayLike, values: np.typing.ArrayLike
    ) -> Observations:
        columns, rows = np.asarray(x, np.int32), np.asarray(y, np.int32)
        n = len(columns)
        days = np.full(n, 6, np.int32)
        return Observations(
            columns, rows, np.arange(n, dtype=float), days, np.asarray(values, np.float32), self.fields
        )

    def readings(self, *of_fields: float) -> list[float]:
        """Return a reading for each field; with fewer values than fields, the values repeat cyclically."""
        return [of_fields[k % len(of_fields)] for k in range(len(self.fields))]

    def fresh(self) -> Estimator:
        return copy.deepcopy(self._estimator)

    def model(self, seen: Observations | None) -> InformationModel:
        model = self.fresh().fit(self.grid, seen).predict()
        fault = model_fault(self._estimator, model, self.fields, SHAPE)
        self.require(fault is None, str(fault))
        return model

    def require(self, promise: bool, text: str) -> None:
        if not promise:
            raise AssertionError(f"{self.name}: {text}")

    def require_error(self, error: type[Exception], attempt: Callable[[], object], text: str) -> None:
        try:
            attempt()
        except error:
            return
        raise AssertionError(f"{self.name}: {text}")

    def require_form(self, model: InformationModel, when: str) -> None:
        for name, array in (("value", model.value), ("uncertainty", model.uncertainty)):
            shape = (len(self.fields), *SHAPE)
            self.require(array.shape == shape, f"{name} {when} has shape {array.shape}, not {shape}")
            self.require(array.dtype == np.float32, f"{name} {when} is {array.dtype}, not float32")
            self.require(bool(np.isfinite(array).all()), f"{name} {when} is not finite in every cell")
        self.require(model.fields == self.fields, f"fields {when} are {model.fields}, not {self.fields}")
        self.require(bool((model.uncertainty >= 0).all()), f"uncertainty {when} is negative in some cell")
        loss = model.expected_loss
        if loss is not None:
            good = loss.shape == (len(self.fields), *SHAPE) and loss.dtype == np.float32
            good = good and bool((loss >= 0).all()) and bool(np.isfinite(loss).all())
            text = f"expected_loss {when} must be float32[n, W, H] and never negative"
            self.require(good, text)
        for disease, array in (model.probabilities or {}).items():
            shape = (len(CLASSES), *SHAPE)
            good = array.shape == shape and array.dtype == np.float32 and bool((array >= 0).all())
            good = good and np.allclose(array.sum(axis=0), 1.0, atol=1e-4)
            text = f"probabilities of {disease} {when} must be float32{list(shape)} and add up to 1"
            self.require(bool(good), text)

    def require_same(
        self, a: InformationModel, b: InformationModel, text: str, tolerance: float = 0.0
    ) -> None:
        for first, second in ((a.value, b.value), (a.uncertainty, b.uncertainty)):
            same = np.allclose(first, second, rtol=0, atol=tolerance, equal_nan=True)
            self.require(same, text)


def _farm(shape: tuple[int, int]) -> FarmGrid:
    crop = np.full(shape, 1, np.int8)
    crop[:, shape[1] // 2 :] = 2
    return FarmGrid(shape, 0.3048, crop, np.ones(shape, np.bool_))


def _check_protocol(subject: _Subject) -> None:
    estimator = subject.fresh()
    subject.require(isinstance(estimator, Estimator), "must have the methods fit, partial_fit and predict")
    subject.require(estimator.fit(subject.grid) is estimator, "fit must return the estimator itself")
    subject.require(
        estimator.partial_fit(subject.seen) is estimator, "partial_fit must return the estimator itself"
    )


def _check_parameters(subject: _Subject) -> None:
    from sklearn.base import clone

    estimator: Any = subject.fresh()
    if not (hasattr(estimator, "get_params") and hasattr(estimator, "set_params")):
        text = "must have get_params and set_params like scikit-learn's BaseEstimator"
        raise AssertionError(f"{subject.name}: {text}")
    before = estimator.get_params()
    try:
        twin = clone(estimator)
    except (TypeError, RuntimeError) as error:
        text = f"sklearn.base.clone must work; __init__ may only store its parameters ({error})"
        raise AssertionError(f"{subject.name}: {text}") from error
    subject.require(type(twin) is type(estimator), "clone must give an estimator of the same class")
    subject.require(set(twin.get_params()) == set(before), "a clone must have the same parameters")
    subject.require(
        estimator.set_params(**before) is estimator, "set_params must return the estimator itself"
    )
    same = all(estimator.get_params()[name] is value for name, value in before.items())
    subject.require(same, "set_params must store the given values")
    subject.require_error(
        ValueError,
        partial(estimator.set_params, no_such_parameter=1),
        "set_params must refuse an unknown name with EstimatorError",
    )


def _check_refuses_before_fit(subject: _Subject) -> None:
    text = "before fit must raise EstimatorError"
    subject.require_error(EstimatorError, subject.fresh().predict, f"predict {text}")
    learn = subject.fresh().partial_fit
    subject.require_error(EstimatorError, partial(learn, subject.seen), f"partial_fit {text}")


def _check_nothing_seen(subject: _Subject) -> None:
    nothing = subject.model(None)
    subject.require_form(nothing, "before any observation")
    subject.require_same(
        nothing,
        subject.model(Observations.empty(subject.fields)),
        "fit with None and with empty observations must predict the same",
    )
    later = subject.fresh().fit(subject.grid, subject.seen)
    before = later.predict()
    subject.require_same(
        before,
        later.partial_fit(Observations.empty(subject.fields)).predict(),
        "an empty partial_fit must change nothing",
    )


def _check_form_and_effect(subject: _Subject) -> None:
    model = subject.model(subject.seen)
    subject.require_form(model, "after observations")
    nothing = subject.model(None)
    subject.require(
        not np.array_equal(model.value, nothing.value), "observations must change the value somewhere"
    )


def _check_deterministic(subject: _Subject) -> None:
    first, second = subject.model(subject.seen), subject.model(subject.seen)
    subject.require_same(first, second, "two copies with the same random_state must predict the same")
    estimator = subject.fresh().fit(subject.grid, subject.seen)
    subject.require_same(
        estimator.predict(), estimator.predict(), "predict must repeat its map if nothing was learned"
    )


def _check_chunks(subject: _Subject) -> None:
    whole = subject.model(subject.seen)
    step = max(1, len(subject.seen) // 3)
    estimator = subject.fresh().fit(subject.grid)
    for start in range(0, len(subject.seen), step):
        estimator.partial_fit(subject.seen[start : start + step])
        estimator.predict()
    text = "partial_fit in pieces must give the same prediction as fit on all observations"
    subject.require_same(whole, estimator.predict(), text, 1e-4)


def _check_forgets(subject: _Subject) -> None:
    estimator = subject.fresh().fit(subject.grid, subject.seen)
    estimator.predict()
    half = subject.seen[: len(subject.seen) // 2]
    again = estimator.fit(subject.grid, half).predict()
    subject.require_same(again, subject.model(half), "fit must forget what was learned before", 1e-6)


def _check_arrays(subject: _Subject) -> None:
    estimator = subject.fresh().fit(subject.grid, subject.seen)
    model = estimator.predict()
    kept = model.copy()
    estimator.partial_fit(subject.observations([5], [5], [subject.readings(0.0, 0.0, 1.0)])).predict()
    # Writeable arrays belong to the caller and must not change; read-only views may change in place.
    for array, before in ((model.value, kept.value), (model.uncertainty, kept.uncertainty)):
        if array.flags.writeable:
            text = "a returned writeable array must not change when the estimator learns more"
            subject.require(np.array_equal(array, before), text)
    estimator = subject.fresh().fit(subject.grid, subject.seen)
    spoilt = estimator.predict()
    for array in (spoilt.value, spoilt.uncertainty):
        if array.flags.writeable:
            array[:] = 7.0
    text = "changing a returned model must not change the estimator (make its arrays read-only)"
    subject.require_same(kept, estimator.predict(), text)


def _check_changed(subject: _Subject) -> None:
    estimator = subject.fresh().fit(subject.grid)
    estimator.predict()
    if estimator.partial_fit(subject.seen[:1]).predict().changed is None:
        return
    grid = subject.wide_grid
    before = estimator.fit(grid).predict().copy()
    for start, stop in ((0, 3), (3, 4), (4, 4), (4, len(subject.spread))):
        model = estimator.partial_fit(subject.spread[start:stop]).predict()
        if model.changed is not None:
            for k in range(len(model.value)):
                same = ~np.kron(model.changed_in(k), np.ones((TILE_CELLS, TILE_CELLS), np.bool_))
                same = same[: grid.shape[0], : grid.shape[1]]
                for name in ("value", "uncertainty"):
                    was, now = getattr(before, name)[k], getattr(model, name)[k]
                    text = f"{name} differs from the last model in a tile that is not reported as changed"
                    subject.require(np.array_equal(was[same], now[same]), text)
        before = model.copy()


def _check_inputs_untouched(subject: _Subject) -> None:
    before = copy.deepcopy(subject.seen)
    crop = subject.grid.crop.copy()
    subject.model(subject.seen)
    same = all(
        np.array_equal(getattr(before, name), getattr(subject.seen, name), equal_nan=True)
        for name in ("x", "y", "time_s", "day", "values")
    )
    subject.require(same and np.array_equal(crop, subject.grid.crop), "fit must not change its inputs")


def _check_not_sensed(subject: _Subject) -> None:
    nothing = subject.model(None)
    for k, name in enumerate(subject.fields):
        values = subject.seen.values.copy()
        values[:, k] = np.nan
        partial = subject.model(subject.observations(subject.seen.x, subject.seen.y, values))
        subject.require_form(partial, f"when {name} was never sensed")
        subject.require(
            np.allclose(partial.value[k], nothing.value[k], atol=1e-6),
            f"{name} must keep its default when it was never sensed (NaN)",
        )
    values = subject.seen.values.copy()
    values[::2, 0] = np.nan
    subject.require_form(
        subject.model(subject.observations(subject.seen.x, subject.seen.y, values)), "with gaps"
    )


def _check_duplicates(subject: _Subject) -> None:
    often = subject.observations([4] * 6, [3] * 6, [subject.readings(0.5, 1.0, 0.25)] * 6)
    subject.require_form(subject.model(often), "when one cell was observed several times")


def _check_outside(subject: _Subject) -> None:
    for x, y in ((-1, 0), (0, SHAPE[1]), (SHAPE[0], 0)):
        learn = subject.fresh().fit(subject.grid).partial_fit
        outside = subject.observations([x], [y], [subject.readings(1.0, 1.0, 0.5)])
        text = "an observation outside the farm must raise ObservationError"
        subject.require_error(ObservationError, partial(learn, outside), text)


_CHECKS: tuple[Callable[[_Subject], None], ...] = (
    _check_protocol,
    _check_parameters,
    _check_refuses_before_fit,
    _check_deterministic,
    _check_nothing_seen,
    _check_form_and_effect,
    _check_chunks,
    _check_forgets,
    _check_arrays,
    _check_changed,
    _check_inputs_untouched,
    _check_not_sensed,
    _check_duplicates,
    _check_outside,
)
