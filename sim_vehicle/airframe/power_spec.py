"""Parameters of a vehicle's power model and battery (docs/energy.md)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

AIR_DENSITY_KG_M3 = 1.225
GRAVITY_M_S2 = 9.80665

# Indices of the constants of a power model in an array.
# Every model has the mass (kg), the constant power (W), 1 / efficiency and the loss in the battery (1/W).
# DRAG is the drag divided by V^2; for rotorcraft it is rho f / 2. Models of rotorcraft also have the
# constants 1 / (2 rho A), k, P0 / W^1.5 and 3 / Utip^2.
COEFFICIENTS = 9
MASS, DRAG, INDUCED_FLOW, INDUCED_FACTOR, PROFILE, TIP_SPEED, CONSTANT_POWER, PER_EFFICIENCY, BATTERY_LOSS = (
    range(COEFFICIENTS)
)
# Index of `FurtherPowerSpec.own_drag` for kinds other than rotorcraft.
OWN_DRAG = INDUCED_FLOW


@dataclass(frozen=True, slots=True)
class BatterySpec:
    """A lithium-polymer battery pack, as an equivalent circuit with one time constant."""

    capacity_wh: float
    """Energy of the full pack (Wh)."""
    cells: int
    """Number of cells in series."""
    cell_voltage_v: float = 3.8
    """Nominal voltage of a cell."""
    # Open-circuit voltage of a full and of an empty cell.
    full_cell_v: float = 4.2
    empty_cell_v: float = 3.0
    resistance_ohm: float = 0.02
    """Series resistance of the whole pack; its voltage drop has no delay."""
    polarization_ohm: float = 0.008
    """Polarization resistance of the whole pack; its voltage builds up and recovers slowly."""
    relaxation_s: float = 30.0
    """Time constant of the polarization voltage."""
    reserve_fraction: float = 0.2
    """Fraction of the charge below which the battery is low; a plan should land the vehicle earlier."""
    critical_fraction: float = 0.1
    """Remaining fraction of the charge below which the vehicle must land at its present position."""

    def __post_init__(self) -> None:
        positive(
            "battery", self, "capacity_wh", "cell_voltage_v", "full_cell_v", "empty_cell_v", "relaxation_s"
        )
        if isinstance(self.cells, bool) or not isinstance(self.cells, int) or not 1 <= self.cells <= 100:
            raise VehicleError(f"battery: cells {self.cells!r} must be a whole number, 1 to 100")
        for name in ("resistance_ohm", "polarization_ohm"):
            value = getattr(self, name)
            if not _is_number(value) or not 0.0 <= value < 10.0:
                raise VehicleError(f"battery: {name} {value!r} is not a resistance from 0 to below 10 ohm")
        if not self.empty_cell_v < self.cell_voltage_v < self.full_cell_v <= 5.0:
            raise VehicleError(
                f"battery: empty_cell_v {self.empty_cell_v}, cell_voltage_v {self.cell_voltage_v} and "
                f"full_cell_v {self.full_cell_v} must be in ascending order, at most 5"
            )
        levels = (self.critical_fraction, self.reserve_fraction)
        if not all(_is_number(level) for level in levels) or not 0.0 <= levels[0] <= levels[1] < 1.0:
            raise VehicleError(
                f"battery: critical_fraction {self.critical_fraction} and reserve_fraction "
                f"{self.reserve_fraction} must be in ascending order, within 0..1"
            )

    @property
    def nominal_voltage_v(self) -> float:
        """Nominal voltage of the pack."""
        return self.cells * self.cell_voltage_v

    @property
    def capacity_mah(self) -> float:
        """Charge of the full pack (mAh), from energy and nominal voltage."""
        return 1000.0 * self.capacity_wh / self.nominal_voltage_v


@dataclass(frozen=True, slots=True, kw_only=True)
class _PowerSpec:
    """Parameters common to all power models."""

    mass_kg: float
    """Mass of the vehicle, with battery and payload."""
    efficiency: float
    """Efficiency of the propulsion: propulsive power (of rotorcraft: shaft power) over electric power."""
    # Constant power of autopilot and radio, and constant power of the camera.
    avionics_w: float = 8.0
    camera_w: float = 4.0
    idle_w: float = 2.0
    """Additional power while armed on the ground."""

    def __post_init__(self) -> None:
        free = ("camera_w", "idle_w")
        positive("power", self, *(f.name for f in fields(self) if f.name not in free))
        for name in free:
            value = getattr(self, name)
            if not _is_number(value) or not 0.0 <= value < 1e6:
                raise VehicleError(f"power: {name} {value!r} is negative or not a number")
        if self.efficiency > 1.0:
            raise VehicleError(f"power: efficiency {self.efficiency} is above 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerSpec(_PowerSpec):
    """Parameters of the rotorcraft power model (see `sim_vehicle.energy.power.multirotor_power`)."""

    disc_area_m2: float
    """Total disc area of all rotors."""
    tip_speed_m_s: float
    """Blade tip speed in hover."""
    solidity: float = 0.1
    """Blade area over disc area."""
    blade_drag: float = 0.05
    """Profile drag coefficient of the blades."""
    induced_factor: float = 1.15
    """Ratio of real to ideal induced power."""
    drag_area_m2: float = 0.03
    """Equivalent flat plate area of the fuselage."""
    efficiency: float = 0.7
    idle_w: float = 25.0


class FurtherPowerSpec(_PowerSpec, ABC):
    """Power model of a kind other than rotorcraft: parameters and formula."""

    __slots__ = ()

    @property
    @abstractmethod
    def drag_area_m2(self) -> float:
        """Equivalent flat plate area of the drag that is proportional to the square of the airspeed."""

    @property
    @abstractmethod
    def own_drag(self) -> float:
        """Constant of a fixed wing's induced drag (drag times V^2) or of a ground vehicle's rolling drag."""

    @abstractmethod
    def steady_w(
        self, numbers: NDArray[np.float64], airspeed: float, climb: float, load: float, acceleration: float
    ) -> float:
        """Return the electric power of steady motion (W), see `sim_vehicle.energy.power.flight_power_w`."""


AnyPowerSpec = PowerSpec | FurtherPowerSpec


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def positive(what: str, spec: object, *names: str) -> None:
    """Raise VehicleError if an attribute is not a positive number; the error names the attribute."""
    for name in names:
        value = getattr(spec, name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e9:
            raise VehicleError(f"{what}: {name} {value!r} is not a positive number below 1e9")


def within(what: str, spec: object, *ranges: tuple[str, float, float]) -> None:
    """Raise VehicleError if an attribute is neither None nor in its range; the error names the attribute."""
    for name, low, high in ranges:
        value = getattr(spec, name)
        if value is not None and (not _is_number(value) or not low <= value <= high):
            raise VehicleError(f"{what}: {name} {value!r} is outside {low:g}..{high:g}")
