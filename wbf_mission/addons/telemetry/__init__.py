"""Telemetry of a simulated vehicle that ground stations show, and the flight does not need."""
