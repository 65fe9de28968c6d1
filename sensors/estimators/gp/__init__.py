"""The estimator gp, which uses Gaussian processes."""
