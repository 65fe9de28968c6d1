"""Telemetry that a simulated vehicle sends for display in ground stations, not for the flight."""
