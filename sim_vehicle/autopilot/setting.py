"""A parameter of an autopilot that rules refer to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

__all__ = ["KeptParameters", "Setting"]


class KeptParameters(Protocol):
    """The parameters of a vehicle, as `RuntimeParameters` keeps them."""

    def kept(self, name: str, default: float) -> float:
        """Value of a parameter in its own unit."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter of the autopilot.

    Parameters
    ----------
    name : str
    default : float
        In its own unit.
    scale : float
        SI value per unit.
    """

    name: str
    default: float
    scale: float = 1.0

    def of(self, parameters: KeptParameters) -> float:
        """Its value now, in SI units."""
        return self.scale * parameters.kept(self.name, self.default)
