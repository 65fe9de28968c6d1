"""Leaderboards: submissions, their audit and verification, frozen baselines."""
