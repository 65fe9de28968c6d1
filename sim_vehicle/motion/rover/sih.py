"""The rover of PX4's simulator, and how PX4 steers and drives it.

The vehicle is the bicycle model of ``Sih::generate_rover_ackermann_dynamics`` and the lag before it in
``Sih::read_motors`` (PX4 1.17, `sih.cpp`); steering and throttle are PX4's ``AckermannRateControl``,
``AckermannActControl`` and ``RoverControl::speedControl``. What has a time constant is integrated exactly
over a step, as those of the tyres get short when the vehicle is slow.
"""

from __future__ import annotations

from math import atan, cos, exp, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.multirotor.kernel import Floats
from sim_vehicle.motion.rover.layout import (
    ACCELERATION,
    ACTUATOR_SHARE,
    DECELERATION,
    DRAG,
    EAST,
    FORCE,
    FRICTION,
    GRIP,
    NORTH,
    PUSH,
    RATE_FF,
    RATE_I,
    RATE_INTEGRAL,
    RATE_P,
    SIDEWAYS,
    SPEED,
    SPEED_ASKED,
    SPEED_I,
    SPEED_INTEGRAL,
    SPEED_P,
    STEER,
    STEER_ASKED,
    STEER_MAX,
    STEER_STEP,
    STEP_S,
    STOPPED,
    THROTTLE,
    THROTTLE_SPEED,
    TURN_DAMPING,
    TURN_GRIP,
    WHEEL_BASE,
)

# PX4 does not steer a vehicle that it thinks slower (``RO_SPEED_TH``).
_STEERS_M_S = 0.1


@compiled
def thought_speed(state: Floats, limits: Floats) -> float:
    """Return the speed that PX4 thinks the throttle gives, by which it steers."""
    return float(state[THROTTLE] * limits[THROTTLE_SPEED])


@compiled
def steer(state: Floats, limits: Floats, rate: float) -> None:
    """Set the steering for a rate of turning: feed-forward for tyres that do not slip, and a PI loop."""
    speed, wanted = thought_speed(state, limits), 0.0
    if speed > _STEERS_M_S:
        error = rate - state[col.HEADING_RATE]
        wanted = limits[RATE_FF] * atan(rate * limits[WHEEL_BASE] / speed)
        wanted += limits[RATE_P] * error + state[RATE_INTEGRAL]
        wanted = min(max(wanted / limits[STEER_MAX], -1.0), 1.0)
        integral = state[RATE_INTEGRAL] + limits[RATE_I] * error * limits[STEP_S]
        state[RATE_INTEGRAL] = min(max(integral, -1.0), 1.0)
    else:
        state[RATE_INTEGRAL] = 0.0
    change = wanted - state[STEER_ASKED]
    state[STEER_ASKED] += min(max(change, -limits[STEER_STEP]), limits[STEER_STEP])


@compiled
def throttle(state: Floats, limits: Floats, wanted: float) -> None:
    """Set the throttle for a speed, which changes as fast as it may."""
    dt = limits[STEP_S]
    speed = sqrt(state[SPEED] * state[SPEED] + state[SIDEWAYS] * state[SIDEWAYS])
    change = (limits[ACCELERATION] if wanted >= speed else limits[DECELERATION]) * dt
    asked = state[SPEED_ASKED] + min(max(wanted - state[SPEED_ASKED], -change), change)
    if abs(asked - speed) > abs(wanted - speed):
        asked = wanted
    state[SPEED_ASKED] = asked
    share = 0.0
    if asked > 0.0:
        error = asked - speed
        state[SPEED_INTEGRAL] = min(max(state[SPEED_INTEGRAL] + limits[SPEED_I] * error * dt, -1.0), 1.0)
        share = asked / limits[THROTTLE_SPEED] + limits[SPEED_P] * error + state[SPEED_INTEGRAL]
        share = min(max(share, -1.0), 1.0)
    else:
        state[SPEED_INTEGRAL] = 0.0
    state[THROTTLE] = share


@compiled
def move(state: Floats, limits: Floats) -> None:
    """Change the velocity over ground and the rate of turning as the simulator does in a step.

    The drag is taken along the axes of the Earth one by one: it depends on where the vehicle drives to. What
    the turn takes from the sideways speed is counted twice, as it is in the simulator: in its tyre force, and
    in the motion itself.
    """
    dt, ahead, right, yaw = limits[STEP_S], state[SPEED], state[SIDEWAYS], state[col.HEADING]
    share = limits[ACTUATOR_SHARE]
    state[PUSH] += share * (state[THROTTLE] - state[PUSH])
    state[STEER] += share * (state[STEER_ASKED] - state[STEER])
    total = sqrt(ahead * ahead + right * right)
    north = ahead * cos(yaw) - right * sin(yaw)
    east = ahead * sin(yaw) + right * cos(yaw)
    drag_north = drag_east = 0.0
    for k in range(3):
        along = north * limits[NORTH + k] + east * limits[EAST + k]
        drag_north += limits[DRAG] * along * abs(along) * limits[NORTH + k]
        drag_east += limits[DRAG] * along * abs(along) * limits[EAST + k]
    held = limits[FRICTION] / max(total, STOPPED)
    turns = state[col.HEADING_RATE]
    pull = limits[FORCE] * state[PUSH] - held * ahead + right * turns
    state[SPEED] = max(ahead + (pull - drag_north * cos(yaw) - drag_east * sin(yaw)) * dt, 0.0)
    if ahead <= STOPPED:
        state[SIDEWAYS] = 0.0
        state[col.HEADING_RATE] = turns * exp(-limits[TURN_DAMPING] * dt)
        return
    angle, base = limits[STEER_MAX] * state[STEER], limits[WHEEL_BASE]
    fade = limits[TURN_GRIP] * base * base / ahead + limits[TURN_DAMPING]
    steady = limits[TURN_GRIP] * base * angle / fade
    state[col.HEADING_RATE] = steady + (turns - steady) * exp(-fade * dt)
    fade = 2.0 * limits[GRIP] / ahead + held
    push = limits[GRIP] * angle - 2.0 * ahead * turns + drag_north * sin(yaw) - drag_east * cos(yaw)
    steady = push / fade
    state[SIDEWAYS] = steady + (right - steady) * exp(-fade * dt)
