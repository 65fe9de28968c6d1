"""Planners: a farm, a start and a budget in, a path within the budget out."""
