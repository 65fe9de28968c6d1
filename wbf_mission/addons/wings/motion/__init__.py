"""A fixed wing's motion."""
