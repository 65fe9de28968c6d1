"""Predicted time, energy and path of a mission, without telemetry."""
