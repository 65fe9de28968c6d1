"""Estimators: observations in, an information model of the whole farm out."""

from sensors.estimators.base import Estimator, estimator_names, make_estimator

__all__ = ["Estimator", "estimator_names", "make_estimator"]
