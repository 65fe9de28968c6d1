"""Pictures of plans, flights, estimates and scores."""
