"""The checks of a plan; each module looks at one thing."""
