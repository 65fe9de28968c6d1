"""The estimator epidemic, based on a model of the spread of diseases."""
