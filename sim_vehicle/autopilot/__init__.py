"""Autopilots: each autopilot is a package with an `Autopilot` object; `get_autopilot` returns it by name."""

from sim_vehicle.airframe.kind import DEFAULT_AUTOPILOT, autopilot_names
from sim_vehicle.autopilot.autopilot import (
    adapt_vehicle,
    autopilot_of_number,
    estimate_errs,
    firmware_of,
    fixed_wing_procedures,
    flight_procedures,
    forget_autopilots,
    get_autopilot,
    name_of_number,
    with_autopilot,
    with_return_margin,
)

__all__ = [
    "DEFAULT_AUTOPILOT",
    "adapt_vehicle",
    "autopilot_names",
    "autopilot_of_number",
    "estimate_errs",
    "firmware_of",
    "fixed_wing_procedures",
    "flight_procedures",
    "forget_autopilots",
    "get_autopilot",
    "name_of_number",
    "with_autopilot",
    "with_return_margin",
]
