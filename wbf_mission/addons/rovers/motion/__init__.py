"""Motion of a rover."""
