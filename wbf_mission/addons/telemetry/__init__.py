"""Telemetry of a simulated vehicle that is shown by ground stations but not needed for the flight."""
