"""The one place where feet exist: a cell of the Waterberry Farms benchmark is one square foot."""

FOOT_M = 0.3048
"""Metres in one international foot (exact)."""
