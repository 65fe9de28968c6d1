"""Leaderboards: submissions, audit, verification and frozen baselines."""
