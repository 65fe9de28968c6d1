"""Errors of training environments."""

from geo.errors import WbfMissionError


class TrainingError(WbfMissionError, ValueError):
    """A training environment that cannot be made, or is used in a way that makes no sense."""
