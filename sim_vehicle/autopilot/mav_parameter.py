"""One MAVLink parameter of a firmware: name, type, range, and what of the vehicle it changes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from mission.link.codec.dialect import mavlink as m

__all__ = ["KeptParameters", "MavParameter", "Setting"]

_INTEGERS = {8: m.MAV_PARAM_TYPE_INT8, 16: m.MAV_PARAM_TYPE_INT16, 32: m.MAV_PARAM_TYPE_INT32}


@dataclass(frozen=True, slots=True)
class MavParameter:
    """One parameter."""

    name: str
    """At most 16 characters."""
    field: str | None = None
    """The runtime parameter of the vehicle that it is (a field of `RuntimeParameters`); None for a
    constant."""
    integer: bool = False
    """An integer rather than REAL32."""
    scale: float = 1.0
    """The parameter's value per SI value (100 for centimetres)."""
    # Allowed values, in the parameter's unit; of a stored one those that the autopilot documents.
    low: float = -math.inf
    high: float = math.inf
    value: float = 0.0
    """Value of a constant; default of a motion parameter."""
    motion: bool = False
    """Whether it is one of the flight procedures' own parameters, which change how the vehicle moves."""
    stored: bool = False
    """Whether it is only kept: it can be set and read, and changes nothing here."""
    bits: int = 32
    """Width of an integer: 8, 16 or 32."""
    unit: str = ""
    """Unit as the autopilot's documentation writes it."""

    @property
    def mav_type(self) -> int:
        """MAV_PARAM_TYPE."""
        return int(_INTEGERS[self.bits] if self.integer else m.MAV_PARAM_TYPE_REAL32)


class KeptParameters(Protocol):
    """The parameters of a vehicle, as `RuntimeParameters` keeps them."""

    def kept(self, name: str, default: float) -> float:
        """Value of a parameter in its own unit."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter of the autopilot."""

    name: str
    default: float
    """In its own unit."""
    scale: float = 1.0
    """SI value per unit."""

    def of(self, parameters: KeptParameters) -> float:
        """Its value now, in SI units."""
        return self.scale * parameters.kept(self.name, self.default)
