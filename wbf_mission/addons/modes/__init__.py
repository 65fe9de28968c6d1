"""Modes of a simulated vehicle that no mission needs: setpoints, follow me, CIRCLE, FLIP and orbits."""
