"""PX4's heights, airspeeds and banks of a fixed wing, compiled: total energy control, approach, flare."""

from __future__ import annotations

from math import atan, cos, isnan, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing.forces import energy_rate
from sim_vehicle.motion.fixed_wing.guidance import Floats
from sim_vehicle.motion.fixed_wing.layout import (
    AIRSPEED,
    AIRSPEED_MIN,
    BANK,
    BANK_LIMIT,
    BEARING,
    BEGIN,
    CENTRE,
    CIRCULAR_LANDING,
    CLIMB_MAX,
    CLIMB_RATE,
    DOING,
    FLARE,
    FLARE_HEIGHT,
    FLARE_RATE,
    FLARE_S,
    FLARE_SINK,
    HEIGHT_AHEAD,
    HEIGHT_S,
    LANDING,
    LANDING_AIRSPEED,
    LEG_KIND,
    LEG_ON_CIRCLE,
    LEG_SLOPE,
    LEG_X,
    LEG_Y,
    LEG_Z,
    LEVEL_BANK,
    LEVEL_HEIGHT,
    LEVEL_THROTTLE,
    LINE,
    LOITER_RADIUS,
    REFERENCE,
    REFERENCE_RATE,
    ROTATION_S,
    RUNNING,
    SHORT,
    SINCE,
    SINK_MAX,
    SINK_MIN,
    SINK_RATE,
    SLOPE,
    SPEED_S,
    STEP_S,
    TAKEOFF,
    TARGET,
    THROTTLE,
    THROTTLE_INTEGRAL,
    THROTTLE_LIMIT,
    TOTAL_DAMPING,
    TOTAL_FOR_LOAD,
    TOTAL_INTEGRATOR,
    TOTAL_RATE,
    TOTAL_S,
    VERTICAL_ACCELERATION,
    WING_SPAN,
)
from sim_vehicle.motion.fixed_wing.steering import circles, leg_airspeed, steer

__all__ = ["px4_control"]

THROTTLE_S = 0.4


@compiled
def _near_ground(state: Floats, limits: Floats, level: bool) -> float:
    """Return the bank limit: a wing tip must not touch the ground, and some keep level while they climb."""
    bank = limits[BANK_LIMIT]
    height = state[col.POSITION_Z]
    if level and height < limits[LEVEL_HEIGHT]:
        bank = min(bank, limits[LEVEL_BANK])
    tip = atan(max(2.0 * height, 0.0) / limits[WING_SPAN])
    return float(min(bank, max(tip, 0.09)))


@compiled
def _climb(state: Floats, limits: Floats, height: float, full: bool) -> float:
    """Return the climb rate for a height, which is followed at limited rates (``TECSReferenceModel``)."""
    here, dt = state[col.POSITION_Z], limits[STEP_S]
    if state[RUNNING] == 0.0:
        state[RUNNING], state[REFERENCE_RATE] = 1.0, 0.0
        state[REFERENCE], state[THROTTLE_INTEGRAL], state[TOTAL_RATE] = here, 0.0, 0.0
    if full or state[DOING] == FLARE:
        state[REFERENCE], state[REFERENCE_RATE] = here, state[col.VELOCITY_Z]
    else:
        gap, most = height - state[REFERENCE], limits[VERTICAL_ACCELERATION]
        rate = sqrt(2.0 * most * abs(gap))
        rate = min(rate, limits[CLIMB_RATE]) if gap > 0.0 else -min(rate, limits[SINK_RATE])
        state[REFERENCE_RATE] += min(max(rate - state[REFERENCE_RATE], -most * dt), most * dt)
        state[REFERENCE] += state[REFERENCE_RATE] * dt
    climb = (state[REFERENCE] - here) / limits[HEIGHT_S] + limits[HEIGHT_AHEAD] * state[REFERENCE_RATE]
    return float(min(max(climb, -limits[SINK_MAX]), limits[CLIMB_MAX]))


@compiled
def _height_along(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the height along a leg: that of the waypoint is reached a circle's radius before it."""
    dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
    gx, gy = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
    before = abs(limits[LOITER_RADIUS])
    way = sqrt(dx * dx + dy * dy) - before
    if state[SLOPE] == 0.0 or way <= 0.0:
        return float(row[LEG_Z])
    left = (sqrt(gx * gx + gy * gy) - before) / way
    return float(row[LEG_Z] - state[SLOPE] * min(max(left, 0.0), 1.0))


@compiled
def _throttle(state: Floats, limits: Floats, asked: float, load: float) -> float:
    """Return the throttle for an energy rate over the weight (``TECSControl::_calcThrottleControl``).

    It is what parameters tell that the rate takes, and an integral of what is missing, slow by default: a
    motor or a drag that they do not describe leaves the airspeed off for a minute.
    """
    most, least = limits[CLIMB_MAX], -limits[SINK_MIN]
    asked = min(max(asked + limits[TOTAL_FOR_LOAD] * (load - 1.0) / GRAVITY_M_S2, least), most)
    level = limits[LEVEL_THROTTLE]
    predicted = level + (asked / most * (1.0 - level) if asked >= 0.0 else -asked / least * level)
    missing = (asked - state[TOTAL_RATE]) / (most - least)
    change = limits[TOTAL_INTEGRATOR] * missing * limits[STEP_S]
    throttle = predicted + limits[TOTAL_DAMPING] * missing + state[THROTTLE_INTEGRAL]
    if throttle >= limits[THROTTLE_LIMIT]:
        change = min(change, 0.0)
    elif throttle <= 0.0:
        change = max(change, 0.0)
    state[THROTTLE_INTEGRAL] += change
    return float(min(max(throttle, 0.0), limits[THROTTLE_LIMIT]))


@compiled
def _energy(
    state: Floats, limits: Floats, height: float, airspeed: float, load: float, full: bool
) -> tuple[float, float, float]:
    """Return throttle, climb rate and energy rate (over the weight) that total energy control asks for.

    The sum of the wanted rates of height and speed decides the throttle (`_throttle`), their difference the
    pitch; what the throttle cannot give is shared.
    """
    v = max(state[AIRSPEED], SHORT)
    climb = _climb(state, limits, height, full)
    # Rates of the kinetic energy over the weight.
    fast = (airspeed - v) / limits[SPEED_S] * v / GRAVITY_M_S2
    fast = min(max(fast, -0.5 * limits[SINK_MIN]), 0.5 * limits[CLIMB_MAX])
    rate = energy_rate(limits, state[THROTTLE], v, load)
    dt = limits[STEP_S]
    state[TOTAL_RATE] += (rate - state[TOTAL_RATE]) * dt / (limits[TOTAL_S] + dt)
    if full:
        throttle = limits[THROTTLE_LIMIT]
        climb = limits[CLIMB_MAX]
    else:
        throttle = _throttle(state, limits, climb + fast, load)
    # Where it climbs out, is too slow or has no power, the speed is held first and what is left climbs.
    least_speed = min(limits[AIRSPEED_MIN], limits[LANDING_AIRSPEED])
    slow = min(max(10.0 * (1.0 - v / least_speed), 0.0), 1.0)
    if full or limits[THROTTLE_LIMIT] == 0.0:
        slow = 1.0
    climb = (1.0 - slow) * 0.5 * (rate + climb - fast) + slow * (rate - fast)
    return throttle, min(max(climb, -limits[SINK_MAX]), limits[CLIMB_MAX]), rate


@compiled
def _approach(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the height to aim at on the way down to a landing; begin the flare."""
    ground = sqrt(
        state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
    )
    if row[LEG_KIND] == LANDING:
        dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
        length = max(sqrt(dx * dx + dy * dy), 1e-3)
        to_go = (
            (row[LEG_X] - state[col.POSITION_X]) * dx + (row[LEG_Y] - state[col.POSITION_Y]) * dy
        ) / length
        slope = max(state[BEGIN + 2], 1.0) / length
        # It goes on below the ground, so that nothing is slowed down before the flare.
        height = min(slope * to_go, max(state[BEGIN + 2], 0.0))
    else:
        # A circle down: so much lower than it is that it follows at the rate of its slope.
        height = state[col.POSITION_Z] - row[LEG_SLOPE] * ground * limits[HEIGHT_S]
    if state[col.POSITION_Z] <= max(limits[FLARE_HEIGHT], limits[FLARE_S] * max(-state[col.VELOCITY_Z], 0.0)):
        state[DOING] = FLARE
        state[SINCE] = 0.0
        state[FLARE_RATE] = state[col.VELOCITY_Z]
    return float(height)


@compiled
def px4_control(
    state: Floats, row: Floats, arrived: bool, limits: Floats, wx: float, wy: float
) -> tuple[float, float, float]:
    """Move the throttle as PX4 does; return bank and climb that it commands, and the energy rate."""
    kind = row[LEG_KIND]
    landing = kind in (LANDING, CIRCULAR_LANDING)
    circling = circles(state, row, arrived)
    lateral, be, bn = steer(state, row, arrived, limits, wx, wy)
    rolls = _near_ground(state, limits, kind == TAKEOFF)
    if state[DOING] == FLARE:
        rolls = min(rolls, 0.09)
    bank = min(max(atan(lateral / GRAVITY_M_S2), -rolls), rolls)
    airspeed = leg_airspeed(row, arrived, limits, be, bn, wx, wy)
    load = 1.0 / cos(state[BANK])
    full = kind == TAKEOFF and not arrived
    height = state[CENTRE + 2] if arrived and not landing else row[LEG_Z]
    if full:
        height = row[LEG_Z] + 10.0 * limits[HEIGHT_S]
    elif landing:
        height = _approach(state, row, limits)
    elif row[LEG_ON_CIRCLE] > 0.0 and not arrived and isnan(state[BEARING]):
        height = state[TARGET]
    elif kind == LINE and not circling:
        height = _height_along(state, row, limits)
    if state[DOING] == FLARE:
        throttle, _, rate = _energy(state, limits, height, airspeed, load, False)
        # First the throttle comes down, then the sink dies away towards that of the touch.
        state[SINCE] += limits[STEP_S]
        passed = state[SINCE] / limits[FLARE_S]
        throttle = min(throttle, 1.0 - sqrt(min(passed, 1.0)))
        # On a circle both at once.
        waits = 1.0 if kind == LANDING else 0.0
        share = sqrt(min(max(passed - waits, 0.0), 1.0))
        climb = (1.0 - share) * state[FLARE_RATE] - share * limits[FLARE_SINK]
    else:
        throttle, climb, rate = _energy(state, limits, height, airspeed, load, full)
        if full:
            state[SINCE] += limits[STEP_S]
            if state[SINCE] < limits[ROTATION_S]:
                climb *= state[SINCE] / limits[ROTATION_S]
    state[THROTTLE] += (throttle - state[THROTTLE]) * limits[STEP_S] / THROTTLE_S
    return bank, climb, rate
