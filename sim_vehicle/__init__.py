"""The simulated vehicle: motion, battery, mission execution, MAVLink, and its camera."""
