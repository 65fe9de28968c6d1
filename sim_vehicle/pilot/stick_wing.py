"""Flies a fixed wing by sticks, roughly: circles of the bank that is asked for, and straight flight.

The law is that of ArduPlane's fly-by-wire (FBWA) and of PX4's altitude control: a stick to the right asks
for a bank, one that is pulled for a pitch or a climb rate. It is flown at the cruise speed, whatever the
throttle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.execution.state import LandedState

if TYPE_CHECKING:
    from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters
    from sim_vehicle.autopilot.stick_rules import WingSticks
    from sim_vehicle.pilot.controls import Controls

__all__ = ["StickWing"]

_AHEAD_M, _AGAIN_M = 2000.0, 1000.0
_LEAST_BANK_RAD = math.radians(1.5)
_LOWEST_M, _WIDEST_M = 5.0, 1000.0
_STEP = 0.02


class StickWing:
    """Orders circles and straight lines from sticks.

    Parameters
    ----------
    controls : Controls
        The vehicle.
    parameters : RuntimeParameters
    """

    def __init__(self, controls: Controls, parameters: RuntimeParameters) -> None:
        self._controls = controls
        self._parameters = parameters
        self._flown: tuple[int, int] | None = None
        self._from_m = (0.0, 0.0)

    def forget(self) -> None:
        """Note that something else is flown now."""
        self._flown = None

    def fly(self, limits: WingSticks, bank: float, pitch: float) -> None:
        """Fly with shares of the greatest bank and pitch, -1 to 1; on the ground nothing happens.

        Raises
        ------
        RefusedError
            When it cannot be flown.
        """
        controls = self._controls
        state = controls.state
        if controls.landed is LandedState.ON_GROUND:
            return
        x, y, z = state.position_m
        asked = (round(bank / _STEP), round(pitch / _STEP))
        bank_rad = bank * limits.bank.of(self._parameters)
        turns = abs(bank_rad) > _LEAST_BANK_RAD
        if asked == self._flown and (turns or math.dist(self._from_m, (x, y)) < _AGAIN_M):
            return
        slope = pitch * self._steepest(limits, upward=pitch > 0.0)
        height = min(max(z + _AHEAD_M * slope, _LOWEST_M), controls.spec.max_altitude_m)
        east, north, _ = state.velocity_m_s
        course = math.atan2(east, north)
        executor = controls.executor
        if turns:
            speed = controls.spec.cruise_speed_m_s
            radius = min(speed**2 / (GRAVITY_M_S2 * math.tan(abs(bank_rad))), _WIDEST_M)
            side = math.copysign(radius, bank_rad)
            centre = (x + side * math.cos(course), y - side * math.sin(course))
            controls.order(lambda: executor.orbit(*centre, height, side, speed))
        else:
            target = (x + _AHEAD_M * math.sin(course), y + _AHEAD_M * math.cos(course))
            controls.order(lambda: executor.goto(*target, height))
        self._flown, self._from_m = asked, (x, y)

    def _steepest(self, limits: WingSticks, *, upward: bool) -> float:
        """Slope of the path with the stick at its end."""
        end = abs((limits.up if upward else limits.down).of(self._parameters))
        return end / self._controls.spec.cruise_speed_m_s if limits.by_rate else math.tan(end)
