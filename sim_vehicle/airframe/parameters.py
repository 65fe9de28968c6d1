"""Parameters of autopilots: metadata, and values for a vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec


# Factors from parameter units to SI units; units not in the table are SI units.
_DEGREE = math.radians(1.0)
_SI = {"%": 0.01, "%/s": 0.01, "cm": 0.01, "cm/s": 0.01, "cm/s/s": 0.01, "ds": 0.1}
_SI |= {"deg": _DEGREE, "deg/s": _DEGREE, "deg/s^2": _DEGREE}


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """Metadata of an autopilot's parameter."""

    # Default value and allowed range, in `unit`.
    default: float
    low: float
    high: float
    unit: str
    """Unit such as ``m/s``, ``cm/s`` or ``deg``; empty for a number."""
    text: str
    """Short description."""
    integer: bool = False
    """Whether the parameter is INT32 on the wire."""
    law: str = ""
    """Name of the constant of the law of motion that equals the parameter; empty without an equal."""

    def in_si(self, value: float) -> float:
        """Return a value of the parameter in SI units, angles in radians."""
        return _SI.get(self.unit, 1.0) * value


def parameter_value(spec: VehicleSpec, name: str, table: Mapping[str, ParameterSpec]) -> float:
    """Return the value of a parameter for a vehicle: the vehicle's own value, or the default.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> table = {"MPC_ACC_HOR": ParameterSpec(3.0, 2.0, 15.0, "m/s^2", "acceleration")}
    >>> parameter_value(get_vehicle("quad"), "MPC_ACC_HOR", table)
    3.0
    >>> brisk = replace(get_vehicle("quad"), parameters=(("MPC_ACC_HOR", 5.0),))
    >>> parameter_value(brisk, "MPC_ACC_HOR", table)
    5.0
    """
    for key, value in spec.parameters:
        if key == name:
            return value
    return table[name].default


def check_parameters(spec: VehicleSpec, table: Mapping[str, ParameterSpec]) -> None:
    """Check the autopilot parameters of a vehicle.

    Raises
    ------
    VehicleError
        If the autopilot has no such parameter, or a value is out of range.
    """
    for name, value in spec.parameters:
        known = table.get(name)
        if known is None:
            msg = f"vehicle {spec.name}: {spec.autopilot} has no parameter {name} that moves the vehicle"
            raise VehicleError(msg)
        if not (math.isfinite(value) and known.low <= value <= known.high):
            msg = (
                f"vehicle {spec.name}: {name} {value:g} is out of range: "
                f"give {known.low:g} to {known.high:g} {known.unit}".rstrip()
            )
            raise VehicleError(msg)
