"""Rovers under PX4 and ArduPilot's Rover."""
