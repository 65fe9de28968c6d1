"""Energy of a flight: power, battery, endurance."""
