"""Sensing: the environment, the leaf camera, the estimators and the score."""
