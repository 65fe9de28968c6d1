"""Errors of vehicles."""

from geo.errors import WbfMissionError


class VehicleError(WbfMissionError, RuntimeError):
    """A vehicle that is unknown, wrongly specified, or cannot do what was asked."""
