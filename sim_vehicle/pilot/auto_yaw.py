"""CONDITION_YAW while the vehicle flies on: the nose turns at a rate and stays until something else is flown.

Source: ArduCopter's ``autoyaw.cpp``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import LandedState

if TYPE_CHECKING:
    from sim_vehicle.pilot.controls import Controls

__all__ = ["AutoYaw"]

# LOITER and the modes of a pilot take their heading from the sticks.
_MODES = frozenset({Mode.GUIDED, Mode.TAKEOFF, Mode.MISSION, Mode.RTL, Mode.LAND})


class AutoYaw:
    """Slews the heading that was ordered.

    Parameters
    ----------
    controls : Controls
        The vehicle.
    mode : callable
        The flight mode now.
    """

    def __init__(self, controls: Controls, mode: Callable[[], Mode]) -> None:
        self._controls = controls
        self._mode = mode
        self._flown: tuple[Mode, int] | None = None
        self._yaw_rad = self._left_rad = self._rate_rad_s = self._slewed_s = 0.0

    @property
    def active(self) -> bool:
        """Whether an ordered heading holds."""
        return self._flown is not None

    def forget(self) -> None:
        """Note that the heading is decided otherwise from now on."""
        self._flown = None

    def order(self, angle_rad: float, rate_rad_s: float, direction: int, *, relative: bool) -> None:
        """Turn to a heading.

        Parameters
        ----------
        angle_rad : float
            Compass heading, or with ``relative`` how far to turn.
        rate_rad_s : float
            Of the turn; without a positive one, and at most, the vehicle's own.
        direction : int
            1 clockwise, -1 counter-clockwise, 0 (of a heading) the short way.
        """
        if self._mode() not in _MODES or self._controls.landed is LandedState.ON_GROUND:
            return
        if not self.active:
            self._yaw_rad = self._controls.state.yaw_rad
        if relative:
            left = -angle_rad if direction < 0 else angle_rad
        else:
            left = math.remainder(angle_rad - self._yaw_rad, 2.0 * math.pi)
            if direction * left < 0.0:
                left += direction * 2.0 * math.pi
        most = self._controls.spec.yaw_rate_rad_s
        self._left_rad = left
        self._rate_rad_s = min(rate_rad_s, most) if rate_rad_s > 0.0 else most
        self._slewed_s = self._controls.now_s
        self._flown = self._now
        self._controls.executor.look_at(None)
        self.check()

    def check(self) -> None:
        """Turn on, unless something else is flown by now."""
        if self._flown is None:
            return
        if self._flown != self._now:
            self._flown = None
            return
        step = (self._controls.now_s - self._slewed_s) * self._rate_rad_s
        turned = min(max(self._left_rad, -step), step)
        self._slewed_s = self._controls.now_s
        self._left_rad -= turned
        self._yaw_rad = (self._yaw_rad + turned) % (2.0 * math.pi)
        self._controls.executor.motion.point(self._yaw_rad)

    @property
    def _now(self) -> tuple[Mode, int]:
        """What is flown, with the waypoint of a mission."""
        mode = self._mode()
        return mode, self._controls.executor.current_seq if mode is Mode.MISSION else -1
