"""The conformance kit: what every estimator promises, checked on a small farm.

For the authors of estimators, in this package or any other::

    from sensors.estimators import check_estimator, make_estimator

    def test_mine():
        check_estimator(make_estimator("mine", random_state=0))
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import fields as columns_of

import numpy as np

from geo.grid import FarmGrid
from sensors.errors import EstimatorError, ObservationError
from sensors.estimators.base import Estimator
from sensors.fields import FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.tiles import TILE_CELLS

SHAPE = (12, 9)
WIDE_SHAPE = (150, 70)


def check_estimator(estimator: Estimator, *, n_observations: int = 14) -> None:
    """Check an estimator, given as it comes from its ``__init__``; it is copied, never changed.

    Parameters
    ----------
    estimator : Estimator
        Not fitted yet. If it takes a ``random_state``, it has to be given one.
    n_observations : int, optional
        How many observations the checks make.

    Raises
    ------
    AssertionError
        Naming the first promise that is broken.

    Examples
    --------
    >>> from sensors.estimators import make_estimator
    >>> check_estimator(make_estimator("point"))
    """
    for check in _CHECKS:
        check(_Subject(estimator, n_observations))


class _Subject:
    """Fresh copies of the estimator, and a farm with observations that they may look at."""

    def __init__(self, estimator: Estimator, n_observations: int) -> None:
        self._estimator = estimator
        self.name = type(estimator).__name__
        self.grid, self.wide_grid = _farm(SHAPE), _farm(WIDE_SHAPE)
        rng = np.random.default_rng(20)
        self.seen = _observations(
            rng.integers(0, SHAPE[0], n_observations),
            rng.integers(0, SHAPE[1], n_observations),
            rng.choice([0.0, 0.5, 1.0], (n_observations, len(FIELDS))),
        )
        self.spread = _observations(
            rng.integers(0, WIDE_SHAPE[0], n_observations),
            rng.integers(0, WIDE_SHAPE[1], n_observations),
            rng.choice([0.0, 0.5, 1.0], (n_observations, len(FIELDS))),
        )

    def fresh(self) -> Estimator:
        return copy.deepcopy(self._estimator)

    def model(self, seen: Observations | None) -> InformationModel:
        return self.fresh().fit(self.grid, seen).predict()

    def require(self, promise: bool, text: str) -> None:
        if not promise:
            raise AssertionError(f"{self.name}: {text}")

    def require_form(self, model: InformationModel, when: str) -> None:
        self.require(isinstance(model, InformationModel), f"predict {when} must return an InformationModel")
        for name, array in (("value", model.value), ("uncertainty", model.uncertainty)):
            shape = (len(FIELDS), *SHAPE)
            self.require(array.shape == shape, f"{name} {when} has shape {array.shape}, not {shape}")
            self.require(array.dtype == np.float32, f"{name} {when} is {array.dtype}, not float32")
            self.require(bool(np.isfinite(array).all()), f"{name} {when} is not finite in every cell")
        self.require(bool((model.uncertainty >= 0).all()), f"uncertainty {when} is negative in some cell")

    def require_same(
        self, a: InformationModel, b: InformationModel, text: str, tolerance: float = 0.0
    ) -> None:
        pairs = ((a.value, b.value), (a.uncertainty, b.uncertainty))
        same = all(np.allclose(one, two, rtol=0, atol=tolerance, equal_nan=True) for one, two in pairs)
        self.require(same, text)


def _farm(shape: tuple[int, int]) -> FarmGrid:
    crop = np.full(shape, 1, np.int8)
    crop[:, shape[1] // 2 :] = 2
    return FarmGrid(shape, 0.3048, crop, np.ones(shape, np.bool_))


def _observations(
    x: np.typing.ArrayLike, y: np.typing.ArrayLike, values: np.typing.ArrayLike
) -> Observations:
    columns, rows, values = np.asarray(x, np.int32), np.asarray(y, np.int32), np.asarray(values, np.float32)
    return Observations(
        columns, rows, np.arange(len(columns), dtype=float), np.full(len(columns), 6, np.int32), values
    )


def _check_protocol(subject: _Subject) -> None:
    estimator = subject.fresh()
    subject.require(isinstance(estimator, Estimator), "must have the methods fit, partial_fit and predict")
    subject.require(estimator.fit(subject.grid) is estimator, "fit must return the estimator itself")
    subject.require(
        estimator.partial_fit(subject.seen) is estimator, "partial_fit must return the estimator itself"
    )


def _check_refuses_before_fit(subject: _Subject) -> None:
    attempts: tuple[tuple[str, Callable[[Estimator], object]], ...] = (
        ("predict", lambda estimator: estimator.predict()),
        ("partial_fit", lambda estimator: estimator.partial_fit(subject.seen)),
    )
    for name, attempt in attempts:
        try:
            attempt(subject.fresh())
        except EstimatorError:
            continue
        raise AssertionError(f"{subject.name}: {name} before fit must raise EstimatorError")


def _check_nothing_seen(subject: _Subject) -> None:
    nothing = subject.model(None)
    subject.require_form(nothing, "before any observation")
    subject.require_same(
        nothing,
        subject.model(Observations.empty()),
        "no observations and an empty set of them must be the same",
    )
    later = subject.fresh().fit(subject.grid, subject.seen)
    before = later.predict()
    subject.require_same(
        before, later.partial_fit(Observations.empty()).predict(), "an empty partial_fit must change nothing"
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
        estimator.predict(), estimator.predict(), "predict must give the same again when nothing was learned"
    )


def _check_chunks(subject: _Subject) -> None:
    whole = subject.model(subject.seen)
    step = max(1, len(subject.seen) // 3)
    estimator = subject.fresh().fit(subject.grid)
    for start in range(0, len(subject.seen), step):
        estimator.partial_fit(subject.seen[start : start + step])
        estimator.predict()
    text = "partial_fit piece by piece must predict what fit on everything at once predicts"
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
    estimator.partial_fit(_observations([5], [5], [[0.0, 0.0, 1.0]])).predict()
    # Arrays that the caller may write to are his own; the estimator's are read-only and change with it.
    for one, other in ((model.value, kept.value), (model.uncertainty, kept.uncertainty)):
        if one.flags.writeable:
            text = "an array that can be written to must not change when the estimator learns more"
            subject.require(np.array_equal(one, other), text)
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
        np.array_equal(getattr(before, column.name), getattr(subject.seen, column.name), equal_nan=True)
        for column in columns_of(Observations)
    )
    subject.require(same and np.array_equal(crop, subject.grid.crop), "fit must not change its inputs")


def _check_not_sensed(subject: _Subject) -> None:
    nothing = subject.model(None)
    for k, name in enumerate(FIELDS):
        values = subject.seen.values.copy()
        values[:, k] = np.nan
        partial = subject.model(_observations(subject.seen.x, subject.seen.y, values))
        subject.require_form(partial, f"when {name} was never sensed")
        subject.require(
            np.allclose(partial.value[k], nothing.value[k], atol=1e-6),
            f"{name} must keep its default when it was never sensed (NaN)",
        )
    values = subject.seen.values.copy()
    values[::2, 0] = np.nan
    subject.require_form(subject.model(_observations(subject.seen.x, subject.seen.y, values)), "with gaps")


def _check_duplicates(subject: _Subject) -> None:
    often = _observations([4] * 6, [3] * 6, [[0.5, 1.0, 0.25]] * 6)
    subject.require_form(subject.model(often), "when one cell was observed again and again")


def _check_outside(subject: _Subject) -> None:
    for x, y in ((-1, 0), (0, SHAPE[1]), (SHAPE[0], 0)):
        estimator = subject.fresh().fit(subject.grid)
        try:
            estimator.partial_fit(_observations([x], [y], [[1.0, 1.0, 0.5]]))
        except ObservationError:
            continue
        raise AssertionError(f"{subject.name}: an observation outside the farm must raise ObservationError")


_CHECKS: tuple[Callable[[_Subject], None], ...] = (
    _check_protocol,
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
