"""Information model and score."""
