"""What a vehicle can do: kinematic limits, battery, power model; and the vehicles of the package."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from geo.units import FOOT_M
from sim_vehicle.errors import VehicleError

AIR_DENSITY_KG_M3 = 1.225
GRAVITY_M_S2 = 9.80665
KINDS = ("multirotor", "fixed-wing", "rover", "ideal")
AUTOPILOTS = ("px4", "ardupilot", "generic")


@dataclass(frozen=True, slots=True)
class BatterySpec:
    """A battery pack.

    Parameters
    ----------
    capacity_wh : float
        Energy of the full pack, watt hours.
    cells : int
        Cells in series.
    cell_voltage_v : float
        Nominal voltage of a cell.
    resistance_ohm : float
        Internal resistance of the whole pack.
    reserve_fraction : float
        Below this fraction the battery is low; a plan should land before it.
    critical_fraction : float
        Below this fraction the vehicle must land where it is.
    """

    capacity_wh: float
    cells: int
    cell_voltage_v: float = 3.8
    resistance_ohm: float = 0.02
    reserve_fraction: float = 0.2
    critical_fraction: float = 0.1

    def __post_init__(self) -> None:
        _positive("battery", self, "capacity_wh", "cells", "cell_voltage_v")
        if self.resistance_ohm < 0.0 or not math.isfinite(self.resistance_ohm):
            msg = f"battery: resistance_ohm {self.resistance_ohm} is negative"
            raise VehicleError(msg)
        if not 0.0 <= self.critical_fraction <= self.reserve_fraction < 1.0:
            msg = (
                f"battery: critical_fraction {self.critical_fraction} and reserve_fraction "
                f"{self.reserve_fraction} must be ordered within 0..1"
            )
            raise VehicleError(msg)

    @property
    def nominal_voltage_v(self) -> float:
        """Nominal voltage of the pack."""
        return self.cells * self.cell_voltage_v


@dataclass(frozen=True, slots=True)
class PowerSpec:
    """Parameters of the rotorcraft power model (see `sim_vehicle.battery`).

    Parameters
    ----------
    mass_kg : float
        Take-off mass.
    disc_area_m2 : float
        Disc area of all rotors together.
    tip_speed_m_s : float
        Blade tip speed.
    solidity : float
        Blade area over disc area.
    blade_drag : float
        Profile drag coefficient of the blades.
    induced_factor : float
        Ratio of the real to the ideal induced power.
    drag_area_m2 : float
        Equivalent flat plate area of the fuselage.
    efficiency : float
        Shaft power over electric power (motors, speed controllers, wiring).
    avionics_w : float
        Constant power of autopilot, radio and camera.
    idle_w : float
        Additional power while armed on the ground.
    """

    mass_kg: float
    disc_area_m2: float
    tip_speed_m_s: float
    solidity: float = 0.05
    blade_drag: float = 0.012
    induced_factor: float = 1.15
    drag_area_m2: float = 0.035
    efficiency: float = 0.61
    avionics_w: float = 12.0
    idle_w: float = 25.0

    def __post_init__(self) -> None:
        _positive("power", self, *(f.name for f in fields(self)))
        if self.efficiency > 1.0:
            msg = f"power: efficiency {self.efficiency} is above 1"
            raise VehicleError(msg)


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """A vehicle: limits that its motion never exceeds, defaults, battery and power model.

    Parameters
    ----------
    name : str
        Name for reports.
    kind : {"multirotor", "fixed-wing", "rover", "ideal"}
        The motion model.
    autopilot : {"px4", "ardupilot", "generic"}
        Whose law of motion it follows; "generic" is that of none in particular.
    parameters : tuple of (str, float)
        Parameters of the autopilot that are not at their defaults, under their real names.
    cruise_speed_m_s : float
        Ground speed on a mission that does not set one.
    speed_limit_m_s : float
        Horizontal ground speed that is never exceeded; a mission may command up to 95 % of it.
    airspeed_limit_m_s : float
        Horizontal airspeed that the vehicle can hold; bounds the ground speed in a wind.
    climb_speed_m_s, descent_speed_m_s, landing_speed_m_s : float
        Vertical speeds: never exceeded; the last one near the ground while landing.
    acceleration_m_s2, jerk_m_s3 : float
        Bounds on the horizontal acceleration and jerk vectors; 80 % of each is used along the path, the
        rest is kept for corners (see docs/vehicle-model.md).
    vertical_acceleration_m_s2, vertical_jerk_m_s3 : float
        Bounds on the vertical acceleration and jerk.
    yaw_rate_rad_s, yaw_acceleration_rad_s2 : float
        Bounds on the turning of the heading.
    acceptance_radius_m : float
        Distance at which a waypoint that sets none is passed.
    takeoff_altitude_m, return_altitude_m, max_altitude_m : float
        Default take-off height, least height of the way home, and ceiling, all above home.
    max_distance_m : float
        Farthest allowed place from home.
    step_s : float
        Time step of the motion model.
    disarm_delay_s : float
        Time from touch-down to disarming.
    cell_m : float
        Length of one step of the ideal vehicle.
    battery : BatterySpec or None
        None is an endless battery.
    power : PowerSpec or None
        None uses no energy.

    Examples
    --------
    >>> get_vehicle("quad").cruise_speed_m_s
    8.0
    """

    name: str
    kind: Literal["multirotor", "fixed-wing", "rover", "ideal"] = "multirotor"
    autopilot: Literal["px4", "ardupilot", "generic"] = "generic"
    parameters: tuple[tuple[str, float], ...] = ()
    cruise_speed_m_s: float = 8.0
    speed_limit_m_s: float = 14.0
    airspeed_limit_m_s: float = 16.0
    climb_speed_m_s: float = 4.0
    descent_speed_m_s: float = 3.0
    landing_speed_m_s: float = 0.7
    acceleration_m_s2: float = 3.75
    jerk_m_s3: float = 5.0
    vertical_acceleration_m_s2: float = 2.5
    vertical_jerk_m_s3: float = 5.0
    yaw_rate_rad_s: float = math.radians(60.0)
    yaw_acceleration_rad_s2: float = math.radians(120.0)
    acceptance_radius_m: float = 1.0
    takeoff_altitude_m: float = 10.0
    return_altitude_m: float = 15.0
    max_altitude_m: float = 500.0
    max_distance_m: float = 20_000.0
    step_s: float = 0.02
    disarm_delay_s: float = 2.0
    cell_m: float = FOOT_M
    battery: BatterySpec | None = None
    power: PowerSpec | None = None

    def __post_init__(self) -> None:
        for name, known in (("kind", KINDS), ("autopilot", AUTOPILOTS)):
            value = getattr(self, name)
            if value not in known:
                msg = f"vehicle {self.name}: {name} {value!r} is not one of {', '.join(known)}"
                raise VehicleError(msg)
        other = ("name", "kind", "autopilot", "parameters", "battery", "power", "disarm_delay_s")
        _positive(f"vehicle {self.name}", self, *(f.name for f in fields(self) if f.name not in other))
        if not 0.0 <= self.disarm_delay_s < 3600.0:
            msg = f"vehicle {self.name}: disarm_delay_s {self.disarm_delay_s} is outside 0..3600"
            raise VehicleError(msg)
        if self.battery is not None and self.power is None:
            msg = f"vehicle {self.name}: a battery needs a power model ([power])"
            raise VehicleError(msg)

    @property
    def is_ideal(self) -> bool:
        """Whether it is the paper's robot, without dynamics."""
        return self.kind == "ideal"

    @property
    def top_speed_m_s(self) -> float:
        """The highest ground speed that a mission can command."""
        return self.cell_m / self.step_s if self.is_ideal else 0.95 * self.speed_limit_m_s


def _positive(what: str, spec: object, *names: str) -> None:
    for name in names:
        value = getattr(spec, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e9:
            msg = f"{what}: {name} {value!r} is not a positive number"
            raise VehicleError(msg)


QUAD = VehicleSpec(
    name="quad",
    battery=BatterySpec(capacity_wh=89.2, cells=4),
    power=PowerSpec(mass_kg=1.391, disc_area_m2=0.181, tip_speed_m_s=75.0, solidity=0.1),
)
IDEAL = VehicleSpec(
    name="ideal",
    kind="ideal",
    cruise_speed_m_s=FOOT_M,
    speed_limit_m_s=FOOT_M,
    acceptance_radius_m=FOOT_M / 2.0,
    step_s=1.0,
    disarm_delay_s=0.0,
)
_VEHICLES = {vehicle.name: vehicle for vehicle in (QUAD, IDEAL)}


def vehicle_names() -> tuple[str, ...]:
    """Return the names of the vehicles that come with the package."""
    return tuple(_VEHICLES)


def get_vehicle(name: str) -> VehicleSpec:
    """Return a vehicle by its name, or read it from a TOML file.

    Parameters
    ----------
    name : str
        One of `vehicle_names`, or a path that ends in ``.toml``.

    Raises
    ------
    VehicleError
        If there is no such vehicle, or the file is not one.
    """
    if name.lower().endswith(".toml"):
        return load_vehicle(Path(name))
    try:
        return _VEHICLES[name.lower()]
    except KeyError:
        msg = f"unknown vehicle {name!r}: choose {', '.join(_VEHICLES)} or a .toml file"
        raise VehicleError(msg) from None


def load_vehicle(path: Path) -> VehicleSpec:
    """Read a vehicle file: keys of `VehicleSpec`, tables ``[battery]`` and ``[power]``.

    A key ``base`` names the vehicle whose values hold where the file has none (default ``quad``).

    Raises
    ------
    VehicleError
        If the file cannot be read, is not TOML, has unknown keys or impossible values.
    """
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        msg = f"vehicle file {path}: {error}"
        raise VehicleError(msg) from None
    base = _VEHICLES.get(str(data.pop("base", "quad")).lower())
    if base is None:
        msg = f"vehicle file {path}: base must be one of {', '.join(_VEHICLES)}"
        raise VehicleError(msg)
    changes: dict[str, Any] = {"name": path.stem}
    for key, value in data.items():
        if key in ("battery", "power"):
            changes[key] = _part(path, key, value, getattr(base, key))
            continue
        default = getattr(base, key, None) if key in {f.name for f in fields(VehicleSpec)} else None
        if default is None:
            msg = f"vehicle file {path}: unknown key {key!r}"
            raise VehicleError(msg)
        if isinstance(default, str) != isinstance(value, str):
            msg = f"vehicle file {path}: {key} {value!r} has the wrong type"
            raise VehicleError(msg)
        changes[key] = value
    try:
        return replace(base, **changes)
    except VehicleError as error:
        msg = f"vehicle file {path}: {error}"
        raise VehicleError(msg) from None


def _part(
    path: Path, key: str, value: object, base: BatterySpec | PowerSpec | None
) -> BatterySpec | PowerSpec:
    kind: type[BatterySpec | PowerSpec] = BatterySpec if key == "battery" else PowerSpec
    if not isinstance(value, dict):
        msg = f"vehicle file {path}: {key} must be a table"
        raise VehicleError(msg)
    unknown = sorted(set(value) - {f.name for f in fields(kind)})
    if unknown:
        msg = f"vehicle file {path}: unknown key {unknown[0]!r} in [{key}]"
        raise VehicleError(msg)
    try:
        return replace(base, **value) if base is not None else kind(**value)
    except TypeError as error:
        msg = f"vehicle file {path}: [{key}]: {error}"
        raise VehicleError(msg) from None
    except VehicleError as error:
        msg = f"vehicle file {path}: {error}"
        raise VehicleError(msg) from None
