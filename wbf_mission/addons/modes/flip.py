"""ArduCopter's FLIP: one roll of 360 degrees (``mode_flip.cpp``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.parameters import Setting

if TYPE_CHECKING:
    from sim_vehicle.autopilot.parameters import RuntimeParameters
    from wbf_mission.addons.modes.guided import AttitudePilot

__all__ = ["Flip"]

_ROLL_ACCELERATION = Setting("ATC_ACCEL_R_MAX", 110_000.0, math.radians(0.01))
# MOT_THST_HOVER of ArduPilot's simulator; FLIP adds and subtracts shares of full throttle.
_HOVER = 0.39
# FLIP_ROTATION_RATE, FLIP_THR_INC, FLIP_THR_DEC, FLIP_RECOVERY_ANGLE, FLIP_TIMEOUT_MS; ATC_ANG_RLL_P.
_RATE_RAD_S, _MORE, _LESS, _DONE_RAD, _LONGEST_S = (
    math.radians(400.0),
    1.0 + 0.2 / _HOVER,
    1.0 - 0.24 / _HOVER,
    math.radians(5.0),
    2.5,
)
_ROLL_P_1_S = 4.5


class Flip:
    """One flip of a vehicle; it begins at once.

    Parameters
    ----------
    attitude : AttitudePilot
        Flies the attitudes of the flip.
    parameters : RuntimeParameters
        Parameters of the vehicle.
    direction : float
        1 rolls to the right, -1 to the left.
    """

    def __init__(self, attitude: AttitudePilot, parameters: RuntimeParameters, direction: float) -> None:
        self._attitude = attitude
        self._parameters = parameters
        self._direction = direction
        self._rolled = self._rolling = 0.0
        self._attitude.stop()
        self._attitude.take(manoeuvre=self._turn_over)
        self._level_rad = self._attitude.roll_rad

    def _turn_over(self, step_s: float) -> bool:
        """Continue the flip for one step, and return whether it has ended."""
        change = _ROLL_ACCELERATION.of(self._parameters) * step_s
        wanted, thrust, over = _RATE_RAD_S, _MORE, False
        if self._rolled >= math.radians(270.0):
            left = 2.0 * math.pi + self._direction * self._level_rad - self._rolled
            wanted = min(_RATE_RAD_S, _ROLL_P_1_S * left, math.sqrt(2.0 * max(left, 0.0) * change / step_s))
            over = left <= _DONE_RAD
        elif self._rolled >= math.radians(45.0):
            thrust = _LESS
        self._rolling += min(max(wanted - self._rolling, -change), change)
        self._rolled += step_s * self._rolling
        self._attitude.roll_rad = math.remainder(self._direction * self._rolled, 2.0 * math.pi)
        self._attitude.move(thrust, step_s)
        return over or self._attitude.flown_for_s > _LONGEST_S
