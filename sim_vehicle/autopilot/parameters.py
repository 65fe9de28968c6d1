"""Parameters of a firmware: metadata on MAVLink, values at run time, and tables of the real firmware.

The tables are CSV files in ``lists/`` with name, type, default, documented range and unit of each parameter.
Comments at the top of a table name its sources. ``*-motion`` tables also have a description and, if there is
one, the constant of the law of motion. Parameter editors show the ``*-details`` and ``*-choices`` tables.
"""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

_INTEGERS = {8: m.MAV_PARAM_TYPE_INT8, 16: m.MAV_PARAM_TYPE_INT16, 32: m.MAV_PARAM_TYPE_INT32}
_VOLTAGE_CELLS = 3
# Fields of `VehicleSpec` that parameters change.
_OF_VEHICLE = (
    "cruise_speed_m_s",
    "acceptance_radius_m",
    "takeoff_altitude_m",
    "return_altitude_m",
    "landing_speed_m_s",
    "disarm_delay_s",
)
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
    """Name of the constant of the law of motion that has this value; empty if there is none."""

    def in_si(self, value: float) -> float:
        """Return a value of the parameter in SI units, angles in radians."""
        return _SI.get(self.unit, 1.0) * value


def parameter_value(spec: VehicleSpec, name: str, table: Mapping[str, ParameterSpec]) -> float:
    """Return the value of a parameter for a vehicle: the value that the vehicle sets, or the default.

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
            near = difflib.get_close_matches(name, table, 1, cutoff=0.7)
            meant = f" (is {near[0]} meant?)" if near else ""
            raise VehicleError(
                f"vehicle {spec.name}: {spec.autopilot} has no parameter {name} that moves the vehicle{meant}"
            )
        if not (math.isfinite(value) and known.low <= value <= known.high):
            raise VehicleError(
                f"vehicle {spec.name}: {name} {value:g} is out of range: "
                f"give {known.low:g} to {known.high:g} {known.unit}".rstrip()
            )


@dataclass(frozen=True, slots=True)
class MavParameter:
    """A parameter on MAVLink."""

    name: str
    """Name of at most 16 characters."""
    field: str | None = None
    """Field of `RuntimeParameters` that holds the value; None for a constant."""
    integer: bool = False
    """Whether the type is an integer; otherwise REAL32."""
    scale: float = 1.0
    """Parameter value divided by SI value (100 for centimetres)."""
    # Allowed range in the parameter's unit; for a stored parameter the documented range.
    low: float = -math.inf
    high: float = math.inf
    value: float = 0.0
    """Value of a constant, or default of a motion parameter."""
    motion: bool = False
    """Whether the parameter belongs to the flight procedures and changes the motion."""
    stored: bool = False
    """Whether the parameter is only stored and has no effect in the simulation."""
    bits: int = 32
    """Width of an integer in bits: 8, 16 or 32."""
    unit: str = ""
    """Unit in the spelling of the autopilot's documentation."""

    @property
    def mav_type(self) -> int:
        """MAV_PARAM_TYPE of the parameter."""
        return int(_INTEGERS[self.bits] if self.integer else m.MAV_PARAM_TYPE_REAL32)


@dataclass(frozen=True, slots=True)
class FailsafeDefaults:
    """Initial values of the safety parameters of a vehicle."""

    # Values in the firmware's own encoding.
    low_battery_action: int = 1
    critical_battery_action: int = 1
    fence_enable: int = 1
    fence_action: int = 2
    # Limits of the height above home and of the distance from home; 0 for no limit.
    fence_ceiling_m: float = 0.0
    fence_radius_m: float = 0.0
    link_timeout_s: float = 10.0
    """Time without a heartbeat of the ground station after which the link counts as lost."""
    failsafe_options: int = 0
    """Bits of FS_OPTIONS."""
    setpoint_timeout_s: float = 1.0
    """Time without a setpoint after which setpoints count as lost."""
    low_voltage_v: float = 0.0
    """Voltage of the whole pack below which the battery is low; 0 for no limit. The limit is for batteries of
    three or more cells, because ArduCopter's default would prevent arming with fewer cells."""
    mission_requirement: int = 0
    """Required take-off and landing items of a mission, in the firmware's own encoding; 0 for none."""


@dataclass(slots=True)
class RuntimeParameters:
    """Values of one vehicle that parameters can change at run time, in SI units with every autopilot."""

    # Fields of `sim_vehicle.airframe.spec.VehicleSpec`.
    cruise_speed_m_s: float
    acceptance_radius_m: float
    takeoff_altitude_m: float
    return_altitude_m: float
    landing_speed_m_s: float
    disarm_delay_s: float
    # Fractions of the charge below which the low and the critical battery failsafe trigger.
    low_fraction: float
    critical_fraction: float
    # Fields of `FailsafeDefaults`.
    low_battery_action: int
    critical_battery_action: int
    fence_enable: int
    fence_action: int
    fence_ceiling_m: float
    fence_radius_m: float
    link_timeout_s: float
    failsafe_options: int
    setpoint_timeout_s: float
    low_voltage_v: float
    mission_requirement: int
    emergency_fraction: float = 0.05
    """Fraction of the charge below which the emergency battery failsafe triggers."""
    critical_voltage_v: float = 0.0
    low_voltage_timer_s: float = 10.0
    """Time for which the voltage must be low to trigger the failsafe (ArduPilot)."""
    low_voltage_source: int = 0
    """Voltage that is checked: 0 for the terminal voltage, 1 for the voltage corrected for the load."""
    fence_type: int = 7
    """Bits of FENCE_TYPE: 1 ceiling, 2 radius, 4 polygons and circles."""
    link_action: int = 0
    """Action after the loss of the ground station, in the firmware's own encoding; 0 for no action."""
    settings: dict[str, float] = field(default_factory=dict)
    """Motion parameters that differ from their defaults, in their own units."""
    stored: dict[str, float] = field(default_factory=dict)
    """Other parameters that differ from their defaults, in their own units; see `kept`."""

    def kept(self, name: str, default: float) -> float:
        """Return the value of a parameter in `settings` or `stored`, in its own unit."""
        return self.stored.get(name, self.settings.get(name, default))

    @classmethod
    def of(cls, spec: VehicleSpec, defaults: FailsafeDefaults) -> RuntimeParameters:
        """Return the initial values for a vehicle whose firmware has these failsafe defaults."""
        battery = spec.battery
        values = {name: getattr(spec, name) for name in _OF_VEHICLE}
        values |= {field.name: getattr(defaults, field.name) for field in fields(defaults)}
        if battery is None or battery.cells < _VOLTAGE_CELLS:
            values["low_voltage_v"] = 0.0
        return cls(
            **values,
            low_fraction=battery.reserve_fraction if battery else 0.0,
            critical_fraction=battery.critical_fraction if battery else 0.0,
            settings=dict(spec.parameters),
        )

    def applied_to(self, spec: VehicleSpec) -> VehicleSpec:
        """Return a vehicle specification with the present values."""
        return replace(spec, **{name: getattr(self, name) for name in _OF_VEHICLE})


@dataclass(frozen=True, slots=True)
class Setting:
    """An autopilot parameter with its default and its unit."""

    name: str
    default: float
    """Default in the parameter's own unit."""
    scale: float = 1.0
    """SI value of one unit."""

    def of(self, parameters: RuntimeParameters) -> float:
        """Return the present value in SI units."""
        return self.scale * parameters.kept(self.name, self.default)


@cache
def reference_parameters(
    name: str, without: tuple[str, ...] = (), package: str = __package__
) -> tuple[MavParameter, ...]:
    """Return the parameters of a firmware from the table ``lists/NAME.csv`` of a package.

    Parameters with a prefix in ``without`` are left out.

    Examples
    --------
    >>> [p.name for p in reference_parameters("px4") if p.name.startswith("GF_MAX")]
    ['GF_MAX_HOR_DIST', 'GF_MAX_VER_DIST']
    """
    return tuple(_parameter(row) for row in table_rows(name, package) if not row["name"].startswith(without))


def motion_parameters(name: str, package: str = __package__) -> Mapping[str, ParameterSpec]:
    """Return the motion parameters of a firmware by name, from the table ``lists/NAME.csv``.

    Examples
    --------
    >>> motion_parameters("arducopter-motion")["WPNAV_SPEED_UP"].default
    250.0
    """
    return {
        row["name"]: ParameterSpec(
            float(row["default"]),
            float(row["low"]),
            float(row["high"]),
            row["unit"],
            row["text"],
            integer=row["type"] != "float",
            law=row["law"],
        )
        for row in table_rows(name, package)
    }


def table_rows(table: str, package: str = __package__) -> Iterator[dict[str, str]]:
    """Return the rows of the table ``lists/TABLE.csv`` of a package, as texts by column."""
    text = files(package).joinpath("lists", f"{table}.csv").read_text(encoding="utf-8")
    return csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))


def _parameter(row: dict[str, str]) -> MavParameter:
    kind = row["type"]
    integer = kind != "float"
    return MavParameter(
        row["name"],
        integer=integer,
        low=float(row["low"]) if row["low"] else -math.inf,
        high=float(row["high"]) if row["high"] else math.inf,
        value=float(row["default"]),
        stored=True,
        bits=int(kind.removeprefix("int")) if integer else 32,
        unit=row["unit"],
    )
