"""Gaussian process estimators."""
