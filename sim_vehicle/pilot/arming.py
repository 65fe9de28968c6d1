"""May the vehicle arm? Every check names its reason. And when it disarms, as it does not fly."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState

if TYPE_CHECKING:
    from sim_vehicle.autopilot.behaviour import IdleDisarm
    from sim_vehicle.pilot.controls import Controls
    from sim_vehicle.pilot.failsafe import Failsafe

__all__ = ["FORCE", "ArmingChecks", "IdleWatch"]

FORCE = 21196
"""Parameter 2 of MAV_CMD_COMPONENT_ARM_DISARM that skips the checks."""


class ArmingChecks:
    """The checks before the motors may run.

    `block` is a reason from outside not to arm, to be assigned.
    """

    def __init__(self, controls: Controls, failsafe: Failsafe) -> None:
        self.block: str | None = None
        self._controls = controls
        self._failsafe = failsafe

    def health_problem(self) -> str | None:
        """Why the vehicle is not fit to fly, whatever it is told to do; None when it is."""
        controls = self._controls
        if not controls.position_ok:
            return "no position"
        if not controls.motor_ok:
            return "motor failure"
        reason = self.block or self._battery_problem() or self._failsafe.why_not_arm()
        return reason or controls.behaviour.refuses_to_arm(controls.executor.items, controls.parameters)

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
        battery, parameters = self._controls.state.battery, self._controls.parameters
        if battery is None:
            return None
        if battery.fraction < max(parameters.low_fraction, 1e-9):
            return f"battery low ({100.0 * battery.fraction:.0f} %)"
        if self._controls.rules.watches_voltage:
            least = max(parameters.low_voltage_v, parameters.critical_voltage_v)
            if battery.voltage_v < least:
                return f"battery voltage low ({battery.voltage_v:.2f} V, least {least:.2f} V)"
        return None


class IdleWatch:
    """Counts the time that a vehicle stands on the ground with its motors on, until it is disarmed.

    `throttle_down` tells whether no stick asks for thrust.
    """

    def __init__(self, controls: Controls, rule: IdleDisarm, throttle_down: Callable[[], bool]) -> None:
        self._controls = controls
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
        delay_s = rule.delay.of(controls.parameters)
        waits = delay_s > 0.0 and not (rule.first_flight and self._has_flown)
        return waits and controls.now_s - self._since_s >= delay_s
