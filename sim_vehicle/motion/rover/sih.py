"""The rover of PX4's simulator, and how PX4 steers and drives it.

The vehicle is the bicycle model of ``Sih::generate_rover_ackermann_dynamics`` and the lag before it in
``Sih::read_motors`` (PX4 1.17, `sih.cpp`); steering and throttle are PX4's ``AckermannRateControl``,
``AckermannActControl`` and ``RoverControl::speedControl``. What has a time constant is integrated exactly
over a step, as those of the tyres get short when the vehicle is slow.
"""

from __future__ import annotations

from math import atan, cos, exp, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.rover.layout import (
    STOPPED,
)

# PX4 does not steer a vehicle that it thinks slower (``RO_SPEED_TH``).
_STEERS_M_S = 0.1


@compiled(allocates=False)
def thought_speed(state: Record, limits: Record) -> float:
    """Return the speed that PX4 thinks the throttle gives, by which it steers."""
    return float(state.throttle * limits.throttle_speed)


@compiled(allocates=False)
def steer(state: Record, limits: Record, rate: float) -> None:
    """Set the steering for a rate of turning: feed-forward for tyres that do not slip, and a PI loop."""
    speed, wanted = thought_speed(state, limits), 0.0
    if speed > _STEERS_M_S:
        error = rate - state.heading_rate
        wanted = limits.rate_ff * atan(rate * limits.wheel_base / speed)
        wanted += limits.rate_p * error + state.rate_integral
        wanted = min(max(wanted / limits.steer_max, -1.0), 1.0)
        integral = state.rate_integral + limits.rate_i * error * limits.step_s
        state.rate_integral = min(max(integral, -1.0), 1.0)
    else:
        state.rate_integral = 0.0
    change = wanted - state.steer_asked
    state.steer_asked += min(max(change, -limits.steer_step), limits.steer_step)


@compiled(allocates=False)
def throttle(state: Record, limits: Record, wanted: float) -> None:
    """Set the throttle for a speed, which changes as fast as it may."""
    dt = limits.step_s
    speed = sqrt(state.speed * state.speed + state.sideways * state.sideways)
    change = (limits.acceleration if wanted >= speed else limits.deceleration) * dt
    asked = state.speed_asked + min(max(wanted - state.speed_asked, -change), change)
    if abs(asked - speed) > abs(wanted - speed):
        asked = wanted
    state.speed_asked = asked
    share = 0.0
    if asked > 0.0:
        error = asked - speed
        state.speed_integral = min(max(state.speed_integral + limits.speed_i * error * dt, -1.0), 1.0)
        share = asked / limits.throttle_speed + limits.speed_p * error + state.speed_integral
        share = min(max(share, -1.0), 1.0)
    else:
        state.speed_integral = 0.0
    state.throttle = share


@compiled(allocates=False)
def move(state: Record, limits: Record) -> None:
    """Change the velocity over ground and the rate of turning as the simulator does in a step.

    The drag is taken along the axes of the Earth one by one: it depends on where the vehicle drives to. What
    the turn takes from the sideways speed is counted twice, as it is in the simulator: in its tyre force, and
    in the motion itself.
    """
    dt, ahead, right, yaw = limits.step_s, state.speed, state.sideways, state.heading
    share = limits.actuator_share
    state.push += share * (state.throttle - state.push)
    state.steer += share * (state.steer_asked - state.steer)
    total = sqrt(ahead * ahead + right * right)
    north = ahead * cos(yaw) - right * sin(yaw)
    east = ahead * sin(yaw) + right * cos(yaw)
    drag_north = drag_east = 0.0
    axes = (
        (limits.north_1, limits.east_1),
        (limits.north_2, limits.east_2),
        (limits.north_3, limits.east_3),
    )
    for axis in range(3):
        to_north, to_east = axes[axis]
        along = north * to_north + east * to_east
        drag_north += limits.drag * along * abs(along) * to_north
        drag_east += limits.drag * along * abs(along) * to_east
    held = limits.friction / max(total, STOPPED)
    turns = state.heading_rate
    pull = limits.force * state.push - held * ahead + right * turns
    state.speed = max(ahead + (pull - drag_north * cos(yaw) - drag_east * sin(yaw)) * dt, 0.0)
    if ahead <= STOPPED:
        state.sideways = 0.0
        state.heading_rate = turns * exp(-limits.turn_damping * dt)
        return
    angle, base = limits.steer_max * state.steer, limits.wheel_base
    fade = limits.turn_grip * base * base / ahead + limits.turn_damping
    steady = limits.turn_grip * base * angle / fade
    state.heading_rate = steady + (turns - steady) * exp(-fade * dt)
    fade = 2.0 * limits.grip / ahead + held
    push = limits.grip * angle - 2.0 * ahead * turns + drag_north * sin(yaw) - drag_east * cos(yaw)
    steady = push / fade
    state.sideways = steady + (right - steady) * exp(-fade * dt)
