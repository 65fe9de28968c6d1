"""Parameters of a firmware: on MAVLink, their effect on a vehicle, and all that the real one has.

Lists are tables in ``lists/``: name, type, default, documented range, unit. Each begins with a note of where
its facts are from. What moves a vehicle has a table of its own, with a few words on each and the number of
the law of motion that it is. Details of parameters are in tables that are read when a peer asks for them.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.parameters import ParameterSpec

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = [
    "FailsafeDefaults",
    "MavParameter",
    "ParameterDetails",
    "RuntimeParameters",
    "Setting",
    "motion_parameters",
    "parameter_details",
    "reference_parameters",
]

_INTEGERS = {8: m.MAV_PARAM_TYPE_INT8, 16: m.MAV_PARAM_TYPE_INT16, 32: m.MAV_PARAM_TYPE_INT32}
_VOLTAGE_CELLS = 3
# Fields of a vehicle's specification that parameters change.
_OF_VEHICLE = (
    "cruise_speed_m_s",
    "acceptance_radius_m",
    "takeoff_altitude_m",
    "return_altitude_m",
    "landing_speed_m_s",
    "disarm_delay_s",
)


@dataclass(frozen=True, slots=True)
class MavParameter:
    """One parameter."""

    name: str
    """At most 16 characters."""
    field: str | None = None
    """The runtime parameter of the vehicle that it is (a field of `RuntimeParameters`); None for a
    constant."""
    integer: bool = False
    """An integer rather than REAL32."""
    scale: float = 1.0
    """The parameter's value per SI value (100 for centimetres)."""
    # Allowed values, in the parameter's unit; of a stored one those that the autopilot documents.
    low: float = -math.inf
    high: float = math.inf
    value: float = 0.0
    """Value of a constant; default of a motion parameter."""
    motion: bool = False
    """Whether it is one of the flight procedures' own parameters, which change how the vehicle moves."""
    stored: bool = False
    """Whether it is only kept: it can be set and read, and changes nothing here."""
    bits: int = 32
    """Width of an integer: 8, 16 or 32."""
    unit: str = ""
    """Unit as the autopilot's documentation writes it."""

    @property
    def mav_type(self) -> int:
        """MAV_PARAM_TYPE."""
        return int(_INTEGERS[self.bits] if self.integer else m.MAV_PARAM_TYPE_REAL32)


@dataclass(frozen=True, slots=True)
class FailsafeDefaults:
    """Values with which the safety parameters of a vehicle start."""

    # The firmware's own values.
    low_battery_action: int = 1
    critical_battery_action: int = 1
    fence_enable: int = 1
    fence_action: int = 2
    # Height above and distance from home; 0 is no limit.
    fence_ceiling_m: float = 0.0
    fence_radius_m: float = 0.0
    link_timeout_s: float = 10.0
    """Silence of the ground station after which it is lost."""
    failsafe_options: int = 0
    """Bits of FS_OPTIONS."""
    setpoint_timeout_s: float = 1.0
    """Greatest age of a setpoint that is flown."""
    low_voltage_v: float = 0.0
    """Voltage of the whole pack that is low, for batteries of three cells and more; 0 is none. ArduCopter's
    default refuses to arm with fewer cells."""
    mission_requirement: int = 0
    """Take-off and landing that a mission must have, in the firmware's own values; 0 is none."""


@dataclass(slots=True)
class RuntimeParameters:
    """The values of one vehicle that parameters change while it runs, under any autopilot; SI units."""

    # As in `sim_vehicle.airframe.spec.VehicleSpec`.
    cruise_speed_m_s: float
    acceptance_radius_m: float
    takeoff_altitude_m: float
    return_altitude_m: float
    landing_speed_m_s: float
    disarm_delay_s: float
    # Battery levels of the two failsafes.
    low_fraction: float
    critical_fraction: float
    # As in `FailsafeDefaults`.
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
    """Level of the last battery failsafe."""
    critical_voltage_v: float = 0.0
    low_voltage_timer_s: float = 10.0
    """Time for which a voltage has to be too low to count (ArduPilot)."""
    low_voltage_source: int = 0
    """0 for the voltage as it is, 1 for it without the sag of the load."""
    fence_type: int = 7
    """As FENCE_TYPE: 1 ceiling, 2 radius, 4 areas."""
    link_action: int = 0
    """The autopilot's own value; 0 is none."""
    settings: dict[str, float] = field(default_factory=dict)
    """The autopilot's parameters that move the vehicle and are not at their defaults, in their own units."""
    stored: dict[str, float] = field(default_factory=dict)
    """All others that are not at their defaults, in their own units; see `kept`."""

    def kept(self, name: str, default: float) -> float:
        """Value of a parameter of the autopilot's that is none of the above, in its own unit."""
        return self.stored.get(name, self.settings.get(name, default))

    @classmethod
    def of(cls, spec: VehicleSpec, defaults: FailsafeDefaults) -> RuntimeParameters:
        """Take the values of a vehicle as built, and of its firmware's safety functions."""
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
        """Return the vehicle with these values applied."""
        return replace(spec, **{name: getattr(self, name) for name in _OF_VEHICLE})


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter of the autopilot."""

    name: str
    default: float
    """In its own unit."""
    scale: float = 1.0
    """SI value per unit."""

    def of(self, parameters: RuntimeParameters) -> float:
        """Its value now, in SI units."""
        return self.scale * parameters.kept(self.name, self.default)


@dataclass(frozen=True, slots=True)
class ParameterDetails:
    """Description of a parameter for those who edit it."""

    group: str
    """Heading under which ground stations show it."""
    # The range that the autopilot documents, in the parameter's unit; infinite where it documents none.
    low: float = -math.inf
    high: float = math.inf
    decimals: int | None = None
    """Decimal places to show."""
    increment: float | None = None
    """Step of an editor, in the parameter's unit."""
    reboot: bool = False
    """Whether a change needs a reboot."""
    values: tuple[tuple[int, str], ...] = ()
    """The values that there are, with short names; empty for any."""
    bits: tuple[tuple[int, str], ...] = ()
    """The bits that there are, counted from 0, with short names; empty for no bit mask."""


@cache
def reference_parameters(
    name: str, without: tuple[str, ...] = (), package: str = __package__
) -> tuple[MavParameter, ...]:
    """Read the list of a firmware.

    Its table is ``lists/NAME.csv`` of a package, such as ``px4``. Names that begin as one of
    ``without`` are left out.

    Examples
    --------
    >>> [p.name for p in reference_parameters("px4") if p.name.startswith("GF_MAX")]
    ['GF_MAX_HOR_DIST', 'GF_MAX_VER_DIST']
    """
    return tuple(_parameter(row) for row in _rows(name, package) if not row["name"].startswith(without))


def motion_parameters(name: str, package: str = __package__) -> Mapping[str, ParameterSpec]:
    """Read the parameters with which a firmware moves a vehicle, by their names.

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
        for row in _rows(name, package)
    }


@cache
def parameter_details(name: str) -> Mapping[str, ParameterDetails]:
    """Read the descriptions of an autopilot's parameters, by their names.

    Examples
    --------
    >>> details = parameter_details("px4")["GF_ACTION"]
    >>> details.group, details.values[2], details.high
    ('Geofence', (2, 'Hold mode'), 5.0)
    """
    choices: dict[str, dict[str, list[tuple[int, str]]]] = {}
    for row in _rows(f"{name}-choices"):
        kinds = choices.setdefault(row["choices"], {"value": [], "bit": []})
        kinds[row["kind"]].append((int(row["number"]), row["label"]))
    ranges = {parameter.name: (parameter.low, parameter.high) for parameter in reference_parameters(name)}
    details = {}
    for row in _rows(f"{name}-details"):
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


def _rows(table: str, package: str = __package__) -> Iterator[dict[str, str]]:
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
