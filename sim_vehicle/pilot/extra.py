"""Hooks by which add-ons take part in the decisions of a pilot."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_vehicle.autopilot.modes import Mode
    from sim_vehicle.autopilot.stick_rules import Sticks
    from sim_vehicle.pilot.failsafe import Reaction

__all__ = ["PilotExtra"]


class PilotExtra:
    """Part of a pilot that an add-on provides; a subclass overrides what it needs."""

    @property
    def sticks(self) -> Sticks | None:
        """Positions of the sticks, or None while there are none."""
        return None

    @property
    def throttle_down(self) -> bool:
        """Whether no stick demands thrust."""
        return True

    def why_not_enter(self, mode: Mode) -> str | None:
        """Return the reason why a mode cannot be entered now, or None."""
        return None

    def why_not_arm(self, mode: Mode) -> str | None:
        """Return the reason against arming in a mode, or None."""
        return None

    def on_armed(self) -> None:
        """Reset on arming."""

    def check(self) -> Iterable[Reaction]:
        """Check the failsafes of an armed vehicle; each reaction is carried out before the next is taken."""
        return ()

    def start(self, mode: Mode) -> None:
        """Give the orders of a mode; RefusedError restores the mode before."""

    def begin(self, mode: Mode, before: Mode) -> None:
        """Begin the flight in a mode that the armed vehicle has just entered from the mode `before`."""

    def fly_on(self) -> None:
        """Continue the flight of an armed vehicle in its mode."""

    def stop(self) -> None:
        """Stop flying, because the vehicle flies something else."""

    def forget(self) -> None:
        """Forget the order that the vehicle flies, because the mode may change."""

    def free_heading(self) -> None:
        """Stop turning the nose, because another order decides the heading."""
