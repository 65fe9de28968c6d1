"""Contract checks: whether a planner, policy or estimator keeps its contract."""
