"""Simulated vehicle: motion, battery, mission execution, camera, MAVLink."""
