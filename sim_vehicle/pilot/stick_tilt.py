"""Flies a multirotor whose sticks lean it: nothing holds its place, so that the wind carries it along.

The thrust leans with the sticks, drag pulls towards the speed of the air. The velocities that follow from
both are flown by the velocity control of the vehicle, at its greatest acceleration.

Sources: PX4's ``StickTiltXY.cpp``, ``FlightTaskManualAltitude.cpp``, ``mc_att_control_main.cpp`` and
``MulticopterRateControl.cpp``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.execution.state import LandedState
from sim_vehicle.motion.legs import Heading

if TYPE_CHECKING:
    from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters
    from sim_vehicle.autopilot.stick_rules import Sticks, TiltSticks
    from sim_vehicle.pilot.controls import Controls

__all__ = ["StickTilt"]

# A longer gap is no flight by sticks, but its beginning.
_LONGEST_STEP_S = 0.5
# Angles beyond it, and so flips, are not flown.
_MOST_LEAN_RAD = math.radians(70.0)


class StickTilt:
    """Orders velocities from sticks that lean the vehicle.

    Parameters
    ----------
    controls : Controls
        The vehicle.
    parameters : RuntimeParameters
    rules : TiltSticks
    """

    def __init__(self, controls: Controls, parameters: RuntimeParameters, rules: TiltSticks) -> None:
        self._controls = controls
        self._parameters = parameters
        self._rules = rules
        self._velocity_m_s = (0.0, 0.0, 0.0)
        self._lean_rad = (0.0, 0.0)
        self._height_m: float | None = None
        self._flown_s = -math.inf

    def forget(self) -> None:
        """Note that something else is flown now."""
        self._flown_s = -math.inf

    def fly(self, sticks: Sticks, climb_m_s: float | None, heading: Heading, *, by_rate: bool) -> None:
        """Fly on.

        Parameters
        ----------
        sticks : Sticks
        climb_m_s : float or None
            The vertical speed that is asked for; the height is held at 0. None: the stick is the thrust.
        heading : Heading
        by_rate : bool
            The sticks turn the vehicle about its axes, and it keeps its lean without them (acro).

        Raises
        ------
        RefusedError
            When it cannot be flown.
        """
        controls, rules = self._controls, self._rules
        state = controls.state
        step_s = controls.now_s - self._flown_s
        if step_s > _LONGEST_STEP_S:
            self._velocity_m_s, self._lean_rad, self._height_m = state.velocity_m_s, (0.0, 0.0), None
            step_s = 0.0
        if step_s == 0.0 and self._flown_s == controls.now_s:
            return
        self._flown_s = controls.now_s
        forward_rad, right_rad = self._lean_rad = self._lean(sticks, step_s, by_rate=by_rate)
        thrust = 1.0 if climb_m_s is not None else self._thrust(sticks.up)
        lean_rad = math.hypot(forward_rad, right_rad)
        if climb_m_s is not None:
            # The stick is the acceleration; the thrust grows with the lean, so that its upward part stays.
            most_rad = min(rules.lean.of(self._parameters), _MOST_LEAN_RAD)
            scale = GRAVITY_M_S2 * math.tan(most_rad) / most_rad
        else:
            scale = GRAVITY_M_S2 * thrust * math.sin(lean_rad) / lean_rad if lean_rad > 0.0 else 0.0
        ahead, aside = scale * forward_rad, scale * right_rad
        yaw = state.yaw_rad
        drag = rules.drag(controls.spec)
        wind_east, wind_north = state.wind_m_s
        east, north, up = self._velocity_m_s
        east = _fall(east, wind_east, ahead * math.sin(yaw) + aside * math.cos(yaw), drag, step_s)
        north = _fall(north, wind_north, ahead * math.cos(yaw) - aside * math.sin(yaw), drag, step_s)
        size = max(math.hypot(east, north) / controls.spec.top_speed_m_s, 1.0)
        east, north = east / size, north / size
        if climb_m_s is None:
            up = _fall(up, 0.0, GRAVITY_M_S2 * (thrust * math.cos(lean_rad) - 1.0), drag, step_s)
            up = min(max(up, -controls.spec.descent_speed_m_s), controls.spec.climb_speed_m_s)
        else:
            up = climb_m_s
        self._velocity_m_s = (east, north, up)
        self._order(climb_m_s, heading)

    def _order(self, climb_m_s: float | None, heading: Heading) -> None:
        controls = self._controls
        east, north, up = self._velocity_m_s
        if controls.landed is LandedState.ON_GROUND and up <= 0.0:
            self._velocity_m_s = (0.0, 0.0, 0.0)
            return
        state = controls.state
        if climb_m_s != 0.0:
            self._height_m = None
        elif self._height_m is None and abs(state.velocity_m_s[2]) < self._rules.hold_below.of(
            self._parameters
        ):
            self._height_m = state.position_m[2]
        height_m = math.nan if self._height_m is None else self._height_m
        executor = controls.executor
        controls.order(lambda: executor.steer((east, north, up), height_m=height_m, heading=heading))

    def _lean(self, sticks: Sticks, step_s: float, *, by_rate: bool) -> tuple[float, float]:
        """Lean forward and to the right, radians."""
        rules, parameters = self._rules, self._parameters
        if by_rate:
            forward, right = self._lean_rad
            forward += step_s * rules.pitch_rate.of(parameters) * sticks.forward
            right += step_s * rules.roll_rate.of(parameters) * sticks.right
            most = _MOST_LEAN_RAD
        else:
            most = min(rules.lean.of(parameters), _MOST_LEAN_RAD)
            forward, right = most * sticks.forward, most * sticks.right
        size = max(math.hypot(forward, right) / most, 1.0)
        return forward / size, right / size

    def _thrust(self, up: float) -> float:
        """Thrust that the throttle stick asks for, in parts of that of a hover."""
        rules, parameters = self._rules, self._parameters
        hover = rules.hover_thrust.of(parameters)
        end = (rules.most_thrust if up > 0.0 else rules.least_thrust).of(parameters)
        return 1.0 + abs(up) * (end / hover - 1.0)


def _fall(speed: float, air_speed: float, acceleration: float, drag_1_s: float, step_s: float) -> float:
    """Speed after a time in which a force and a drag that is linear in the airspeed act."""
    if drag_1_s <= 0.0:
        return speed + acceleration * step_s
    final = air_speed + acceleration / drag_1_s
    return final + (speed - final) * math.exp(-drag_1_s * step_s)
