"""Level of the battery: by its charge and, where the autopilot watches it, by its voltage."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters
    from sim_vehicle.energy.battery import BatteryState
    from sim_vehicle.pilot.controls import Controls

__all__ = ["BatteryWatch"]

_LEVEL_NAMES = ("", "low", "critical", "almost empty")
_ALMOST_EMPTY = 3


class BatteryWatch:
    """The levels of a battery: 0 fine, 1 low, 2 critical, 3 almost empty.

    Parameters
    ----------
    controls : Controls
        The vehicle.
    parameters : RuntimeParameters
        The levels.
    by_voltage : bool
        Whether a voltage that stays too low is a low battery, too; such a level is not taken back when the
        voltage recovers (ArduPilot).

    Attributes
    ----------
    told : int
        The highest level that was told since the vehicle was armed.
    """

    def __init__(self, controls: Controls, parameters: RuntimeParameters, *, by_voltage: bool) -> None:
        self.told = 0
        self._controls = controls
        self._parameters = parameters
        self._by_voltage = by_voltage
        self._sagging_since_s = [math.inf, math.inf]

    def reset(self) -> None:
        """Begin again with the arming."""
        self.told = 0
        self._sagging_since_s = [math.inf, math.inf]

    def give_up(self) -> None:
        """Note that the battery has nothing more to tell: it is empty, or the vehicle falls."""
        self.told = _ALMOST_EMPTY

    def check(self) -> int:
        """Check the battery; its level when that is higher than any before, else 0."""
        battery = self._controls.state.battery
        if battery is None:
            return 0
        if self._by_voltage:
            self._time_low_voltages(battery)
        level = self.level()
        if level <= self.told:
            return 0
        self.told = level
        return level

    def level(self) -> int:
        """The level now."""
        battery, parameters = self._controls.state.battery, self._parameters
        if battery is None:
            return 0
        if battery.fraction < parameters.critical_fraction:
            almost = battery.fraction < min(parameters.emergency_fraction, parameters.critical_fraction)
            level = _ALMOST_EMPTY if almost or battery.depleted else 2
        else:
            level = int(battery.fraction < parameters.low_fraction)
        return max(level, self._voltage_level(), self.told if self._by_voltage else 0)

    def describe(self, level: int) -> str:
        """A level in words, with the charge or the voltage that made it."""
        battery, parameters = self._controls.state.battery, self._parameters
        assert battery is not None
        limit = parameters.low_fraction if level == 1 else parameters.critical_fraction
        amount = (
            f"{100.0 * battery.fraction:.0f} %" if battery.fraction < limit else f"{battery.voltage_v:.2f} V"
        )
        return f"{_LEVEL_NAMES[level]} ({amount})"

    def _voltage_level(self) -> int:
        """The level of a voltage that was too low for the time of the parameter, 0 to 2."""
        now_s, patience_s = self._controls.now_s, self._parameters.low_voltage_timer_s
        if patience_s <= 0.0:
            return 0
        low, critical = (now_s - since_s > patience_s for since_s in self._sagging_since_s)
        return 2 if critical else int(low)

    def _time_low_voltages(self, battery: BatteryState) -> None:
        """Note since when the voltage is too low, as it is under load or without the sag."""
        parameters, now_s = self._parameters, self._controls.now_s
        voltage = battery.rest_voltage_v if parameters.low_voltage_source == 1 else battery.voltage_v
        for i, limit in enumerate((parameters.low_voltage_v, parameters.critical_voltage_v)):
            since_s = self._sagging_since_s[i]
            self._sagging_since_s[i] = min(since_s, now_s) if voltage < limit else math.inf
