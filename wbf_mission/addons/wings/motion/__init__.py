"""Motion of a fixed wing."""
