"""Estimators, which turn observations into an information model of the whole farm."""

from sensors.estimators.base import (
    Estimator,
    advance_estimator,
    default_estimator,
    estimator_names,
    make_estimator,
    prepare_estimator,
)

__all__ = [
    "Estimator",
    "advance_estimator",
    "default_estimator",
    "estimator_names",
    "make_estimator",
    "prepare_estimator",
]
