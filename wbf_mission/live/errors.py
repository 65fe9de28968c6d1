"""What can go wrong between an operator and a vehicle."""

from __future__ import annotations

from geo.errors import WbfMissionError

__all__ = ["MotorsStandError", "VehicleRefusedError", "VehicleSilentError"]


class VehicleRefusedError(WbfMissionError, RuntimeError):
    """The vehicle did not do what it was told to."""


class MotorsStandError(WbfMissionError, ValueError):
    """An order would start motors that stand, which was not said."""


class VehicleSilentError(WbfMissionError, RuntimeError):
    """The vehicle was heard before, but does not answer."""
