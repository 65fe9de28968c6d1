"""Errors of vehicles."""

from geo.errors import WbfMissionError


class VehicleError(WbfMissionError, RuntimeError):
    """A vehicle that is unknown, has an invalid specification, or cannot carry out a request."""
