"""Gimbal of a simulated vehicle, which turns its camera."""
