"""Commands that list and show the known farms, vehicles and scenarios."""
