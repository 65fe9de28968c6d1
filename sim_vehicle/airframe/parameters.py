"""Parameters of autopilots: descriptions, and values for a vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec


# The SI unit in those of parameters; of others it is the unit itself.
_DEGREE = math.radians(1.0)
_SI = {"%": 0.01, "%/s": 0.01, "cm": 0.01, "cm/s": 0.01, "cm/s/s": 0.01, "ds": 0.1}
_SI |= {"deg": _DEGREE, "deg/s": _DEGREE, "deg/s^2": _DEGREE}


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """One parameter of an autopilot, under its real name."""

    # Default and allowed values, in the parameter's own unit.
    default: float
    low: float
    high: float
    unit: str
    """Such as ``m/s``, ``cm/s`` or ``deg``; empty for a number."""
    text: str
    """Description in a few words."""
    integer: bool = False
    """Whether it is INT32 on the wire."""
    law: str = ""
    """The number of the vehicle's law of motion that it is; empty where more decides that."""

    def in_si(self, value: float) -> float:
        """Return a value in SI units, angles in radians."""
        return _SI.get(self.unit, 1.0) * value


def parameter_value(spec: VehicleSpec, name: str, table: Mapping[str, ParameterSpec]) -> float:
    """Return the value of a parameter for a vehicle: its own, or the default.

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
    """Check the parameters of a vehicle.

    Raises
    ------
    VehicleError
        A parameter that the autopilot has not, or a value outside its range.
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
