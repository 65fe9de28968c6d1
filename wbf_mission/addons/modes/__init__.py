"""Modes of a simulated vehicle that no mission needs: follow me, CIRCLE, FLIP and orbits."""
