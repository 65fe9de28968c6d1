"""Compiled airframe of a fixed wing: thrust and drag, motion in the air and on the ground.

Drag follows the parabolic polar, D = q S (CD0 + CL^2 / (pi e AR)), at the lift of the load factor (Anderson,
*Aircraft Performance and Design*, 1999, ch. 5), as in `sim_vehicle.energy.power`. Thrust is proportional to
throttle and independent of airspeed, as in the simulators of ArduPilot (``SIM_Plane.cpp``) and PX4
(``sih.cpp``).
"""

from __future__ import annotations

from math import asin, atan2, cos, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.stepping import take_velocity
from wbf_mission.addons.wings.motion.layout import FLARE, FLYING, NPFG, SHORT

CLIMB_LAG_S = 0.5
ROLL_RATE_S = 0.1
# Time constant with which the side force of a slip follows the turn rate.
SLIP_S = 0.7
STEEPEST = 0.8
SLOW_M_S = 3.0
FALL_M_S = 18.0
FALL_S = 2.0


@compiled(allocates=False)
def drag(limits: Record, airspeed: float, load: float) -> float:
    """Return drag divided by mass (m/s^2) at a lift of `load` times the weight."""
    v2 = max(airspeed, SLOW_M_S) ** 2
    return float(limits.parasitic * v2 + limits.induced * load * load / v2)


@compiled(allocates=False)
def energy_rate(limits: Record, throttle: float, airspeed: float, load: float) -> float:
    """Return the energy rate divided by weight (m/s): the climb rate at constant airspeed."""
    force = limits.thrust * throttle - drag(limits, airspeed, load)
    return float(force * airspeed / GRAVITY_M_S2)


@compiled(allocates=False)
def _roll(state: Record, limits: Record, bank: float) -> None:
    """Roll towards the commanded bank."""
    dt = limits.step_s
    change = limits.roll_slew * dt
    command = state.command + min(max(bank - state.command, -change), change)
    state.command = command
    most = limits.roll_rate_max
    rate = min(max((command - state.bank) / limits.roll_s, -most), most)
    if limits.law != NPFG:
        rate = state.roll_rate + (rate - state.roll_rate) * dt / (ROLL_RATE_S + dt)
        state.roll_rate = rate
    state.bank += rate * dt


@compiled(allocates=False)
def _trim(state: Record, limits: Record, lift: float, v: float) -> None:
    """Add the pitch error of an untrimmed elevator; the integral of pitch control then removes the error.

    The demanded pitch rate is the angle error divided by the time constant. This rate moves the elevator by
    ``FF s + P s^2``, and its integral by ``I s^2`` per second, where s is scaling speed / airspeed.
    """
    if state.trimmed == 0.0:
        state.trimmed = lift
    scale = limits.scaling_speed / v
    low = min(0.5, limits.scaling_speed / (2.0 * limits.airspeed_max))
    high = max(2.0, limits.scaling_speed / (0.7 * limits.airspeed_min))
    scale = min(max(scale, low), high)
    gain = max(scale * (limits.pitch_feed_forward + limits.pitch_gain * scale), 1e-3)
    missing = limits.trim_change * (lift - state.trimmed)
    share = limits.pitch_integrator * scale * scale / gain * limits.step_s
    state.nose_up = (state.nose_up - missing * limits.pitch_s / gain) / (1.0 + share)
    state.trimmed = lift


@compiled(allocates=False)
def pitch_up(state: Record, limits: Record, pitch: float) -> float:
    """Pitch towards the commanded angle, and return the climb rate of the resulting lift.

    Lift turns the path until the angle of attack carries the weight. If the lift changes, a stable airframe
    needs another elevator position. Until the integral of pitch control (``AP_PitchController.cpp``) provides
    this position, the demanded pitch rate provides it, which takes a pitch error.
    """
    dt = limits.step_s
    v = max(state.airspeed, SLOW_M_S)
    bank = state.bank
    path = asin(min(max(state.climb / v, -STEEPEST), STEEPEST))
    level = cos(bank)
    lift = GRAVITY_M_S2 * cos(path) / (level * v * v)
    if limits.trim_change > 0.0:
        _trim(state, limits, lift, v)
    rate = (pitch + state.nose_up - state.pitch) / limits.pitch_s
    rate = min(max(rate, -limits.pitch_down_rate), limits.pitch_up_rate)
    # The pitch rate that keeps the nose level in a coordinated turn is too high in a slipping turn.
    rate += (1.0 - limits.turn_share) * GRAVITY_M_S2 * tan(bank) * sin(bank) / v
    state.pitch += rate * cos(bank) * dt
    attack = (lift - limits.lift_level) / limits.lift_slope
    steady = state.pitch - min(attack, 0.5 * pi) * level
    lag = 1.0 / (limits.lift_slope * v)
    change = (steady - path) / (lag + dt)
    state.path_rate = change
    path += change * dt
    return float(v * min(max(sin(path), -STEEPEST), STEEPEST))


@compiled(allocates=False)
def fly(
    state: Record, limits: Record, bank: float, climb: float, rate: float, wx: float, wy: float, rising: float
) -> float:
    """Move one step through the air and return the load factor.

    `bank` and `climb` are commanded values, but for ArduPlane `climb` is the actual climb rate. `rate` is the
    energy rate divided by weight (m/s).
    """
    dt = limits.step_s
    _roll(state, limits, bank)
    bank = state.bank
    w = climb
    if limits.law == NPFG:
        change = limits.vertical_acceleration * dt
        w = state.climb + min(max((climb - state.climb) * dt / CLIMB_LAG_S, -change), change)
    v = max(state.airspeed, SHORT)
    v += (rate - w) * GRAVITY_M_S2 / v * dt
    v = max(v, SHORT)
    w = min(max(w, -STEEPEST * v), STEEPEST * v)
    forward = sqrt(v * v - w * w)
    # If the vehicle is banked, lift that bends the path upward also turns the path.
    lift = max(GRAVITY_M_S2 + v * state.path_rate, 0.0)
    # The side force of a slip grows as the slip builds up.
    against = 1.0 / limits.turn_share - 1.0
    turn = lift * tan(bank) / forward - against * state.slip
    state.slip += (turn - state.slip) * dt / SLIP_S
    middle = state.heading + 0.5 * turn * dt
    yaw = (state.heading + turn * dt) % (2.0 * pi)
    ve, vn, vz = forward * sin(yaw) + wx, forward * cos(yaw) + wy, w + rising
    east, north = (forward * sin(middle) + wx) * dt, (forward * cos(middle) + wy) * dt
    up = 0.5 * (state.velocity_z + vz) * dt
    state.position_x += east
    state.position_y += north
    state.position_z += up
    state.path_length += sqrt(east * east + north * north + up * up)
    take_velocity(state, ve, vn, vz, dt)
    state.heading, state.heading_rate = yaw, turn
    state.airspeed, state.climb = v, w
    load = 1.0 / cos(bank)
    if limits.law == NPFG:
        attack = (GRAVITY_M_S2 * load / max(v * v, 1.0) - limits.lift_level) / limits.lift_slope
        state.pitch = atan2(w, forward) + min(attack, 0.5)
    return load


@compiled(allocates=False)
def drop(state: Record, limits: Record, wx: float, wy: float) -> None:
    """Let the vehicle fall for one time step, at most at the final speed."""
    dt = limits.step_s
    keep = 1.0 - dt / FALL_S
    ve, vn = wx + (state.velocity_x - wx) * keep, wy + (state.velocity_y - wy) * keep
    vz = max(state.velocity_z - GRAVITY_M_S2 * dt, -FALL_M_S)
    state.position_x += ve * dt
    state.position_y += vn * dt
    state.position_z = max(state.position_z + vz * dt, 0.0)
    state.path_length += sqrt(ve * ve + vn * vn + vz * vz) * dt
    take_velocity(state, ve, vn, vz, dt)
    state.heading_rate = 2.0
    state.heading = (state.heading + 2.0 * dt) % (2.0 * pi)
    state.airspeed = sqrt((ve - wx) ** 2 + (vn - wy) ** 2 + vz * vz)
    state.climb = vz


@compiled(allocates=False)
def blow(state: Record, wx: float, wy: float, rising: float) -> None:
    """Change the wind: the ground velocity stays the same, and the air velocity changes."""
    if state.doing == FLYING or state.doing == FLARE:
        ae, an, up = state.velocity_x - wx, state.velocity_y - wy, state.velocity_z - rising
        state.airspeed = max(sqrt(ae * ae + an * an + up * up), SHORT)
        state.climb = up
        state.heading = atan2(ae, an) % (2.0 * pi)


@compiled(allocates=False)
def roll_on_ground(state: Record, limits: Record, rate: float, wx: float, wy: float) -> None:
    """Change the ground speed along the course by ``rate`` for one step."""
    dt = limits.step_s
    ce, cn = sin(state.course), cos(state.course)
    before = state.velocity_x * ce + state.velocity_y * cn
    speed = max(before + rate * dt, 0.0)
    way, gain = 0.5 * (before + speed) * dt, (speed - before) / dt
    state.position_x += way * ce
    state.position_y += way * cn
    state.position_z = 0.0
    state.path_length += way
    state.acceleration_x, state.acceleration_y, state.acceleration_z = gain * ce, gain * cn, 0.0
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
    """Return the deceleration on the ground after landing."""
    braking = limits.braking
    if limits.ground_drag > 0.0:
        v = state.airspeed
        braking += limits.ground_drag * v + limits.parasitic * v * v
    return float(braking)


@compiled(allocates=False)
def take_off(state: Record, limits: Record, wx: float, wy: float) -> None:
    """Move one step of a take-off, by throw or ground roll, and lift off at the rotation airspeed."""
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
        # On the ground the vehicle is level, so drag is computed for an angle of attack of 0.
        load = limits.lift_level * v * v / GRAVITY_M_S2
        rate = limits.thrust * throttle - drag(limits, v, load) - limits.ground_drag * v
    roll_on_ground(state, limits, rate, wx, wy)
    if state.airspeed >= limits.rotation and not ramps:
        _lift_off(state, wx, wy)
