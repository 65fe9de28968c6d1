"""Checks that a planner, policy or estimator fulfils its contract."""
