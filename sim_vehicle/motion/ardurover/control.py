"""Rover's position control, steering and throttle, and the vehicle that they move.

Formulas after ArduPilot 4.7: `AR_PosControl.cpp`, `AR_AttitudeControl.cpp`, `AR_PivotTurn.cpp`,
`AP_MotorsUGV.cpp`, and the vehicle of its simulator, `SIM_Rover.cpp`.
How it works is told in docs/fixed-wing-and-rover.md.
"""

from __future__ import annotations

from math import atan2, cos, pi, radians, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter.control import rooted
from sim_vehicle.motion.arducopter.layout import (
    ACCEL,
    ALONG,
    AX,
    DT,
    END,
    ERROR,
    ERROR_FILTER,
    LAG,
    LEVEL,
    POS_P,
    PX,
    RESET,
    UNTIL,
    VEL_P,
    VX,
)
from sim_vehicle.motion.ardurover.layout import (
    ANGLE_P,
    DECEL,
    DRIVE_BASE,
    DRIVE_ERROR,
    DRIVE_FILTER,
    DRIVE_I,
    DRIVE_I_GAIN,
    DRIVE_IMAX,
    DRIVE_LAG,
    DRIVE_P,
    LATERAL,
    PIVOT_DELAY,
    PIVOT_RATE,
    PIVOTS,
    SCALE_BASE,
    SPEED_ASKED,
    SPEED_UP,
    STANDS,
    STEER_ACCEL,
    STEER_ERROR,
    STEER_FF,
    STEER_FILTER,
    STEER_I,
    STEER_I_GAIN,
    STEER_IMAX,
    STEER_LAG,
    STEER_P,
    STEER_RATE,
    STOP_SPEED,
    TIGHTEST,
    TOP_SPEED,
    TURN_ASKED,
    TURN_SPEED,
)
from sim_vehicle.motion.rover.layout import SPEED, STOPPED, THROTTLE

Floats = NDArray[np.float64]

_PIVOTED = radians(5.0)
_LEAST_RATE = radians(1.0)
# Lateral accelerations become rates of turning at this speed or more.
_LEAST_SPEED_M_S = 1.0
# The estimated heading wanders by half a degree (the recordings'). Without an error of it a target that is
# exactly behind would never be turned to.
_HEADING_ERROR = radians(0.5)
# The wheels at full steering; between, the radius goes with the sine of their angle.
_LOCK = radians(35.0)
_SINE_OF_LOCK = sin(_LOCK)


@compiled(inline="always")
def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled
def ask(state: Floats, guide: Floats, law: Floats, step: int) -> float:
    """Return the rate of turning that is asked for, and set the speed that is.

    The speed is the forward part of the wanted velocity, which in a corner does not fall below what the
    tightest turn allows at half of the lateral acceleration; the rate is that of the wanted
    lateral acceleration.
    """
    if guide[PIVOTS] != 0.0:
        _slow_down(guide, law, 0.0)
        return _pivot(state, guide, law, step) if guide[SPEED_ASKED] == 0.0 else 0.0
    ex, ey = guide[PX] - state[col.POSITION_X], guide[PX + 1] - state[col.POSITION_Y]
    size = sqrt(ex * ex + ey * ey)
    gain = rooted(size, law[POS_P], min(law[ACCEL], law[LATERAL])) / size if size > 0.0 else 0.0
    wx, wy = guide[VX] + gain * ex, guide[VX + 1] + gain * ey
    wanted = sqrt(wx * wx + wy * wy)
    if wanted > guide[LEVEL]:
        wx, wy, wanted = wx * guide[LEVEL] / wanted, wy * guide[LEVEL] / wanted, guide[LEVEL]
    ux, uy = wx - state[col.VELOCITY_X], wy - state[col.VELOCITY_Y]
    share = law[ERROR_FILTER]
    if guide[RESET] != 0.0:
        guide[RESET], share = 0.0, 1.0
    guide[ERROR] += share * (ux - guide[ERROR])
    guide[ERROR + 1] += share * (uy - guide[ERROR + 1])
    ax = law[VEL_P] * guide[ERROR] + guide[AX]
    ay = law[VEL_P] * guide[ERROR + 1] + guide[AX + 1]
    heading = state[col.HEADING] + _HEADING_ERROR
    sine, cosine = sin(heading), cos(heading)
    _slow_down(guide, law, max(wx * sine + wy * cosine, min(wanted, law[TURN_SPEED])))
    return float((ax * cosine - ay * sine) / max(guide[SPEED_ASKED], _LEAST_SPEED_M_S))


@compiled
def _slow_down(guide: Floats, law: Floats, wanted: float) -> None:
    """Bring the speed that is asked for towards another one, within the accelerations."""
    before = guide[SPEED_ASKED]
    change = (law[SPEED_UP] if wanted >= before else law[DECEL]) * law[DT]
    guide[SPEED_ASKED] = before + _limited(wanted - before, change)


@compiled
def _pivot(state: Floats, guide: Floats, law: Floats, step: int) -> float:
    """Return the rate of a turn on the spot towards the waypoint, and end it within 5 degrees of that."""
    bearing = atan2(guide[END] - state[col.POSITION_X], guide[END + 1] - state[col.POSITION_Y])
    error = (bearing - state[col.HEADING] + pi) % (2.0 * pi) - pi
    rate = _limited(law[ANGLE_P] * error, law[PIVOT_RATE])
    rate = _limited(rate, sqrt(2.0 * abs(error) * law[STEER_ACCEL]))
    if abs(error) < _PIVOTED and guide[PIVOTS] == 1.0:
        guide[PIVOTS] = 2.0
        guide[UNTIL] = step + law[PIVOT_DELAY]
    if guide[PIVOTS] == 2.0 and step >= guide[UNTIL]:
        guide[PIVOTS] = 0.0
    return rate


@compiled
def steer(state: Floats, guide: Floats, law: Floats, rate: float) -> None:
    """Turn as the steering does for a rate that is asked for."""
    dt, speed = law[DT], abs(state[SPEED])
    rate = guide[TURN_ASKED] + _limited(rate - guide[TURN_ASKED], law[STEER_ACCEL] * dt)
    rate = _limited(rate, law[STEER_RATE])
    rate = _limited(rate, max(law[LATERAL] / max(speed, _LEAST_SPEED_M_S), _LEAST_RATE))
    guide[TURN_ASKED] = rate
    if law[TIGHTEST] == 0.0:
        state[col.HEADING_RATE] += (rate - state[col.HEADING_RATE]) * law[STEER_LAG]
        return
    guide[STEER_ERROR] += law[STEER_FILTER] * (rate - state[col.HEADING_RATE] - guide[STEER_ERROR])
    error = guide[STEER_ERROR]
    # Wheels cannot turn a vehicle that stands: its integrator only shrinks meanwhile.
    if speed > law[SCALE_BASE] or error * guide[STEER_I] < 0.0:
        guide[STEER_I] = _limited(guide[STEER_I] + law[STEER_I_GAIN] * error * dt, law[STEER_IMAX])
    output = law[STEER_FF] * rate + law[STEER_P] * error + guide[STEER_I]
    if speed > law[SCALE_BASE] > 0.0:
        output *= law[SCALE_BASE] / speed
    # Backing up it steers the other way, which turns it as asked.
    state[col.HEADING_RATE] = wheels(speed, output, law[TIGHTEST])


@compiled
def centre(state: Floats, guide: Floats, law: Floats) -> None:
    """Stop: slow down with the wheels straight."""
    _slow_down(guide, law, 0.0)
    guide[TURN_ASKED] = guide[STEER_ERROR] = guide[STEER_I] = 0.0
    state[col.HEADING_RATE] = 0.0
    guide[RESET] = 1.0


@compiled(inline="always")
def wheels(speed: float, output: float, tightest: float) -> float:
    """Return the rate of turning of steered wheels (`SIM_Rover.cpp`)."""
    return speed / tightest * sin(_LOCK * _limited(output, 1.0)) / _SINE_OF_LOCK


@compiled
def drive(state: Floats, guide: Floats, law: Floats) -> None:
    """Bring the speed to what is asked for by the throttle, and move one step."""
    dt, before = law[DT], state[SPEED]
    asked = guide[SPEED_ASKED]
    if asked != 0.0:
        guide[STANDS] = 0.0
    elif abs(before) <= law[STOP_SPEED]:
        guide[STANDS] = 1.0
    if guide[STANDS] != 0.0:
        guide[DRIVE_ERROR] = guide[DRIVE_I] = throttle = 0.0
    else:
        guide[DRIVE_ERROR] += law[DRIVE_FILTER] * (asked - before - guide[DRIVE_ERROR])
        error = guide[DRIVE_ERROR]
        throttle = law[DRIVE_BASE] * asked + law[DRIVE_P] * error + guide[DRIVE_I]
        if abs(throttle) < 1.0 or error * guide[DRIVE_I] < 0.0:
            guide[DRIVE_I] = _limited(guide[DRIVE_I] + law[DRIVE_I_GAIN] * error * dt, law[DRIVE_IMAX])
        throttle = _limited(throttle, 1.0)
    speed = before + law[DRIVE_LAG] * (throttle * law[TOP_SPEED] - before)
    if guide[STANDS] != 0.0 and abs(speed) < STOPPED:
        speed = 0.0
    turn = state[col.HEADING_RATE] * dt
    middle = state[col.HEADING] + 0.5 * turn
    state[col.HEADING] = (state[col.HEADING] + turn) % (2.0 * pi)
    way = 0.5 * (before + speed) * dt
    state[col.POSITION_X] += way * sin(middle)
    state[col.POSITION_Y] += way * cos(middle)
    state[col.PATH_LENGTH] += abs(way)
    ve, vn = speed * sin(state[col.HEADING]), speed * cos(state[col.HEADING])
    state[col.ACCELERATION_X] = (ve - state[col.VELOCITY_X]) / dt
    state[col.ACCELERATION_Y] = (vn - state[col.VELOCITY_Y]) / dt
    state[col.VELOCITY_X], state[col.VELOCITY_Y] = ve, vn
    state[SPEED], state[THROTTLE] = speed, throttle


@compiled
def look_along(state: Floats, guide: Floats) -> None:
    """Note how far the vehicle is behind its target, and its speed along that one's way."""
    wx, wy = guide[VX], guide[VX + 1]
    wanted = sqrt(wx * wx + wy * wy)
    guide[LAG] = guide[ALONG] = 0.0
    if wanted > 1e-6:
        ex, ey = guide[PX] - state[col.POSITION_X], guide[PX + 1] - state[col.POSITION_Y]
        guide[LAG] = (ex * wx + ey * wy) / wanted
        guide[ALONG] = (state[col.VELOCITY_X] * wx + state[col.VELOCITY_Y] * wy) / wanted
