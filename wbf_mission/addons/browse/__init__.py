"""The commands that show what is known: farms, vehicles, scenarios."""
