"""The estimator gp: Gaussian processes."""
