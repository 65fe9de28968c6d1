"""Animations of runs."""
