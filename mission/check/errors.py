"""Errors of the conformance kit."""

from __future__ import annotations

from geo.errors import WbfMissionError

__all__ = ["CheckError", "FailedError", "SkippedError"]


class CheckError(WbfMissionError, ValueError):
    """A check that does not exist."""


class FailedError(WbfMissionError):
    """What a check raises when its point does not hold; the text says what was seen."""


class SkippedError(WbfMissionError):
    """What a check raises when its point cannot be tried on this vehicle; the text says why."""
