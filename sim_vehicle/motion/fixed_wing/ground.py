"""A fixed wing on the ground, compiled: the take-off roll or launch, and braking after a landing."""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.fixed_wing.forces import drag
from sim_vehicle.motion.fixed_wing.layout import FLYING, SHORT
from sim_vehicle.motion.records import Record

__all__ = ["brake_rate", "roll_on_ground", "take_off"]


@compiled(allocates=False)
def roll_on_ground(state: Record, limits: Record, rate: float, wx: float, wy: float) -> None:
    """Change the speed over ground by ``rate`` along the course on the ground."""
    dt = limits.step_s
    ce, cn = sin(state.course), cos(state.course)
    before = state.velocity_x * ce + state.velocity_y * cn
    speed = max(before + rate * dt, 0.0)
    state.position_x += 0.5 * (before + speed) * dt * ce
    state.position_y += 0.5 * (before + speed) * dt * cn
    state.position_z = 0.0
    state.path_length += 0.5 * (before + speed) * dt
    state.acceleration_x, state.acceleration_y, state.acceleration_z = (
        (speed - before) / dt * ce,
        (speed - before) / dt * cn,
        0.0,
    )
    state.velocity_x, state.velocity_y, state.velocity_z = speed * ce, speed * cn, 0.0
    state.heading, state.heading_rate = state.course % (2.0 * pi), 0.0
    state.airspeed = max(speed - wx * ce - wy * cn, 0.0)
    state.climb = state.bank = state.command = state.pitch = 0.0


@compiled(allocates=False)
def _lift_off(state: Record, wx: float, wy: float) -> None:
    ae, an = state.velocity_x - wx, state.velocity_y - wy
    state.airspeed = max(sqrt(ae * ae + an * an), SHORT)
    state.heading = atan2(ae, an) % (2.0 * pi)
    state.nose_up = state.trimmed = state.since = 0.0
    state.doing = FLYING


@compiled(allocates=False)
def brake_rate(state: Record, limits: Record) -> float:
    """Return the deceleration on the ground after a landing."""
    braking = limits.braking
    if limits.ground_drag > 0.0:
        v = state.airspeed
        braking += limits.ground_drag * v + limits.parasitic * v * v
    return float(braking)


@compiled(allocates=False)
def take_off(state: Record, limits: Record, wx: float, wy: float) -> None:
    """Be thrown, or roll a step, and leave the ground when it is fast enough."""
    dt = limits.step_s
    state.since += dt
    if state.since < limits.takeoff_delay:
        state.throttle = 0.0
        roll_on_ground(state, limits, 0.0, wx, wy)
        return
    throttle = limits.throttle_limit
    if limits.throttle_slew > 0.0:
        throttle = min(throttle, state.throttle + limits.throttle_slew * dt)
    ramps = state.since < limits.ramp_s
    throttle *= limits.ramp_throttle * (state.since / limits.ramp_s if ramps else 1.0)
    state.throttle = throttle
    rate = limits.launch * throttle
    if limits.launch <= 0.0:
        v = state.airspeed
        # It stands level until it lifts off: the drag is that of the lift at no angle of attack.
        load = limits.lift_level * v * v / GRAVITY_M_S2
        rate = limits.thrust * throttle - drag(limits, v, load) - limits.ground_drag * v
    roll_on_ground(state, limits, rate, wx, wy)
    if state.airspeed >= limits.rotation and not ramps:
        _lift_off(state, wx, wy)
