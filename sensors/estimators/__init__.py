"""Estimators: observations in, an information model of the whole farm out."""
