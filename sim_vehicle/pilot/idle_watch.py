"""Watches an armed vehicle that does not fly, until its autopilot disarms it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sim_vehicle.execution.state import FlightPhase, LandedState

if TYPE_CHECKING:
    from sim_vehicle.autopilot.failsafe_rules import IdleDisarm
    from sim_vehicle.autopilot.parameters import RuntimeParameters
    from sim_vehicle.pilot.controls import Controls

__all__ = ["IdleWatch"]


class IdleWatch:
    """Counts the time that a vehicle stands on the ground with its motors on.

    Parameters
    ----------
    controls : Controls
        The vehicle.
    throttle_down : callable
        Whether no stick asks for thrust.
    """

    def __init__(
        self,
        controls: Controls,
        parameters: RuntimeParameters,
        rule: IdleDisarm,
        throttle_down: Callable[[], bool],
    ) -> None:
        self._controls = controls
        self._parameters = parameters
        self._rule = rule
        self._throttle_down = throttle_down
        self._since_s = 0.0
        self._has_flown = False

    @property
    def texts(self) -> tuple[str, ...]:
        """What is said when it is over."""
        return self._rule.texts

    def on_armed(self) -> None:
        """Begin to count."""
        self._since_s, self._has_flown = self._controls.now_s, False

    def is_over(self) -> bool:
        """Tell, while the vehicle is armed, whether it has stood for too long."""
        controls, rule = self._controls, self._rule
        stands = controls.landed is LandedState.ON_GROUND and controls.state.phase is FlightPhase.GROUND
        self._has_flown |= not stands
        if not stands or (not rule.first_flight and not self._throttle_down()):
            self._since_s = controls.now_s
            return False
        delay_s = rule.delay.of(self._parameters)
        waits = delay_s > 0.0 and not (rule.first_flight and self._has_flown)
        return waits and controls.now_s - self._since_s >= delay_s
