"""May the vehicle arm? Every check names its reason."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode

if TYPE_CHECKING:
    from sim_vehicle.pilot.pilot import Pilot

__all__ = ["FORCE", "health_problem", "why_not_arm"]

FORCE = 21196
"""Parameter 2 of MAV_CMD_COMPONENT_ARM_DISARM that skips the checks."""


def _position(pilot: Pilot) -> str | None:
    return None if pilot.position_ok else "no position"


def _motors(pilot: Pilot) -> str | None:
    return None if pilot.motor_ok else "motor failure"


def _safety(pilot: Pilot) -> str | None:
    return pilot.failsafe.why_not_arm()


def _blocked(pilot: Pilot) -> str | None:
    return pilot.arming_block


def _battery(pilot: Pilot) -> str | None:
    battery = pilot.state.battery
    if battery is None:
        return None
    if battery.fraction < max(pilot.parameters.low_fraction, 1e-9):
        return f"battery low ({100.0 * battery.fraction:.0f} %)"
    if pilot.failsafe.rules.watches_voltage:
        least = max(pilot.parameters.low_voltage_v, pilot.parameters.critical_voltage_v)
        if battery.voltage_v < least:
            return f"battery voltage low ({battery.voltage_v:.2f} V, least {least:.2f} V)"
    return None


def _mode(pilot: Pilot) -> str | None:
    if pilot.mode in (Mode.RTL, Mode.LAND):
        return f"mode {pilot.mode.value}: choose another first"
    return None


def _mission(pilot: Pilot) -> str | None:
    return pilot.why_no_mission() if pilot.mode is Mode.MISSION else None


_HEALTH: tuple[Callable[[Pilot], str | None], ...] = (_position, _motors, _blocked, _battery, _safety)
_CHECKS = (*_HEALTH, _mode, _mission)


def health_problem(pilot: Pilot) -> str | None:
    """Return why the vehicle is not fit to fly, whatever it is told to do; None when it is."""
    return next((reason for check in _HEALTH if (reason := check(pilot))), None)


def why_not_arm(pilot: Pilot) -> str | None:
    """Return why the vehicle cannot arm in its present mode; None when it can."""
    return next((reason for check in _CHECKS if (reason := check(pilot))), None)
