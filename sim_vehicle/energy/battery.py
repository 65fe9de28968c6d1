"""Battery model with the readings of a battery monitor.

The model is a Thevenin equivalent circuit with one time constant. The open-circuit voltage depends on the
remaining energy. The circuit has a series resistance and an RC element. The voltage of the RC element builds
up under load and recovers at rest. Bauersfeld and Scaramuzza, "Range, endurance, and optimal speed estimates
for multicopters", IEEE Robot. Autom. Lett. 7(2), 2022, use the same model for drone batteries. Values and
sources are in docs/energy.md.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sim_vehicle.airframe.power_spec import BatterySpec

WH_J = 3600.0
# Discharge curve of a lithium-polymer cell: fraction of energy left, open-circuit voltage scaled to 0..1.
_FRACTION = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_HEIGHT = (0.0, 0.301, 0.452, 0.495, 0.538, 0.559, 0.613, 0.645, 0.731, 0.806, 0.903, 1.0)
# Time constant (s) of the mean power from which the remaining time is computed.
_AVERAGE_S = 30.0


class BatteryState(NamedTuple):
    """Readings of a battery monitor."""

    # Present values at the terminals.
    voltage_v: float
    current_a: float
    rest_voltage_v: float
    """Voltage without the drop over the series resistance."""
    # Energy and charge drawn since the battery was full.
    used_wh: float
    used_mah: float
    fraction: float
    """Remaining energy divided by capacity, 0 to 1."""
    remaining_s: float
    """Time until the battery is empty at the recent mean power; infinite without power."""
    cells: int
    """Number of cells in series."""

    @property
    def depleted(self) -> bool:
        """Whether the battery is empty."""
        return self.fraction <= 0.0


def remaining_fraction(battery: BatterySpec, used_j: float) -> float:
    """Return the remaining fraction (0 to 1) of a battery's energy after ``used_j`` joules were drawn.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> battery = get_vehicle("quad").battery
    >>> round(remaining_fraction(battery, 0.25 * battery.capacity_wh * WH_J), 6)
    0.75
    """
    return min(1.0, max(0.0, 1.0 - used_j / WH_J / battery.capacity_wh))


class BatteryMeter:
    """State of one battery over time; it must be read at times that do not decrease.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> meter = BatteryMeter(get_vehicle("quad").battery)
    >>> round(meter.read(0.0, 0.0, 0.0).voltage_v, 1)
    17.4
    >>> hovering = meter.read(1.0, 178.0, 178.0)
    >>> 16.9 < hovering.voltage_v < 17.3, 10.0 < hovering.current_a < 10.5
    (True, True)
    """

    def __init__(self, battery: BatterySpec) -> None:
        self.battery = battery
        span = battery.full_cell_v - battery.empty_cell_v
        self._open_v = tuple(battery.cells * (battery.empty_cell_v + height * span) for height in _HEIGHT)
        # Remaining charge (Ah) at the nodes of the curve. Between nodes the voltage is linear in the energy.
        charge = [0.0]
        for (low, high), (low_v, high_v) in zip(pairwise(_FRACTION), pairwise(self._open_v), strict=True):
            charge.append(charge[-1] + battery.capacity_wh * _charge(high - low, low_v, high_v))
        self._charge_ah = tuple(charge)
        self._time_s = 0.0
        self._power_w = 0.0
        self._average_w: float | None = None
        self._slow_v = 0.0

    def read(self, time_s: float, used_j: float, power_w: float) -> BatteryState:
        """Advance to `time_s` and return the state of the battery.

        `used_j` is the energy drawn from the cells since they were full. `power_w` is the present power from
        the cells. Both include the battery's losses. A second reading at the same time gives the same state.
        """
        battery = self.battery
        fraction = remaining_fraction(battery, used_j)
        upper = min(bisect_right(_FRACTION, fraction), len(_FRACTION) - 1)
        low, high = _FRACTION[upper - 1], _FRACTION[upper]
        low_v, high_v = self._open_v[upper - 1], self._open_v[upper]
        open_v = low_v + (fraction - low) / (high - low) * (high_v - low_v)
        left_ah = self._charge_ah[upper - 1] + battery.capacity_wh * _charge(fraction - low, low_v, open_v)
        elapsed = time_s - self._time_s
        if elapsed > 0.0:
            # The load between two readings is assumed to be the mean of the loads at these readings.
            mean_w = 0.5 * (self._power_w + power_w)
            kept = math.exp(-elapsed / battery.relaxation_s)
            target_v = battery.polarization_ohm * mean_w / open_v
            self._slow_v = target_v + (self._slow_v - target_v) * kept
            kept = math.exp(-elapsed / _AVERAGE_S)
            before = power_w if self._average_w is None else self._average_w
            self._average_w = mean_w + (before - mean_w) * kept
            self._time_s = time_s
        self._power_w = power_w
        average_w = power_w if self._average_w is None else self._average_w
        left_wh = fraction * battery.capacity_wh
        current = power_w / open_v
        rest_v = open_v - self._slow_v
        return BatteryState(
            voltage_v=max(rest_v - battery.resistance_ohm * current, 0.0),
            current_a=current,
            rest_voltage_v=rest_v,
            used_wh=used_j / WH_J,
            used_mah=1000.0 * (self._charge_ah[-1] - left_ah),
            fraction=fraction,
            remaining_s=WH_J * left_wh / average_w if average_w > 0.0 else math.inf,
            cells=battery.cells,
        )


def _charge(share: float, low_v: float, high_v: float) -> float:
    """Return the charge (Ah per Wh of capacity) of an energy fraction `share`, drawn between two voltages."""
    rise = high_v - low_v
    if rise < 1e-6 * low_v:
        return share / low_v
    return share * math.log(high_v / low_v) / rise
