"""The vehicle that is to fly a plan: what it is asked before, and what it answered."""
