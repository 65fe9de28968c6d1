"""The checks of a plan and of the vehicle that is to fly it; each module looks at one thing."""
