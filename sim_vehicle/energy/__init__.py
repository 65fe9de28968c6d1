"""Energy of a vehicle: power, battery, endurance."""
