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
from sim_vehicle.motion.arducopter.control import rooted
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.rover.layout import STOPPED

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


@compiled(allocates=False)
def ask(state: Record, guide: Record, law: Record, step: int) -> float:
    """Return the rate of turning that is asked for, and set the speed that is.

    The speed is the forward part of the wanted velocity, which in a corner does not fall below what the
    tightest turn allows at half of the lateral acceleration; the rate is that of the wanted
    lateral acceleration.
    """
    if guide.pivots != 0.0:
        _slow_down(guide, law, 0.0)
        return _pivot(state, guide, law, step) if guide.speed_asked == 0.0 else 0.0
    ex, ey = guide.px - state.position_x, guide.py - state.position_y
    size = sqrt(ex * ex + ey * ey)
    gain = rooted(size, law.pos_p, min(law.accel, law.lateral)) / size if size > 0.0 else 0.0
    wx, wy = guide.vx + gain * ex, guide.vy + gain * ey
    wanted = sqrt(wx * wx + wy * wy)
    if wanted > guide.level:
        wx, wy, wanted = wx * guide.level / wanted, wy * guide.level / wanted, guide.level
    ux, uy = wx - state.velocity_x, wy - state.velocity_y
    share = law.error_filter
    if guide.reset != 0.0:
        guide.reset, share = 0.0, 1.0
    guide.error_x += share * (ux - guide.error_x)
    guide.error_y += share * (uy - guide.error_y)
    ax = law.vel_p * guide.error_x + guide.ax
    ay = law.vel_p * guide.error_y + guide.ay
    heading = state.heading + _HEADING_ERROR
    sine, cosine = sin(heading), cos(heading)
    _slow_down(guide, law, max(wx * sine + wy * cosine, min(wanted, law.turn_speed)))
    return float((ax * cosine - ay * sine) / max(guide.speed_asked, _LEAST_SPEED_M_S))


@compiled(allocates=False)
def _slow_down(guide: Record, law: Record, wanted: float) -> None:
    """Bring the speed that is asked for towards another one, within the accelerations."""
    before = guide.speed_asked
    change = (law.speed_accel if wanted >= before else law.decel) * law.dt
    guide.speed_asked = before + _limited(wanted - before, change)


@compiled(allocates=False)
def _pivot(state: Record, guide: Record, law: Record, step: int) -> float:
    """Return the rate of a turn on the spot towards the waypoint, and end it within 5 degrees of that."""
    bearing = atan2(guide.end_x - state.position_x, guide.end_y - state.position_y)
    error = (bearing - state.heading + pi) % (2.0 * pi) - pi
    rate = _limited(law.angle_p * error, law.pivot_rate)
    rate = _limited(rate, sqrt(2.0 * abs(error) * law.steer_accel))
    if abs(error) < _PIVOTED and guide.pivots == 1.0:
        guide.pivots = 2.0
        guide.until = step + law.pivot_delay
    if guide.pivots == 2.0 and step >= guide.until:
        guide.pivots = 0.0
    return rate


@compiled(allocates=False)
def steer(state: Record, guide: Record, law: Record, rate: float) -> None:
    """Turn as the steering does for a rate that is asked for."""
    dt, speed = law.dt, abs(state.speed)
    rate = guide.turn_asked + _limited(rate - guide.turn_asked, law.steer_accel * dt)
    rate = _limited(rate, law.steer_rate)
    rate = _limited(rate, max(law.lateral / max(speed, _LEAST_SPEED_M_S), _LEAST_RATE))
    guide.turn_asked = rate
    if law.tightest == 0.0:
        state.heading_rate += (rate - state.heading_rate) * law.steer_lag
        return
    guide.steer_error += law.steer_filter * (rate - state.heading_rate - guide.steer_error)
    error = guide.steer_error
    # Wheels cannot turn a vehicle that stands: its integrator only shrinks meanwhile.
    if speed > law.scale_base or error * guide.steer_i < 0.0:
        guide.steer_i = _limited(guide.steer_i + law.steer_i_gain * error * dt, law.steer_imax)
    output = law.steer_ff * rate + law.steer_p * error + guide.steer_i
    if speed > law.scale_base > 0.0:
        output *= law.scale_base / speed
    # Backing up it steers the other way, which turns it as asked.
    state.heading_rate = wheels(speed, output, law.tightest)


@compiled(allocates=False)
def centre(state: Record, guide: Record, law: Record) -> None:
    """Stop: slow down with the wheels straight."""
    _slow_down(guide, law, 0.0)
    guide.turn_asked = guide.steer_error = guide.steer_i = 0.0
    state.heading_rate = 0.0
    guide.reset = 1.0


@compiled(inline="always")
def wheels(speed: float, output: float, tightest: float) -> float:
    """Return the rate of turning of steered wheels (`SIM_Rover.cpp`)."""
    return speed / tightest * sin(_LOCK * _limited(output, 1.0)) / _SINE_OF_LOCK


@compiled(allocates=False)
def drive(state: Record, guide: Record, law: Record) -> None:
    """Bring the speed to what is asked for by the throttle, and move one step."""
    dt, before = law.dt, state.speed
    asked = guide.speed_asked
    if asked != 0.0:
        guide.stands = 0.0
    elif abs(before) <= law.stop_speed:
        guide.stands = 1.0
    if guide.stands != 0.0:
        guide.drive_error = guide.drive_i = throttle = 0.0
    else:
        guide.drive_error += law.drive_filter * (asked - before - guide.drive_error)
        error = guide.drive_error
        throttle = law.drive_base * asked + law.drive_p * error + guide.drive_i
        if abs(throttle) < 1.0 or error * guide.drive_i < 0.0:
            guide.drive_i = _limited(guide.drive_i + law.drive_i_gain * error * dt, law.drive_imax)
        throttle = _limited(throttle, 1.0)
    speed = before + law.drive_lag * (throttle * law.top_speed - before)
    if guide.stands != 0.0 and abs(speed) < STOPPED:
        speed = 0.0
    turn = state.heading_rate * dt
    middle = state.heading + 0.5 * turn
    state.heading = (state.heading + turn) % (2.0 * pi)
    way = 0.5 * (before + speed) * dt
    state.position_x += way * sin(middle)
    state.position_y += way * cos(middle)
    state.path_length += abs(way)
    ve, vn = speed * sin(state.heading), speed * cos(state.heading)
    state.acceleration_x = (ve - state.velocity_x) / dt
    state.acceleration_y = (vn - state.velocity_y) / dt
    state.velocity_x, state.velocity_y = ve, vn
    state.speed, state.throttle = speed, throttle


@compiled(allocates=False)
def look_along(state: Record, guide: Record) -> None:
    """Note how far the vehicle is behind its target, and its speed along that one's way."""
    wx, wy = guide.vx, guide.vy
    wanted = sqrt(wx * wx + wy * wy)
    guide.lag = guide.along = 0.0
    if wanted > 1e-6:
        ex, ey = guide.px - state.position_x, guide.py - state.position_y
        guide.lag = (ex * wx + ey * wy) / wanted
        guide.along = (state.velocity_x * wx + state.velocity_y * wy) / wanted
