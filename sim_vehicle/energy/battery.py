"""The battery that a flight drains, as a battery monitor sees it.

The equivalent circuit of one time constant (Thevenin): an open-circuit voltage by the energy that is left,
the pack's resistance, and a resistance with a capacitor beside it, whose voltage builds up under load and
recovers in rest. It is what Bauersfeld and Scaramuzza, "Range, endurance, and optimal speed estimates for
multicopters", IEEE Robot. Autom. Lett. 7(2), 2022, use for drones' batteries. Values and their sources are in
docs/energy.md.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sim_vehicle.airframe.power_spec import BatterySpec

__all__ = ["WH_J", "BatteryMeter", "BatteryState", "remaining_fraction"]

WH_J = 3600.0
# The usual discharge curve of a lithium-polymer cell: height between its empty and its full open-circuit
# voltage, over the remaining fraction of the energy.
_FRACTION = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_HEIGHT = (0.0, 0.301, 0.452, 0.495, 0.538, 0.559, 0.613, 0.645, 0.731, 0.806, 0.903, 1.0)
# Time constant of the mean power from which the remaining time follows, seconds.
_AVERAGE_S = 30.0


class BatteryState(NamedTuple):
    """Readings of a battery monitor."""

    # At the terminals, now.
    voltage_v: float
    current_a: float
    rest_voltage_v: float
    """Voltage without the current's sag over the resistance."""
    # Drawn since the battery was full.
    used_wh: float
    used_mah: float
    fraction: float
    """Remaining energy over the capacity, 0 to 1."""
    remaining_s: float
    """Until empty at the mean power of late; infinite without any."""
    cells: int
    """In series."""

    @property
    def depleted(self) -> bool:
        """Whether nothing is left."""
        return self.fraction <= 0.0


def remaining_fraction(battery: BatterySpec, used_j: float) -> float:
    """Return the remaining fraction of a battery that gave ``used_j`` joules, 0 to 1.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> battery = get_vehicle("quad").battery
    >>> round(remaining_fraction(battery, 0.25 * battery.capacity_wh * WH_J), 6)
    0.75
    """
    return min(1.0, max(0.0, 1.0 - used_j / WH_J / battery.capacity_wh))


class BatteryMeter:
    """Follows the voltage of one battery; time only goes forward.

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
        # Charge that is left at the nodes, in Ah: between them the voltage is linear in the energy.
        charge = [0.0]
        for (low, high), (low_v, high_v) in zip(pairwise(_FRACTION), pairwise(self._open_v), strict=True):
            charge.append(charge[-1] + battery.capacity_wh * _charge(high - low, low_v, high_v))
        self._charge_ah = tuple(charge)
        self._time_s = 0.0
        self._power_w = 0.0
        self._average_w: float | None = None
        self._slow_v = 0.0

    def read(self, time_s: float, used_j: float, power_w: float) -> BatteryState:
        """Return the state of the battery, and remember it for the recovery of its voltage.

        Energy and power are those that its cells gave since they were full, and give now, losses in the
        battery included. Reading again at the same time gives the same.
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
            # The load between two readings is taken as their mean.
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
    """Return the charge of a share of the energy between two voltages, Ah per Wh of capacity."""
    rise = high_v - low_v
    if rise < 1e-6 * low_v:
        return share / low_v
    return share * math.log(high_v / low_v) / rise
