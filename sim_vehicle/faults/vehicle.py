"""Faults of the vehicle: one table, from the fault to the switch that it sets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim_vehicle.component import Component

__all__ = ["break_vehicle"]


def break_vehicle(component: Component, kind: str, broken: bool, value: float = 0.0) -> None:
    """Break or mend something of a vehicle; a component that has no such part is left alone.

    Parameters
    ----------
    component : Component
        A `sim_vehicle.mavlink.SimVehicle`.
    kind : str
        A fault of the group vehicle in `sim_vehicle.faults.fault.KINDS`.
    broken : bool
        False mends it.
    value : float
        The fault's value; 0 for none.
    """
    switch = _SWITCHES.get(kind)
    if getattr(component, "pilot", None) is not None and switch is not None:
        switch(component, broken, value)


def _gps(vehicle: Any, broken: bool, _value: float) -> None:
    vehicle.pilot.controls.position_ok = not broken


def _motor(vehicle: Any, broken: bool, _value: float) -> None:
    vehicle.pilot.fail_motor(broken)


def _battery(vehicle: Any, broken: bool, value: float) -> None:
    # Nobody changes a battery in flight: the end of the fault does not charge it.
    if broken:
        vehicle.pilot.drain_battery(value)


def _reboot(vehicle: Any, broken: bool, _value: float) -> None:
    if broken:
        vehicle.reboot()


_SWITCHES: dict[str, Callable[[Any, bool, float], None]] = {
    "low-battery": _battery,
    "reboot": _reboot,
    "gps-loss": _gps,
    "motor-failure": _motor,
    "dead-battery": _battery,
}
