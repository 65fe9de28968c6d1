"""Sticks of a ground station that fly a simulated vehicle."""
