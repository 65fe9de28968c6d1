"""Faults of the vehicle: one table, from the fault to the switch that it sets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim_vehicle.component import Component

__all__ = ["break_vehicle"]


def break_vehicle(component: Component, kind: str, broken: bool) -> None:
    """Break or mend something of a vehicle; a component that has no such part is left alone.

    Parameters
    ----------
    component : Component
        A `sim_vehicle.mavlink.SimVehicle`.
    kind : str
        A fault of the group vehicle in `sim_vehicle.faults.fault.KINDS`.
    broken : bool
        False mends it.
    """
    pilot = getattr(component, "pilot", None)
    switch = _SWITCHES.get(kind)
    if pilot is not None and switch is not None:
        switch(pilot, broken)


def _gps(pilot: Any, broken: bool) -> None:
    pilot.controls.position_ok = not broken


def _motor(pilot: Any, broken: bool) -> None:
    pilot.fail_motor(broken)


def _battery(pilot: Any, broken: bool) -> None:
    # Nobody changes a battery in flight: the end of the fault does not charge it.
    if broken:
        pilot.drain_battery(0.0)


_SWITCHES: dict[str, Callable[[Any, bool], None]] = {
    "gps-loss": _gps,
    "motor-failure": _motor,
    "dead-battery": _battery,
}
