"""Ground vehicles under ArduPilot's Rover."""
