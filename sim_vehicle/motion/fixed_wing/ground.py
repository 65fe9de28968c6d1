"""A fixed wing on the ground, compiled: the take-off roll or launch, and braking after a landing."""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing.forces import drag
from sim_vehicle.motion.fixed_wing.guidance import Floats
from sim_vehicle.motion.fixed_wing.layout import (
    AIRSPEED,
    BANK,
    BRAKING,
    CLIMB,
    COMMAND,
    COURSE,
    DOING,
    FLYING,
    GROUND_DRAG,
    LAUNCH,
    LIFT_LEVEL,
    NOSE_UP,
    PARASITIC,
    PITCH,
    RAMP_S,
    RAMP_THROTTLE,
    ROTATION,
    SHORT,
    SINCE,
    STEP_S,
    TAKEOFF_DELAY,
    THROTTLE,
    THROTTLE_LIMIT,
    THROTTLE_SLEW,
    THRUST,
    TRIMMED,
)

__all__ = ["brake_rate", "roll_on_ground", "take_off"]


@compiled
def roll_on_ground(state: Floats, limits: Floats, rate: float, wx: float, wy: float) -> None:
    """Change the speed over ground by ``rate`` along the course on the ground."""
    dt = limits[STEP_S]
    ce, cn = sin(state[COURSE]), cos(state[COURSE])
    before = state[col.VELOCITY_X] * ce + state[col.VELOCITY_Y] * cn
    speed = max(before + rate * dt, 0.0)
    state[col.POSITION_X] += 0.5 * (before + speed) * dt * ce
    state[col.POSITION_Y] += 0.5 * (before + speed) * dt * cn
    state[col.POSITION_Z] = 0.0
    state[col.PATH_LENGTH] += 0.5 * (before + speed) * dt
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z] = (
        (speed - before) / dt * ce,
        (speed - before) / dt * cn,
        0.0,
    )
    state[col.VELOCITY_X], state[col.VELOCITY_Y], state[col.VELOCITY_Z] = speed * ce, speed * cn, 0.0
    state[col.HEADING], state[col.HEADING_RATE] = state[COURSE] % (2.0 * pi), 0.0
    state[AIRSPEED] = max(speed - wx * ce - wy * cn, 0.0)
    state[CLIMB] = state[BANK] = state[COMMAND] = state[PITCH] = 0.0


@compiled
def _lift_off(state: Floats, wx: float, wy: float) -> None:
    ae, an = state[col.VELOCITY_X] - wx, state[col.VELOCITY_Y] - wy
    state[AIRSPEED] = max(sqrt(ae * ae + an * an), SHORT)
    state[col.HEADING] = atan2(ae, an) % (2.0 * pi)
    state[NOSE_UP] = state[TRIMMED] = state[SINCE] = 0.0
    state[DOING] = FLYING


@compiled
def brake_rate(state: Floats, limits: Floats) -> float:
    """Return the deceleration on the ground after a landing."""
    braking = limits[BRAKING]
    if limits[GROUND_DRAG] > 0.0:
        v = state[AIRSPEED]
        braking += limits[GROUND_DRAG] * v + limits[PARASITIC] * v * v
    return float(braking)


@compiled
def take_off(state: Floats, limits: Floats, wx: float, wy: float) -> None:
    """Be thrown, or roll a step, and leave the ground when it is fast enough."""
    dt = limits[STEP_S]
    state[SINCE] += dt
    if state[SINCE] < limits[TAKEOFF_DELAY]:
        state[THROTTLE] = 0.0
        roll_on_ground(state, limits, 0.0, wx, wy)
        return
    throttle = limits[THROTTLE_LIMIT]
    if limits[THROTTLE_SLEW] > 0.0:
        throttle = min(throttle, state[THROTTLE] + limits[THROTTLE_SLEW] * dt)
    ramps = state[SINCE] < limits[RAMP_S]
    throttle *= limits[RAMP_THROTTLE] * (state[SINCE] / limits[RAMP_S] if ramps else 1.0)
    state[THROTTLE] = throttle
    rate = limits[LAUNCH] * throttle
    if limits[LAUNCH] <= 0.0:
        v = state[AIRSPEED]
        # It stands level until it lifts off: the drag is that of the lift at no angle of attack.
        load = limits[LIFT_LEVEL] * v * v / GRAVITY_M_S2
        rate = limits[THRUST] * throttle - drag(limits, v, load) - limits[GROUND_DRAG] * v
    roll_on_ground(state, limits, rate, wx, wy)
    if state[AIRSPEED] >= limits[ROTATION] and not ramps:
        _lift_off(state, wx, wy)
