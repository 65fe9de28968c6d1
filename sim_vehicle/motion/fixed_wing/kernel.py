"""The compiled motion of one fixed wing: coordinated turns, energy, guidance along the legs of a route.

The model is described in docs/fixed-wing-and-rover.md. Lengths in metres, angles in radians, east-north-up
about home, headings clockwise from north, banks and accelerations to the right positive. One vehicle is a row
of `STATE` numbers and a row of `COUNTERS` integers, as in `sim_vehicle.motion.multirotor.kernel`, whose
first 19 numbers and whose counters it has.
"""

from __future__ import annotations

from math import asin, atan, atan2, cos, inf, isnan, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.energy.power_kernels import fixed_wing_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing import arduplane
from sim_vehicle.motion.fixed_wing.forces import drag, energy_rate, energy_rates
from sim_vehicle.motion.fixed_wing.guidance import (
    NPFG,
    Floats,
    l1_circle,
    l1_distance,
    l1_line,
    npfg,
    switch_distance,
)
from sim_vehicle.motion.fixed_wing.layout import (
    ACCEPTANCE,
    AIRSPEED,
    AIRSPEED_MAX,
    AIRSPEED_MIN,
    AIRSPEED_TRIM,
    BANK,
    BANK_DEMAND,
    BANK_LIMIT,
    BEARING,
    BEGIN,
    BRAKING,
    CENTRE,
    CENTRE_RADIUS,
    CIRCLE,
    CIRCULAR_LANDING,
    CLIMB,
    CLIMB_MAX,
    CLIMB_RATE,
    COMMAND,
    COURSE,
    DAMPING,
    DIRECT,
    DOING,
    ENERGY_LIMIT,
    FALL,
    FLARE,
    FLARE_HEIGHT,
    FLARE_S,
    FLARE_SINK,
    FLYING,
    GROUND_DRAG,
    GROUND_MIN,
    GUIDANCE,
    HEIGHT_S,
    INTEGRAL,
    LANDING,
    LANDING_AIRSPEED,
    LAUNCH,
    LAW,
    LEG_AIRSPEED,
    LEG_CIRCLE_RADIUS,
    LEG_EXIT_X,
    LEG_EXIT_Y,
    LEG_HEIGHT_TOLERANCE,
    LEG_KIND,
    LEG_NEAR,
    LEG_PAUSE,
    LEG_RADIUS,
    LEG_SLOPE,
    LEG_TURN_ANGLE,
    LEG_TURNS,
    LEG_X,
    LEG_Y,
    LEG_Z,
    LEVEL_BANK,
    LEVEL_HEIGHT,
    LIFT_LEVEL,
    LIFT_SLOPE,
    LINE,
    LOITER_RADIUS,
    NOSE_UP,
    ON_GROUND,
    PARASITIC,
    PATH_RATE,
    PAUSE_END,
    PERIOD,
    PITCH,
    PITCH_DEMAND,
    PITCH_DOWN_RATE,
    PITCH_S,
    PITCH_UP_RATE,
    ROLL_RATE,
    ROLL_RATE_MAX,
    ROLL_S,
    ROLL_SLEW,
    ROLLING,
    ROTATION,
    RUNNING,
    SINCE,
    SINK_MAX,
    SINK_RATE,
    SLIP,
    SPEED_S,
    STEP_S,
    STOPPED_M_S,
    SWITCH_SHARE,
    TAKEOFF,
    TAKEOFF_AIRSPEED,
    TAKEOFF_DELAY,
    THROTTLE,
    THROTTLE_DEMAND,
    THROTTLE_LIMIT,
    THROTTLE_SLEW,
    THRUST,
    TURN_SHARE,
    TURNED,
    VERTICAL_ACCELERATION,
    WIND_UP,
    WING_SPAN,
)
from sim_vehicle.motion.fixed_wing.tecs import PERIOD_S
from sim_vehicle.motion.multirotor.kernel import Integers
from sim_vehicle.motion.rows import copy
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

__all__ = ["advance"]

CLIMB_LAG_S = 0.5
ROLL_RATE_S = 0.1
# How fast the side force of a slip follows the rate of a turn.
SLIP_S = 0.7
# While a take-off roll holds the nose down, the integral of the pitch control winds up.
NOSE_UP_RAD, NOSE_UP_S = 0.04, 10.0
THROTTLE_S = 0.4
STEEPEST = 0.8
SLOW_M_S = 3.0
SHORT = 0.5
ALIGNED = 0.985
FALL_M_S = 18.0
FALL_S = 2.0
AHEAD_OF_LANDING_M = 200.0
# A leg is given up when it takes longer than this and three times what it takes at a slow speed.
PATIENCE_S = 120.0
SLOW_SHARE = 0.15


@compiled
def _patience_steps(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the number of steps that a leg may take."""
    east, north = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
    way = sqrt(east * east + north * north)
    trim = limits[AIRSPEED_TRIM]
    seconds = (
        PATIENCE_S
        + way / (SLOW_SHARE * trim)
        + abs(row[LEG_Z] - state[col.POSITION_Z]) / 0.2
        + 2.0 * row[LEG_PAUSE]
    )
    seconds += (row[LEG_TURNS] + 2.0) * 2.0 * pi * abs(row[LEG_CIRCLE_RADIUS]) / (0.2 * trim)
    return float(seconds / limits[STEP_S])


@compiled
def _steer_line(
    state: Floats, row: Floats, limits: Floats, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration along a leg, and its bearing."""
    ve, vn = state[col.VELOCITY_X], state[col.VELOCITY_Y]
    period, damping = limits[PERIOD], limits[DAMPING]
    dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
    length = sqrt(dx * dx + dy * dy)
    rx, ry = state[col.POSITION_X] - state[BEGIN], state[col.POSITION_Y] - state[BEGIN + 1]
    goal_x, goal_y = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
    if limits[LAW] != NPFG:
        if length < SHORT or state[DIRECT] > 0.0:
            dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
            if length < 1e-6:
                dx, dy, length = sin(state[col.HEADING]), cos(state[col.HEADING]), 1.0
        if row[LEG_KIND] == LANDING:
            # Past the landing point it keeps the line.
            te, tn = dx / length, dy / length
            far = length + sqrt(rx * rx + ry * ry) + AHEAD_OF_LANDING_M
            return l1_line(
                rx, ry, te, tn, far, ve, vn, period, damping, limits[INTEGRAL], PERIOD_S, state,
                GUIDANCE,
            )  # fmt: skip
        return l1_line(
            rx, ry, dx / length, dy / length, length, ve, vn, period, damping, limits[INTEGRAL],
            PERIOD_S, state, GUIDANCE,
        )  # fmt: skip
    ground = sqrt(ve * ve + vn * vn)
    if length >= SHORT and row[LEG_KIND] != TAKEOFF:
        behind = dx * rx + dy * ry < 0.0
        near = switch_distance(ground, period, damping, limits[SWITCH_SHARE])
        if behind and rx * rx + ry * ry > near * near:
            dx, dy, length = -rx, -ry, sqrt(rx * rx + ry * ry)
            rx = ry = 0.0
        elif (
            row[LEG_KIND] == LINE
            and (state[col.POSITION_X] - row[LEG_X]) * dx + (state[col.POSITION_Y] - row[LEG_Y]) * dy > 0.0
        ):
            length = 0.0
    if length < SHORT:
        dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
        if length < 1e-6:
            dx, dy, length = sin(state[col.HEADING]), cos(state[col.HEADING]), 1.0
    te, tn = dx / length, dy / length
    return npfg(rx * tn - ry * te, te, tn, 0.0, ve, vn, wx, wy, period, damping)


@compiled
def _steer_circle(
    state: Floats, x: float, y: float, radius: float, limits: Floats, wx: float, wy: float
) -> float:
    """Return the lateral acceleration to follow a circle."""
    ve, vn = state[col.VELOCITY_X], state[col.VELOCITY_Y]
    rx, ry = state[col.POSITION_X] - x, state[col.POSITION_Y] - y
    sense = 1.0 if radius > 0.0 else -1.0
    radius = abs(radius)
    period, damping = limits[PERIOD], limits[DAMPING]
    if limits[LAW] != NPFG:
        return l1_circle(rx, ry, radius, sense, ve, vn, period, damping, state, GUIDANCE)
    away = sqrt(rx * rx + ry * ry)
    if away > 0.1:
        oe, on = rx / away, ry / away
    else:
        ground = max(sqrt(ve * ve + vn * vn), 1e-3)
        oe, on = ve / ground, vn / ground
    # Clockwise is the outward direction turned to the right.
    te, tn = sense * on, -sense * oe
    error = sense * (radius - away)
    lateral, _, _ = npfg(error, te, tn, sense / radius, ve, vn, wx, wy, period, damping)
    return lateral


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
def _acceptance(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the distance at which a waypoint counts as reached."""
    ground = sqrt(
        state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
    )
    if limits[LAW] == NPFG:
        return float(limits[ACCEPTANCE])
    if row[LEG_RADIUS] > 0.0:
        return float(row[LEG_RADIUS])
    near = min(limits[ACCEPTANCE], l1_distance(ground, limits[PERIOD], limits[DAMPING]))
    return float(near * min(row[LEG_TURN_ANGLE] / (0.5 * pi), 1.0))


@compiled
def _circled(state: Floats, row: Floats, limits: Floats, step: int) -> bool:
    """Keep count on a circle and tell whether it may be left."""
    rx, ry = state[col.POSITION_X] - row[LEG_X], state[col.POSITION_Y] - row[LEG_Y]
    away = sqrt(rx * rx + ry * ry)
    radius = abs(row[LEG_CIRCLE_RADIUS])
    sense = 1.0 if row[LEG_CIRCLE_RADIUS] > 0.0 else -1.0
    if isnan(state[BEARING]):
        ground = sqrt(
            state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
        )
        room = radius + min(limits[ACCEPTANCE], 0.5 * radius)
        if limits[LAW] == NPFG:
            near = switch_distance(ground, limits[PERIOD], limits[DAMPING], limits[SWITCH_SHARE])
            room = radius + max(limits[ACCEPTANCE], near)
        # An airspeed that is too high for the circle leads round it outside.
        tight = ground * ground / (GRAVITY_M_S2 * tan(limits[BANK_LIMIT]))
        room = max(room, 2.2 * tight)
        if away > room or abs(row[LEG_Z] - state[col.POSITION_Z]) > row[LEG_HEIGHT_TOLERANCE]:
            return False
        state[BEARING] = atan2(rx, ry)
        state[TURNED] = 0.0
        state[PAUSE_END] = step + row[LEG_PAUSE] / limits[STEP_S]
    bearing = atan2(rx, ry)
    change = (bearing - state[BEARING] + pi) % (2.0 * pi) - pi
    state[TURNED] += sense * change
    state[BEARING] = bearing
    if step < state[PAUSE_END] or state[TURNED] < 2.0 * pi * row[LEG_TURNS]:
        return False
    if isnan(row[LEG_EXIT_X]) or state[TURNED] > 2.0 * pi * (row[LEG_TURNS] + 2.0):
        return True
    ex, ey = row[LEG_EXIT_X] - state[col.POSITION_X], row[LEG_EXIT_Y] - state[col.POSITION_Y]
    size = sqrt(ex * ex + ey * ey) * sqrt(
        state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
    )
    return size < 1.0 or ex * state[col.VELOCITY_X] + ey * state[col.VELOCITY_Y] > ALIGNED * size


@compiled
def _roll_on_ground(state: Floats, limits: Floats, rate: float, wx: float, wy: float) -> None:
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
def _pitch_up(state: Floats, limits: Floats, pitch: float) -> float:
    """Pitch towards a commanded angle and return the climb rate that the lift then gives.

    The wing's lift turns the path until the angle of attack is that at which it carries the weight.
    """
    dt = limits[STEP_S]
    v = max(state[AIRSPEED], SLOW_M_S)
    bank = state[BANK]
    state[NOSE_UP] -= state[NOSE_UP] * dt / NOSE_UP_S
    rate = (pitch + state[NOSE_UP] - state[PITCH]) / limits[PITCH_S]
    rate = min(max(rate, -limits[PITCH_DOWN_RATE]), limits[PITCH_UP_RATE])
    # The rate that would keep the nose level in a coordinated turn is too much for one that slips.
    rate += (1.0 - limits[TURN_SHARE]) * GRAVITY_M_S2 * tan(bank) * sin(bank) / v
    state[PITCH] += rate * cos(bank) * dt
    path = asin(min(max(state[CLIMB] / v, -STEEPEST), STEEPEST))
    level = cos(bank)
    needed = GRAVITY_M_S2 * cos(path) / level
    attack = (needed / (v * v) - limits[LIFT_LEVEL]) / limits[LIFT_SLOPE]
    steady = state[PITCH] - min(attack, 0.5 * pi) * level
    lag = 1.0 / (limits[LIFT_SLOPE] * v)
    change = (steady - path) / (lag + dt)
    state[PATH_RATE] = change
    path += change * dt
    return float(v * min(max(sin(path), -STEEPEST), STEEPEST))


@compiled
def _fly(
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
def _drop(state: Floats, limits: Floats, wx: float, wy: float) -> None:
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
def _blow(state: Floats, wx: float, wy: float, rising: float) -> None:
    """Change the wind: the velocity over ground stays, that through the air changes."""
    if state[DOING] == FLYING or state[DOING] == FLARE:
        ae, an, up = state[col.VELOCITY_X] - wx, state[col.VELOCITY_Y] - wy, state[col.VELOCITY_Z] - rising
        state[AIRSPEED] = max(sqrt(ae * ae + an * an + up * up), SHORT)
        state[CLIMB] = up
        state[col.HEADING] = atan2(ae, an) % (2.0 * pi)


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
def _take_off(state: Floats, limits: Floats, wx: float, wy: float) -> None:
    """Be thrown, or roll a step, and leave the ground when it is fast enough."""
    dt = limits[STEP_S]
    state[SINCE] += dt
    if state[SINCE] < limits[TAKEOFF_DELAY]:
        state[THROTTLE] = 0.0
        _roll_on_ground(state, limits, 0.0, wx, wy)
        return
    throttle = limits[THROTTLE_LIMIT]
    if limits[THROTTLE_SLEW] > 0.0:
        throttle = min(throttle, state[THROTTLE] + limits[THROTTLE_SLEW] * dt)
    state[THROTTLE] = throttle
    rate = limits[LAUNCH]
    if rate <= 0.0:
        v = state[AIRSPEED]
        # It stands level until it lifts off: the drag is that of the lift at no angle of attack.
        load = limits[LIFT_LEVEL] * v * v / GRAVITY_M_S2
        rate = limits[THRUST] * throttle - drag(limits, v, load) - limits[GROUND_DRAG] * v
    _roll_on_ground(state, limits, rate, wx, wy)
    if state[AIRSPEED] >= limits[ROTATION]:
        _lift_off(state, wx, wy)
        if limits[LAUNCH] <= 0.0:
            state[NOSE_UP] = NOSE_UP_RAD


@compiled
def _brake(state: Floats, limits: Floats) -> float:
    """Return the deceleration on the ground after a landing."""
    braking = limits[BRAKING]
    if limits[GROUND_DRAG] > 0.0:
        v = state[AIRSPEED]
        braking += limits[GROUND_DRAG] * v + limits[PARASITIC] * v * v
    return float(braking)


@compiled
def _lift_off(state: Floats, wx: float, wy: float) -> None:
    ae, an = state[col.VELOCITY_X] - wx, state[col.VELOCITY_Y] - wy
    state[AIRSPEED] = max(sqrt(ae * ae + an * an), SHORT)
    state[col.HEADING] = atan2(ae, an) % (2.0 * pi)
    state[DOING] = FLYING


@compiled
def _enter(state: Floats, route: Floats, leg: int, step: int, limits: Floats) -> None:
    """Begin a leg."""
    row = route[leg]
    state[col.GIVE_UP_STEP] = step + _patience_steps(state, row, limits)
    state[TURNED], state[BEARING], state[PAUSE_END] = 0.0, float("nan"), inf
    state[GUIDANCE] = 0.0
    before = route[leg - 1, LEG_KIND] if leg > 0 else FALL
    # ArduPlane keeps the line from the centre of a circle; after a take-off it keeps none.
    if before == LINE or (before == CIRCLE and limits[LAW] != NPFG):
        copy(state, BEGIN, route[leg - 1], LEG_X, 3)
        state[DIRECT] = 0.0
    elif leg > 0 or isnan(state[BEGIN]):
        copy(state, BEGIN, state, col.POSITION, 3)
        state[DIRECT] = 1.0
    else:
        state[DIRECT] = 0.0
    arduplane.begin_slope(state, row, limits)
    landing = row[LEG_KIND] in (LANDING, CIRCULAR_LANDING)
    if state[DOING] == FLARE or (state[DOING] == ROLLING and not landing):
        state[DOING] = FLYING if state[DOING] == FLARE else ON_GROUND
    if state[DOING] == ON_GROUND:
        state[RUNNING] = 0.0
        east, north = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
        if row[LEG_KIND] == TAKEOFF and east * east + north * north > 25.0:
            state[col.HEADING] = atan2(east, north) % (2.0 * pi)
        state[COURSE] = state[col.HEADING]
        state[SINCE] = state[THROTTLE] = 0.0
    elif row[LEG_KIND] == TAKEOFF:
        state[COURSE] = atan2(state[col.VELOCITY_X], state[col.VELOCITY_Y])


@compiled
def _circles(state: Floats, row: Floats, arrived: bool) -> bool:
    """Tell whether a circle is flown now."""
    if arrived or row[LEG_KIND] == LINE:
        return row[LEG_KIND] != LANDING and (arrived or not isnan(state[BEARING]))
    return row[LEG_KIND] in (CIRCLE, CIRCULAR_LANDING)


@compiled
def _steer(
    state: Floats, row: Floats, arrived: bool, limits: Floats, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration that the guidance asks for, and the bearing of a line."""
    kind = row[LEG_KIND]
    if state[DOING] == FLARE and (limits[LAW] == NPFG or kind != LANDING):
        return 0.0, 0.0, 0.0
    if _circles(state, row, arrived):
        x, y, radius = row[LEG_X], row[LEG_Y], row[LEG_CIRCLE_RADIUS]
        if arrived and kind != CIRCULAR_LANDING:
            x, y, radius = state[CENTRE], state[CENTRE + 1], state[CENTRE_RADIUS]
        return _steer_circle(state, x, y, radius, limits, wx, wy), 0.0, 0.0
    if kind != TAKEOFF:
        return _steer_line(state, row, limits, wx, wy)
    ce, cn = sin(state[COURSE]), cos(state[COURSE])
    if limits[LAW] == NPFG:
        rx, ry = state[col.POSITION_X] - state[BEGIN], state[col.POSITION_Y] - state[BEGIN + 1]
        return npfg(
            rx * cn - ry * ce, ce, cn, 0.0, state[col.VELOCITY_X], state[col.VELOCITY_Y], wx, wy,
            limits[PERIOD], limits[DAMPING],
        )  # fmt: skip
    rate = sqrt(2.0) * pi / limits[PERIOD]
    error = (state[COURSE] - state[col.HEADING] + pi) % (2.0 * pi) - pi
    error = min(max(error, -0.5 * pi), 0.5 * pi)
    return 2.0 * sin(error) * rate * state[AIRSPEED], 0.0, 0.0


@compiled
def _airspeed(
    row: Floats, arrived: bool, limits: Floats, be: float, bn: float, wx: float, wy: float
) -> float:
    """Return the airspeed of a leg, raised for the least ground speed along a bearing."""
    kind = row[LEG_KIND]
    airspeed = row[LEG_AIRSPEED]
    if kind == TAKEOFF:
        airspeed = limits[AIRSPEED_TRIM] if arrived else limits[TAKEOFF_AIRSPEED]
    elif kind in (LANDING, CIRCULAR_LANDING):
        airspeed = limits[LANDING_AIRSPEED]
    ground = limits[GROUND_MIN]
    if ground > 0.0 and (be != 0.0 or bn != 0.0):
        along, across = wx * be + wy * bn, wy * be - wx * bn
        if ground > along:
            airspeed = max(airspeed, sqrt((ground - along) ** 2 + across * across))
    return float(
        min(max(airspeed, min(limits[AIRSPEED_MIN], limits[LANDING_AIRSPEED])), limits[AIRSPEED_MAX])
    )


@compiled
def _arduplane_control(
    state: Floats, row: Floats, arrived: bool, limits: Floats, wx: float, wy: float
) -> None:
    """Set what ArduPlane demands: bank, pitch and throttle."""
    lateral, be, bn = _steer(state, row, arrived, limits, wx, wy)
    takeoff = row[LEG_KIND] == TAKEOFF and not arrived
    arduplane.command_bank(state, limits, lateral, takeoff, state[DOING] == FLARE)
    airspeed = _airspeed(row, arrived, limits, be, bn, wx, wy)
    arduplane.command_energy(state, row, limits, arrived, _circles(state, row, arrived), airspeed, wx, wy)


@compiled
def _px4_control(
    state: Floats, row: Floats, arrived: bool, limits: Floats, wx: float, wy: float
) -> tuple[float, float, float]:
    """Move the throttle as PX4 does; return bank and climb that it commands, and the energy rate."""
    kind = row[LEG_KIND]
    landing = kind in (LANDING, CIRCULAR_LANDING)
    circling = _circles(state, row, arrived)
    lateral, be, bn = _steer(state, row, arrived, limits, wx, wy)
    rolls = _near_ground(state, limits, kind == TAKEOFF)
    if state[DOING] == FLARE:
        rolls = min(rolls, 0.09)
    bank = min(max(atan(lateral / GRAVITY_M_S2), -rolls), rolls)
    airspeed = _airspeed(row, arrived, limits, be, bn, wx, wy)
    load = 1.0 / cos(state[BANK])
    full = kind == TAKEOFF and not arrived
    height = state[CENTRE + 2] if arrived and not landing else row[LEG_Z]
    if full:
        height = row[LEG_Z] + 10.0 * limits[HEIGHT_S]
    elif landing:
        height = _px4_approach(state, row, limits)
    elif kind == LINE and not circling:
        dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
        length2 = dx * dx + dy * dy
        if length2 > 1.0:
            part = (
                (state[col.POSITION_X] - state[BEGIN]) * dx + (state[col.POSITION_Y] - state[BEGIN + 1]) * dy
            ) / length2
            height = state[BEGIN + 2] + (row[LEG_Z] - state[BEGIN + 2]) * min(max(part, 0.0), 1.0)
    if state[DOING] == FLARE:
        throttle = 0.0
        _, _, rate = _energy(state, limits, 0.0, airspeed, load, False)
        # The sink dies away towards that of the touch.
        climb = -limits[FLARE_SINK] - max(state[col.POSITION_Z], 0.0) / max(limits[FLARE_S], SHORT)
    else:
        throttle, climb, rate = _energy(state, limits, height, airspeed, load, full)
    state[THROTTLE] += (throttle - state[THROTTLE]) * limits[STEP_S] / THROTTLE_S
    return bank, climb, rate


@compiled
def _px4_approach(state: Floats, row: Floats, limits: Floats) -> float:
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
        height = min(max(slope * to_go, 0.0), max(state[BEGIN + 2], 0.0))
        if to_go < length:
            sink = slope * ground
    else:
        sink = row[LEG_SLOPE] * ground
        height = state[col.POSITION_Z]
    if state[col.POSITION_Z] <= max(limits[FLARE_HEIGHT], limits[FLARE_S] * max(-state[col.VELOCITY_Z], 0.0)):
        state[DOING] = FLARE
    # The height follows the slope without lag: what the error asks for comes on top of the slope.
    return float(height - sink * limits[HEIGHT_S])


@compiled
def _tick(
    state: Floats, row: Floats, arrived: bool, limits: Floats, step: int, wx: float, wy: float, rising: float
) -> bool:
    """Move one step and tell whether the leg is done."""
    kind = row[LEG_KIND]
    doing = state[DOING]
    if kind == FALL:
        _drop(state, limits, wx, wy)
        return bool(state[col.POSITION_Z] <= 0.0)
    if doing == ROLLING:
        state[THROTTLE] = 0.0
        _roll_on_ground(state, limits, -_brake(state, limits), wx, wy)
        return bool(
            state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
            < STOPPED_M_S * STOPPED_M_S
        )
    if doing == ON_GROUND:
        _take_off(state, limits, wx, wy)
        return False
    # ArduPlane's guidance and control of energy have their own, slower clock.
    if limits[LAW] == NPFG:
        bank, climb, rate = _px4_control(state, row, arrived, limits, wx, wy)
    else:
        if step % col.GRID == 0 or state[RUNNING] == 0.0:
            _arduplane_control(state, row, arrived, limits, wx, wy)
        bank = state[BANK_DEMAND]
        state[THROTTLE] = min(state[THROTTLE_DEMAND], limits[THROTTLE_LIMIT])
        rate = energy_rate(limits, state[THROTTLE], state[AIRSPEED], 1.0 / cos(state[BANK]))
        climb = _pitch_up(state, limits, state[PITCH_DEMAND])
    _fly(state, limits, bank, climb, rate, wx, wy, rising)
    landing = kind in (LANDING, CIRCULAR_LANDING)
    if state[col.POSITION_Z] <= 0.0:
        state[col.POSITION_Z] = 0.0
        if landing:
            state[DOING] = ROLLING
            state[COURSE] = atan2(state[col.VELOCITY_X], state[col.VELOCITY_Y])
            state[col.VELOCITY_Z] = state[CLIMB] = 0.0
            return False
        state[col.VELOCITY_Z] = max(state[col.VELOCITY_Z], 0.0)
        state[CLIMB] = max(state[CLIMB], 0.0)
    if landing or arrived or (limits[LAW] != NPFG and step % col.GRID != 0):
        return False
    if kind == TAKEOFF:
        return bool(state[col.POSITION_Z] >= row[LEG_Z])
    if kind == CIRCLE:
        return _circled(state, row, limits, step)
    return _passed(state, row, limits)


@compiled
def _passed(state: Floats, row: Floats, limits: Floats) -> bool:
    """Tell whether a waypoint is reached."""
    east, north = state[col.POSITION_X] - row[LEG_X], state[col.POSITION_Y] - row[LEG_Y]
    near = _acceptance(state, row, limits)
    close = east * east + north * north <= near * near
    if not close:
        dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
        close = dx * dx + dy * dy > 1e-6 and east * dx + north * dy > 0.0
    if abs(row[LEG_Z] - state[col.POSITION_Z]) <= row[LEG_HEIGHT_TOLERANCE]:
        return close or not isnan(state[BEARING])
    if close:
        # The height is still to come: it is reached on a circle about the waypoint.
        state[BEARING] = 0.0
    return False


@compiled
def advance(
    state: Floats,
    counters: Integers,
    route: Floats,
    limits: Floats,
    power: Floats,
    wind: Floats,
    first_wind: int,
    max_steps: int,
    stop_each: bool,
    arrivals: Integers,
    track: Floats,
    track_every: int,
) -> int:
    """Fly up to ``max_steps`` steps along the route; return early, with the event, when something happens.

    As `sim_vehicle.motion.multirotor.kernel.advance`. After the last leg the vehicle circles: on, where that
    was a circle, otherwise about the end of the leg.

    Parameters
    ----------
    state, counters : float64[STATE], int64[6]
        Changed in place.
    route : float64[n, LEG]
    limits, power : float64[LIMITS], float64[9]
    wind : float64[m, 9]
    """
    event = col.RAN
    for _ in range(max_steps):
        step, leg = counters[col.STEP], counters[col.LEG_INDEX]
        row = route[leg]
        if state[col.GIVE_UP_STEP] == inf:
            _enter(state, route, leg, step, limits)
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            wx, wy, up = wind_at(wind[index], state[col.POSITION_Z])
            if wx != state[col.WIND_EAST] or wy != state[col.WIND_NORTH] or up != state[WIND_UP]:
                _blow(state, wx, wy, up)
                state[col.WIND_EAST], state[col.WIND_NORTH], state[WIND_UP] = wx, wy, up
            if state[DOING] == FLYING or state[DOING] == FLARE:
                load = 1.0 / cos(state[BANK])
                v = state[AIRSPEED]
                rate = energy_rate(limits, state[THROTTLE], v, load)
                state[col.POWER] = fixed_wing_power(power, v if state[THROTTLE] > 1e-3 else 0.0, rate, load)
            elif state[DOING] == ON_GROUND:
                state[col.POWER] = fixed_wing_power(power, limits[AIRSPEED_TRIM], limits[CLIMB_MAX], 1.0)
            else:
                state[col.POWER] = fixed_wing_power(power, 0.0, 0.0, 1.0)
            mark_track(
                counters,
                step,
                track,
                track_every,
                state[col.POSITION_X],
                state[col.POSITION_Y],
                state[col.POSITION_Z],
            )
            if counters[col.ARRIVED] == 0 and step > state[col.GIVE_UP_STEP]:
                event = col.STALLED
                break
        done = _tick(
            state,
            row,
            counters[col.ARRIVED] != 0,
            limits,
            step,
            state[col.WIND_EAST],
            state[col.WIND_NORTH],
            state[WIND_UP],
        )
        state[col.ENERGY_USED] += state[col.POWER] * limits[STEP_S]
        counters[col.STEP] = step + 1
        if counters[col.ARRIVED] == 0:
            if done:
                event = complete_leg(counters, arrivals, step + 1, stop_each)
                if counters[col.ARRIVED] == 0:
                    state[col.GIVE_UP_STEP] = inf
                else:
                    _settle(state, row, limits)
            elif counters[col.NEAR_TOLD] == 0 and row[LEG_NEAR] > 0.0:
                rx, ry, rz = (
                    row[LEG_X] - state[col.POSITION_X],
                    row[LEG_Y] - state[col.POSITION_Y],
                    row[LEG_Z] - state[col.POSITION_Z],
                )
                if rx * rx + ry * ry + rz * rz < row[LEG_NEAR] * row[LEG_NEAR]:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state[col.ENERGY_USED] >= limits[ENERGY_LIMIT]:
            event = col.ENERGY
        if event != col.RAN:
            break
    return event


@compiled
def _settle(state: Floats, row: Floats, limits: Floats) -> None:
    """Choose the circle that is flown after the end of a route."""
    copy(state, CENTRE, row, 0, 3)
    state[CENTRE_RADIUS] = row[LEG_CIRCLE_RADIUS] if row[LEG_KIND] == CIRCLE else limits[LOITER_RADIUS]
    if row[LEG_KIND] == TAKEOFF:
        state[CENTRE], state[CENTRE + 1] = state[col.POSITION_X], state[col.POSITION_Y]
