"""MANUAL_CONTROL: the sticks of a ground station, which move a multirotor of PX4 in its position mode.

Source: PX4 parameter reference (MAN_DEADZONE, MPC_XY_MAN_EXPO, MPC_Z_MAN_EXPO, MPC_YAW_EXPO, MPC_VEL_MANUAL,
MPC_MAN_Y_MAX) and its ``Sticks.cpp``.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.component import NEVER
from sim_vehicle.execution.state import LandedState
from sim_vehicle.motion.legs import KEEP, Heading
from sim_vehicle.pilot.notices import RefusedError

if TYPE_CHECKING:
    from sim_vehicle.pilot.pilot import Pilot

__all__ = ["ManualControl", "stick"]

_DEADZONE, _EXPO = 0.1, 0.6
_FULL_SPEED_M_S, _FULL_TURN_RAD_S = 10.0, math.radians(150.0)
_FULL = 1000.0
# MAVLink's number for an axis that the sender does not have.
_NO_AXIS = 2**15 - 1
# COM_RC_LOSS_T: after that the sticks count as let go.
_LOST_S = 0.5


def stick(value: float) -> float:
    """Share of the greatest speed that a stick asks for, both from -1 to 1.

    Examples
    --------
    >>> stick(0.05), stick(1.0), round(stick(-0.5), 3)
    (0.0, 1.0, -0.23)
    """
    size = min(abs(value), 1.0)
    if size <= _DEADZONE:
        return 0.0
    size = (size - _DEADZONE) / (1.0 - _DEADZONE)
    return math.copysign((1.0 - _EXPO) * size + _EXPO * size**3, value)


class ManualControl:
    """Flies by the sticks.

    Parameters
    ----------
    pilot : Pilot
    """

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self._moves = False
        self._lost_s = NEVER

    def take(self, message: m.MAVLink_manual_control_message, now_s: float) -> None:
        """Fly as the sticks say; centred ones stop the vehicle where it is.

        Raises
        ------
        RefusedError
            When the vehicle cannot fly so.
        """
        pilot = self._pilot
        if pilot.mode is not Mode.POSITION or not pilot.armed:
            self._moves, self._lost_s = False, NEVER
            return
        forward, right, turn = (_share(value) for value in (message.x, message.y, message.r))
        up = _share(message.z, middle=0.5 * _FULL)
        if pilot.landed is LandedState.ON_GROUND and up <= 0.0:
            return
        if not any((forward, right, up, turn)):
            self._stop()
            return
        spec, yaw = pilot.spec, pilot.state.yaw_rad
        speed = min(_FULL_SPEED_M_S, spec.top_speed_m_s)
        east = speed * (forward * math.sin(yaw) + right * math.cos(yaw))
        north = speed * (forward * math.cos(yaw) - right * math.sin(yaw))
        climb = up * (spec.climb_speed_m_s if up > 0.0 else spec.descent_speed_m_s)
        heading = Heading.turning(turn * _FULL_TURN_RAD_S) if turn else KEEP
        pilot.controls.order(lambda: pilot.executor.steer((east, north, climb), heading=heading))
        self._moves, self._lost_s = True, now_s + _LOST_S

    def poll(self, now_s: float) -> None:
        """Stop a vehicle whose sticks are not heard of any more."""
        if now_s >= self._lost_s:
            self._stop()

    def next_deadline(self) -> float:
        """When the sticks count as lost."""
        return self._lost_s

    def _stop(self) -> None:
        self._lost_s = NEVER
        if self._moves and self._pilot.mode is Mode.POSITION and self._pilot.armed:
            with suppress(RefusedError):  # it may have come down meanwhile
                self._pilot.controls.order(self._pilot.executor.hold)
        self._moves = False


def _share(value: int, middle: float = 0.0) -> float:
    """Share of the greatest speed that an axis of the message asks for; one that is not there is centred."""
    return 0.0 if value == _NO_AXIS else stick((value - middle) / (_FULL - middle))
