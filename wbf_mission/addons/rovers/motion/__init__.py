"""A rover's motion."""
