"""PX4's heights, airspeeds and banks of a fixed wing, compiled: total energy control, approach, flare."""

from __future__ import annotations

from math import atan, cos, isnan, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing.forces import energy_rate, energy_rates
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
    LINE,
    ROTATION_S,
    SHORT,
    SINCE,
    SINK_MAX,
    SINK_RATE,
    SPEED_S,
    STEP_S,
    TAKEOFF,
    TARGET,
    THROTTLE,
    THROTTLE_LIMIT,
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
def _energy(
    state: Floats, limits: Floats, height: float, airspeed: float, load: float, full: bool
) -> tuple[float, float, float]:
    """Return throttle, climb rate and energy rate (over the weight) that total energy control asks for.

    The sum of the wanted rates of height and speed decides the throttle, their difference the pitch; what the
    throttle cannot give is shared.
    """
    v = max(state[AIRSPEED], SHORT)
    least, most = energy_rates(limits, v, load)
    climb = (height - state[col.POSITION_Z]) / limits[HEIGHT_S]
    climb = min(max(climb, -limits[SINK_RATE]), limits[CLIMB_RATE])
    # Rates of the kinetic energy over the weight.
    fast = (airspeed - v) / limits[SPEED_S] * v / GRAVITY_M_S2
    fast = min(max(fast, 0.5 * min(least, -0.2)), 0.5 * max(most, 0.2))
    if full:
        throttle = limits[THROTTLE_LIMIT]
        climb = limits[CLIMB_MAX]
    else:
        throttle = min(max((climb + fast - least) / max(most - least, 0.1), 0.0), limits[THROTTLE_LIMIT])
    rate = energy_rate(limits, state[THROTTLE], v, load)
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
    sink = 0.0
    if row[LEG_KIND] == LANDING:
        dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
        length = max(sqrt(dx * dx + dy * dy), 1e-3)
        to_go = (
            (row[LEG_X] - state[col.POSITION_X]) * dx + (row[LEG_Y] - state[col.POSITION_Y]) * dy
        ) / length
        slope = max(state[BEGIN + 2], 1.0) / length
        # It goes on below the ground, so that nothing is slowed down before the flare.
        height = min(slope * to_go, max(state[BEGIN + 2], 0.0))
        if to_go < length:
            sink = slope * ground
    else:
        sink = row[LEG_SLOPE] * ground
        height = state[col.POSITION_Z]
    if state[col.POSITION_Z] <= max(limits[FLARE_HEIGHT], limits[FLARE_S] * max(-state[col.VELOCITY_Z], 0.0)):
        state[DOING] = FLARE
        state[SINCE] = 0.0
        state[FLARE_RATE] = state[col.VELOCITY_Z]
    # Only so much of the slope's rate is fed forward: the rest is asked for by being too high.
    return float(height - sink * limits[HEIGHT_S] * limits[HEIGHT_AHEAD])


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
        dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
        length2 = dx * dx + dy * dy
        if length2 > 1.0:
            part = (
                (state[col.POSITION_X] - state[BEGIN]) * dx + (state[col.POSITION_Y] - state[BEGIN + 1]) * dy
            ) / length2
            rise = row[LEG_Z] - state[BEGIN + 2]
            height = state[BEGIN + 2] + rise * min(max(part, 0.0), 1.0)
            if 0.0 < part < 1.0:
                along = (state[col.VELOCITY_X] * dx + state[col.VELOCITY_Y] * dy) / length2
                height += rise * along * limits[HEIGHT_S] * limits[HEIGHT_AHEAD]
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
