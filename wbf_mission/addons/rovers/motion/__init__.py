"""Motion of rovers: compiled pure pursuit, and ArduPilot's Rover."""
