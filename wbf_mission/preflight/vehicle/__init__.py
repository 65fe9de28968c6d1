"""The vehicle that is to fly a plan: what it is asked before, and what its answers mean for the plan."""
