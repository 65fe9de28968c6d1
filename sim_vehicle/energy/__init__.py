"""What flying costs: power, battery, endurance."""
