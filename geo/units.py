"""The foot, used only for the Waterberry Farms benchmark, with cells of one square foot."""

FOOT_M = 0.3048
"""Metres in one international foot (exact)."""
