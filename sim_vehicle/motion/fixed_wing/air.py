"""A fixed wing in the air, compiled: roll, pitch and a step of coordinated flight."""

from __future__ import annotations

from math import asin, atan2, cos, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing.guidance import NPFG, Floats
from sim_vehicle.motion.fixed_wing.layout import (
    AIRSPEED,
    AIRSPEED_MAX,
    AIRSPEED_MIN,
    BANK,
    CLIMB,
    COMMAND,
    DOING,
    FLARE,
    FLYING,
    LAW,
    LIFT_LEVEL,
    LIFT_SLOPE,
    NOSE_UP,
    PATH_RATE,
    PITCH,
    PITCH_DOWN_RATE,
    PITCH_FEED_FORWARD,
    PITCH_GAIN,
    PITCH_INTEGRATOR,
    PITCH_S,
    PITCH_UP_RATE,
    ROLL_RATE,
    ROLL_RATE_MAX,
    ROLL_S,
    ROLL_SLEW,
    SCALING_SPEED,
    SHORT,
    SLIP,
    STEP_S,
    TRIM_CHANGE,
    TRIMMED,
    TURN_SHARE,
    VERTICAL_ACCELERATION,
)

__all__ = ["blow", "drop", "fly", "pitch_up"]

CLIMB_LAG_S = 0.5
ROLL_RATE_S = 0.1
# How fast the side force of a slip follows the rate of a turn.
SLIP_S = 0.7
STEEPEST = 0.8
SLOW_M_S = 3.0
FALL_M_S = 18.0
FALL_S = 2.0


@compiled
def _roll(state: Floats, limits: Floats, bank: float) -> None:
    """Roll towards a commanded bank."""
    dt = limits[STEP_S]
    change = limits[ROLL_SLEW] * dt
    command = state[COMMAND] + min(max(bank - state[COMMAND], -change), change)
    state[COMMAND] = command
    most = limits[ROLL_RATE_MAX]
    rate = min(max((command - state[BANK]) / limits[ROLL_S], -most), most)
    if limits[LAW] != NPFG:
        rate = state[ROLL_RATE] + (rate - state[ROLL_RATE]) * dt / (ROLL_RATE_S + dt)
        state[ROLL_RATE] = rate
    state[BANK] += rate * dt


@compiled
def _trim(state: Floats, limits: Floats, lift: float, v: float) -> None:
    """Let the elevator that is missing for the lift tip the nose, and the integral take it over.

    A demanded rate, which is the error of the angle over the time constant, moves the elevator by
    ``FF s + P s^2``, its integral by ``I s^2`` a second, where s is the scaling speed over the airspeed.
    """
    if state[TRIMMED] == 0.0:
        state[TRIMMED] = lift
    scale = limits[SCALING_SPEED] / v
    low = min(0.5, limits[SCALING_SPEED] / (2.0 * limits[AIRSPEED_MAX]))
    high = max(2.0, limits[SCALING_SPEED] / (0.7 * limits[AIRSPEED_MIN]))
    scale = min(max(scale, low), high)
    gain = max(scale * (limits[PITCH_FEED_FORWARD] + limits[PITCH_GAIN] * scale), 1e-3)
    missing = limits[TRIM_CHANGE] * (lift - state[TRIMMED])
    share = limits[PITCH_INTEGRATOR] * scale * scale / gain * limits[STEP_S]
    state[NOSE_UP] = (state[NOSE_UP] - missing * limits[PITCH_S] / gain) / (1.0 + share)
    state[TRIMMED] = lift


@compiled
def pitch_up(state: Floats, limits: Floats, pitch: float) -> float:
    """Pitch towards a commanded angle and return the climb rate that the lift then gives.

    The wing's lift turns the path until the angle of attack is that at which it carries the weight. A stable
    airframe needs another elevator for another lift; until the integral of the pitch control
    (``AP_PitchController.cpp``) gives that, the angle settles where the demanded rate gives it.
    """
    dt = limits[STEP_S]
    v = max(state[AIRSPEED], SLOW_M_S)
    bank = state[BANK]
    path = asin(min(max(state[CLIMB] / v, -STEEPEST), STEEPEST))
    level = cos(bank)
    lift = GRAVITY_M_S2 * cos(path) / (level * v * v)
    if limits[TRIM_CHANGE] > 0.0:
        _trim(state, limits, lift, v)
    rate = (pitch + state[NOSE_UP] - state[PITCH]) / limits[PITCH_S]
    rate = min(max(rate, -limits[PITCH_DOWN_RATE]), limits[PITCH_UP_RATE])
    # The rate that would keep the nose level in a coordinated turn is too much for one that slips.
    rate += (1.0 - limits[TURN_SHARE]) * GRAVITY_M_S2 * tan(bank) * sin(bank) / v
    state[PITCH] += rate * cos(bank) * dt
    attack = (lift - limits[LIFT_LEVEL]) / limits[LIFT_SLOPE]
    steady = state[PITCH] - min(attack, 0.5 * pi) * level
    lag = 1.0 / (limits[LIFT_SLOPE] * v)
    change = (steady - path) / (lag + dt)
    state[PATH_RATE] = change
    path += change * dt
    return float(v * min(max(sin(path), -STEEPEST), STEEPEST))


@compiled
def fly(
    state: Floats, limits: Floats, bank: float, climb: float, rate: float, wx: float, wy: float, rising: float
) -> float:
    """Move a step through the air and return the load factor.

    Parameters
    ----------
    bank, climb : float
        What is commanded; ArduPlane's is the climb rate that there is.
    rate : float
        Gain of energy over the weight, m/s.
    wx, wy, rising : float
        Wind.
    """
    dt = limits[STEP_S]
    _roll(state, limits, bank)
    bank = state[BANK]
    w = climb
    if limits[LAW] == NPFG:
        change = limits[VERTICAL_ACCELERATION] * dt
        w = state[CLIMB] + min(max((climb - state[CLIMB]) * dt / CLIMB_LAG_S, -change), change)
    v = max(state[AIRSPEED], SHORT)
    v += (rate - w) * GRAVITY_M_S2 / v * dt
    v = max(v, SHORT)
    w = min(max(w, -STEEPEST * v), STEEPEST * v)
    forward = sqrt(v * v - w * w)
    # The lift that bends the path upward turns it as well.
    lift = max(GRAVITY_M_S2 + v * state[PATH_RATE], 0.0)
    # The side force of the slip takes its share once the slip has built up.
    against = 1.0 / limits[TURN_SHARE] - 1.0
    turn = lift * tan(bank) / forward - against * state[SLIP]
    state[SLIP] += (turn - state[SLIP]) * dt / SLIP_S
    middle = state[col.HEADING] + 0.5 * turn * dt
    yaw = (state[col.HEADING] + turn * dt) % (2.0 * pi)
    ve, vn, vz = forward * sin(yaw) + wx, forward * cos(yaw) + wy, w + rising
    east, north = (forward * sin(middle) + wx) * dt, (forward * cos(middle) + wy) * dt
    up = 0.5 * (state[col.VELOCITY_Z] + vz) * dt
    state[col.POSITION_X] += east
    state[col.POSITION_Y] += north
    state[col.POSITION_Z] += up
    state[col.PATH_LENGTH] += sqrt(east * east + north * north + up * up)
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z] = (
        (ve - state[col.VELOCITY_X]) / dt,
        (vn - state[col.VELOCITY_Y]) / dt,
        (vz - state[col.VELOCITY_Z]) / dt,
    )
    state[col.VELOCITY_X], state[col.VELOCITY_Y], state[col.VELOCITY_Z] = ve, vn, vz
    state[col.HEADING], state[col.HEADING_RATE] = yaw, turn
    state[AIRSPEED], state[CLIMB] = v, w
    load = 1.0 / cos(bank)
    if limits[LAW] == NPFG:
        attack = (GRAVITY_M_S2 * load / max(v * v, 1.0) - limits[LIFT_LEVEL]) / limits[LIFT_SLOPE]
        state[PITCH] = atan2(w, forward) + min(attack, 0.5)
    return load


@compiled
def drop(state: Floats, limits: Floats, wx: float, wy: float) -> None:
    """Fall a step."""
    dt = limits[STEP_S]
    keep = 1.0 - dt / FALL_S
    ve, vn = wx + (state[col.VELOCITY_X] - wx) * keep, wy + (state[col.VELOCITY_Y] - wy) * keep
    vz = max(state[col.VELOCITY_Z] - GRAVITY_M_S2 * dt, -FALL_M_S)
    state[col.POSITION_X] += ve * dt
    state[col.POSITION_Y] += vn * dt
    state[col.POSITION_Z] = max(state[col.POSITION_Z] + vz * dt, 0.0)
    state[col.PATH_LENGTH] += sqrt(ve * ve + vn * vn + vz * vz) * dt
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z] = (
        (ve - state[col.VELOCITY_X]) / dt,
        (vn - state[col.VELOCITY_Y]) / dt,
        (vz - state[col.VELOCITY_Z]) / dt,
    )
    state[col.VELOCITY_X], state[col.VELOCITY_Y], state[col.VELOCITY_Z] = ve, vn, vz
    state[col.HEADING_RATE] = 2.0
    state[col.HEADING] = (state[col.HEADING] + 2.0 * dt) % (2.0 * pi)
    state[AIRSPEED] = sqrt((ve - wx) ** 2 + (vn - wy) ** 2 + vz * vz)
    state[CLIMB] = vz


@compiled
def blow(state: Floats, wx: float, wy: float, rising: float) -> None:
    """Change the wind: the velocity over ground stays, that through the air changes."""
    if state[DOING] == FLYING or state[DOING] == FLARE:
        ae, an, up = state[col.VELOCITY_X] - wx, state[col.VELOCITY_Y] - wy, state[col.VELOCITY_Z] - rising
        state[AIRSPEED] = max(sqrt(ae * ae + an * an + up * up), SHORT)
        state[CLIMB] = up
        state[col.HEADING] = atan2(ae, an) % (2.0 * pi)
