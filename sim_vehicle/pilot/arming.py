"""May the vehicle arm? Every check names its reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode

if TYPE_CHECKING:
    from sim_vehicle.autopilot.parameters import RuntimeParameters
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.failsafe import Failsafe

__all__ = ["FORCE", "ArmingChecks"]

FORCE = 21196
"""Parameter 2 of MAV_CMD_COMPONENT_ARM_DISARM that skips the checks."""


class ArmingChecks:
    """The checks before the motors may run.

    Parameters
    ----------
    controls : Controls
        The vehicle.
    parameters : RuntimeParameters
        Levels of the battery.
    failsafe : Failsafe
        Fence and ground link.
    mission_refusal : callable
        Why the autopilot does not arm with the mission that is loaded, whatever the mode; None when it does.

    Attributes
    ----------
    block : str or None
        A reason from outside not to arm; assign it.
    """

    def __init__(
        self,
        controls: Controls,
        parameters: RuntimeParameters,
        failsafe: Failsafe,
        mission_refusal: Callable[[], str | None],
    ) -> None:
        self.block: str | None = None
        self._controls = controls
        self._parameters = parameters
        self._failsafe = failsafe
        self._mission_refusal = mission_refusal

    def health_problem(self) -> str | None:
        """Why the vehicle is not fit to fly, whatever it is told to do; None when it is."""
        if not self._controls.position_ok:
            return "no position"
        if not self._controls.motor_ok:
            return "motor failure"
        reason = self.block or self._battery_problem() or self._failsafe.why_not_arm()
        return reason or self._mission_refusal()

    def why_not(self, mode: Mode, mission_problem: str | None) -> str | None:
        """Why the vehicle cannot arm in a mode; None when it can.

        ``mission_problem`` tells why its mission cannot be flown.
        """
        problem = self.health_problem()
        if problem is not None:
            return problem
        if mode in (Mode.RTL, Mode.LAND, Mode.CIRCLE, Mode.FLIP):
            return f"mode {mode.value}: choose another first"
        return mission_problem if mode is Mode.MISSION else None

    def _battery_problem(self) -> str | None:
        battery, parameters = self._controls.state.battery, self._parameters
        if battery is None:
            return None
        if battery.fraction < max(parameters.low_fraction, 1e-9):
            return f"battery low ({100.0 * battery.fraction:.0f} %)"
        if self._failsafe.rules.watches_voltage:
            least = max(parameters.low_voltage_v, parameters.critical_voltage_v)
            if battery.voltage_v < least:
                return f"battery voltage low ({battery.voltage_v:.2f} V, least {least:.2f} V)"
        return None
