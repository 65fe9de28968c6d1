"""The estimator with a model of the spread of diseases."""
