"""Sensing: environment, leaf camera, estimators and score."""
