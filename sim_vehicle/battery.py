"""Electric power of a rotorcraft by flight state, and the battery that it drains.

The shaft power in forward flight at airspeed V is the blade-element and momentum-theory model of Leishman,
*Principles of Helicopter Aerodynamics* (2006, ch. 5), in the closed form of Zeng, Xu and Zhang, "Energy
minimization for wireless communication with rotary-wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq.
(12)::

    P(V) = P0 (1 + 3 V^2 / Utip^2)                                   profile
         + Pi sqrt(sqrt(1 + V^4 / (4 v0^4)) - V^2 / (2 v0^2))        induced
         + 1/2 rho f V^3                                             parasite
    P0 = delta/8 rho s A Utip^3,   Pi = k W v0,   v0 = sqrt(W / (2 rho A))

A climb at w > 0 adds ``W (w/2 + sqrt(w^2/4 + v0^2) - v0)`` (axial momentum theory); a descent saves nothing,
which is on the safe side. Electric power is the shaft power over the efficiency, plus the avionics.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.spec import BatterySpec, PowerSpec

WH_J = 3600.0
# Open-circuit voltage of a lithium-polymer cell over its remaining fraction: the usual discharge curve.
_FRACTION = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CELL_V = (3.27, 3.55, 3.69, 3.73, 3.77, 3.79, 3.84, 3.87, 3.95, 4.02, 4.11, 4.2)


def power_coefficients(power: PowerSpec | None) -> NDArray[np.float64]:
    """Return the model's constants for the motion kernel, float64[7].

    P0 (W), Pi (W), 1/Utip^2, v0 (m/s), rho f / 2, weight (N), all powers electric, and the constant power
    (W). Zeros for a vehicle without a power model.
    """
    if power is None:
        return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    weight = power.mass_kg * GRAVITY_M_S2
    induced = math.sqrt(weight / (2.0 * AIR_DENSITY_KG_M3 * power.disc_area_m2))
    profile = (
        power.blade_drag
        / 8.0
        * AIR_DENSITY_KG_M3
        * power.solidity
        * power.disc_area_m2
        * power.tip_speed_m_s**3
    )
    shaft = 1.0 / power.efficiency
    return np.array(
        [
            shaft * profile,
            shaft * power.induced_factor * weight * induced,
            power.tip_speed_m_s**-2,
            induced,
            shaft * 0.5 * AIR_DENSITY_KG_M3 * power.drag_area_m2,
            shaft * weight,
            power.avionics_w,
        ]
    )


def flight_power_w(power: PowerSpec, airspeed_m_s: float = 0.0, climb_m_s: float = 0.0) -> float:
    """Return the electric power in flight, watts, at a horizontal airspeed and a climb rate.

    Examples
    --------
    >>> from sim_vehicle.spec import QUAD
    >>> 150.0 < flight_power_w(QUAD.power) < 200.0
    True
    """
    p0, pi, tip, v0, drag, weight, constant = power_coefficients(power).tolist()
    v2 = airspeed_m_s * airspeed_m_s
    ratio = v2 / (2.0 * v0 * v0)
    total = constant + p0 * (1.0 + 3.0 * v2 * tip) + drag * v2 * abs(airspeed_m_s)
    total += pi * math.sqrt(math.sqrt(1.0 + ratio * ratio) - ratio)
    if climb_m_s > 0.0:
        total += weight * (0.5 * climb_m_s + math.sqrt(0.25 * climb_m_s * climb_m_s + v0 * v0) - v0)
    return float(total)


@dataclass(frozen=True, slots=True)
class BatteryState:
    """What a battery monitor would show.

    Parameters
    ----------
    voltage_v, current_a : float
        At the terminals, now.
    used_wh, used_mah : float
        Drawn since the start.
    fraction : float
        Remaining energy over the capacity, 0 to 1.
    cells : int
        Cells in series.
    low, critical : bool
        Below the reserve, below the critical level.
    """

    voltage_v: float
    current_a: float
    used_wh: float
    used_mah: float
    fraction: float
    cells: int
    low: bool
    critical: bool

    @property
    def depleted(self) -> bool:
        """Whether nothing is left."""
        return self.fraction <= 0.0


def battery_state(battery: BatterySpec, used_j: float, power_w: float) -> BatteryState:
    """Return the state of a battery that gave ``used_j`` joules and now gives ``power_w`` watts.

    The terminal voltage is the open-circuit voltage at that charge less the drop over the internal
    resistance.

    Examples
    --------
    >>> from sim_vehicle.spec import QUAD
    >>> round(battery_state(QUAD.battery, 0.0, 0.0).voltage_v, 1)
    16.8
    """
    used_wh = used_j / WH_J
    fraction = min(1.0, max(0.0, 1.0 - used_wh / battery.capacity_wh))
    upper = min(bisect_right(_FRACTION, fraction), len(_FRACTION) - 1)
    share = (fraction - _FRACTION[upper - 1]) / (_FRACTION[upper] - _FRACTION[upper - 1])
    open_v = battery.cells * (_CELL_V[upper - 1] + share * (_CELL_V[upper] - _CELL_V[upper - 1]))
    root = max(0.25 * open_v * open_v - battery.resistance_ohm * power_w, 0.0)
    voltage = 0.5 * open_v + math.sqrt(root)
    return BatteryState(
        voltage_v=voltage,
        current_a=power_w / voltage,
        used_wh=used_wh,
        used_mah=1000.0 * used_wh / battery.nominal_voltage_v,
        fraction=fraction,
        cells=battery.cells,
        low=fraction < battery.reserve_fraction,
        critical=fraction < battery.critical_fraction,
    )
