"""Details of parameters for the parameter editors of ground stations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from sim_vehicle.autopilot.parameters import reference_parameters, table_rows

__all__ = ["ParameterDetails", "parameter_details"]


@dataclass(frozen=True, slots=True)
class ParameterDetails:
    """Metadata of a parameter for parameter editors."""

    group: str
    """Heading of the parameter in ground stations."""
    # Documented range in the parameter's unit; infinite if none is documented.
    low: float = -math.inf
    high: float = math.inf
    decimals: int | None = None
    """Number of decimal places to show."""
    increment: float | None = None
    """Increment in editors, in the parameter's unit."""
    reboot: bool = False
    """Whether a change needs a reboot."""
    values: tuple[tuple[int, str], ...] = ()
    """Allowed values with labels; empty if any value is allowed."""
    bits: tuple[tuple[int, str], ...] = ()
    """Bits of a bit mask from 0, with labels; empty for no bit mask."""


@cache
def parameter_details(name: str, package: str) -> Mapping[str, ParameterDetails]:
    """Return the details of parameters by name, from the tables ``lists/NAME*.csv`` of a package.

    Examples
    --------
    >>> details = parameter_details("px4", "sim_vehicle.autopilot")["GF_ACTION"]
    >>> details.group, details.values[2], details.high
    ('Geofence', (2, 'Hold mode'), 5.0)
    """
    choices: dict[str, dict[str, list[tuple[int, str]]]] = {}
    for row in table_rows(f"{name}-choices", package):
        kinds = choices.setdefault(row["choices"], {"value": [], "bit": []})
        kinds[row["kind"]].append((int(row["number"]), row["label"]))
    reference = reference_parameters(name, package=package)
    ranges = {parameter.name: (parameter.low, parameter.high) for parameter in reference}
    details = {}
    for row in table_rows(f"{name}-details", package):
        kinds = choices.get(row["choices"], {"value": [], "bit": []})
        low, high = ranges.get(row["name"], (-math.inf, math.inf))
        details[row["name"]] = ParameterDetails(
            row["group"],
            low=low,
            high=high,
            decimals=int(row["decimals"]) if row["decimals"] else None,
            increment=float(row["increment"]) if row["increment"] else None,
            reboot=row["reboot"] == "yes",
            values=tuple(kinds["value"]),
            bits=tuple(kinds["bit"]),
        )
    return details
