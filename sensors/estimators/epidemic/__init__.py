"""The estimator that knows how the diseases spread."""
