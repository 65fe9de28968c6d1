"""Who flies: motion, battery, mission execution, the MAVLink vehicle and its camera."""
