"""Prediction of a mission's time, energy and path, without telemetry."""
