"""The compiled motion of one fixed wing: coordinated turns, energy, guidance along the legs of a route.

The model is described in docs/fixed-wing-and-rover.md. Lengths in metres, angles in radians, east-north-up
about home, headings clockwise from north, banks and accelerations to the right positive. One vehicle is a row
of `STATE` numbers and a row of `COUNTERS` integers, as in `sim_vehicle.motion.multirotor.kernel`, whose
first 19 numbers and whose counters it has.
"""

from __future__ import annotations

from math import atan, atan2, cos, inf, isnan, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.energy.power_kernels import wing_power
from sim_vehicle.motion.columns import ENERGY, GRID, NEAR, POSITION, RAN, REACHED, STALLED, WIND
from sim_vehicle.motion.fixed_wing.guidance import (
    NPFG,
    Floats,
    l1_circle,
    l1_distance,
    l1_line,
    npfg,
    switch_distance,
)
from sim_vehicle.motion.multirotor.kernel import Integers
from sim_vehicle.motion.rows import copy
from sim_vehicle.weather.gust_kernel import wind_at

# beyond the first 19: bank 19, true airspeed 20, climb through the air 21, throttle 22 (0 to 1), pitch 23,
# bank that is commanded 24, beginning of the leg 25-27, course on the ground 28, turned about the centre 29,
# bearing from the centre 30 (NaN: not circling yet), step at which a pause ends 31, what it does 32, guidance
# 33-34 (last angle, integral), place that is circled after the end of a route 35-37, radius there 38
BANK, AIRSPEED, CLIMB, THROTTLE, PITCH, COMMAND = range(19, 25)
BEGIN, COURSE, TURNED, BEARING, PAUSE_END, DOING, GUIDANCE, CENTRE, CENTRE_RADIUS = (
    25,
    28,
    29,
    30,
    31,
    32,
    33,
    35,
    38,
)
STATE = 39
ON_GROUND, FLYING, FLARE, ROLLING = 0.0, 1.0, 2.0, 3.0

# leg: target 0-2, kind 3, acceptance radius 4 (0: the autopilot's), airspeed 5, distance to notify at 6,
# radius of the circle 7 (positive: clockwise), turns 8, where to leave the circle to 9-10 (NaN: anywhere),
# pause 11, whether the height changes along the leg 12, tolerance of the height 13, angle to the next leg 14,
# slope of a circular landing 15
LEG = 16
LINE, CIRCLE, TAKEOFF, LANDING, CIRCULAR_LANDING, FALL = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0

# limits
(
    STEP_S,
    LAW,
    AIRSPEED_MIN,
    AIRSPEED_TRIM,
    AIRSPEED_MAX,
    BANK_LIMIT,
    ROLL_S,
    ROLL_RATE,
    ROLL_SLEW,
    CLIMB_MAX,
    CLIMB_RATE,
    SINK_MIN,
    SINK_RATE,
    SINK_MAX,
    HEIGHT_S,
    SPEED_S,
    VERTICAL_ACCELERATION,
    PERIOD,
    DAMPING,
    INTEGRAL,
    SWITCH_SHARE,
    ACCEPTANCE,
    GROUND_MIN,
    TAKEOFF_AIRSPEED,
    ROTATION,
    LAUNCH,
    LEVEL_HEIGHT,
    LEVEL_BANK,
    WING_SPAN,
    LANDING_AIRSPEED,
    FLARE_HEIGHT,
    FLARE_S,
    FLARE_SINK,
    BRAKING,
    LOITER_RADIUS,
    ENERGY_LIMIT,
    THROTTLE_LIMIT,
    PARASITIC,
    INDUCED,
) = range(39)
LIMITS = 39

PITCH_S = 0.5
THROTTLE_S = 0.4
ALPHA = 0.05
SHORT = 0.5
STOPPED = 0.1
ALIGNED = 0.985
FALL_M_S = 18.0
FALL_S = 2.0
# A leg is given up when it takes longer than this and three times what it takes at a slow speed.
PATIENCE_S = 120.0
SLOW_SHARE = 0.15


@compiled
def excess_sink(limits: Floats, airspeed: float, load: float) -> float:
    """Return how much faster than in trimmed level flight the drag takes energy, over the weight, m/s."""
    v, trim = max(airspeed, 3.0), limits[AIRSPEED_TRIM]
    drag = limits[PARASITIC] * v * v * v + limits[INDUCED] * load * load / v
    return float((drag - limits[PARASITIC] * trim * trim * trim - limits[INDUCED] / trim) / GRAVITY_M_S2)


@compiled
def _patience_steps(state: Floats, row: Floats, limits: Floats) -> float:
    """Return how many steps a leg may take."""
    east, north = row[0] - state[0], row[1] - state[1]
    way = sqrt(east * east + north * north)
    trim = limits[AIRSPEED_TRIM]
    seconds = PATIENCE_S + way / (SLOW_SHARE * trim) + abs(row[2] - state[2]) / 0.2 + 2.0 * row[11]
    seconds += (row[8] + 2.0) * 2.0 * pi * abs(row[7]) / (0.2 * trim)
    return float(seconds / limits[STEP_S])


@compiled
def _steer_line(
    state: Floats, row: Floats, limits: Floats, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration along a leg, and its bearing."""
    ve, vn = state[3], state[4]
    period, damping = limits[PERIOD], limits[DAMPING]
    dx, dy = row[0] - state[BEGIN], row[1] - state[BEGIN + 1]
    length = sqrt(dx * dx + dy * dy)
    rx, ry = state[0] - state[BEGIN], state[1] - state[BEGIN + 1]
    goal_x, goal_y = row[0] - state[0], row[1] - state[1]
    if limits[LAW] != NPFG:
        if length < SHORT:
            dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
            if length < 1e-6:
                dx, dy, length = sin(state[9]), cos(state[9]), 1.0
        return l1_line(
            rx, ry, dx / length, dy / length, length, ve, vn, period, damping, limits[INTEGRAL],
            limits[STEP_S], state, GUIDANCE,
        )  # fmt: skip
    ground = sqrt(ve * ve + vn * vn)
    if length >= SHORT and row[3] != TAKEOFF:
        behind = dx * rx + dy * ry < 0.0
        near = switch_distance(ground, period, damping, limits[SWITCH_SHARE])
        if behind and rx * rx + ry * ry > near * near:
            dx, dy, length = -rx, -ry, sqrt(rx * rx + ry * ry)
            rx = ry = 0.0
        elif row[3] == LINE and (state[0] - row[0]) * dx + (state[1] - row[1]) * dy > 0.0:
            length = 0.0
    if length < SHORT:
        dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
        if length < 1e-6:
            dx, dy, length = sin(state[9]), cos(state[9]), 1.0
    te, tn = dx / length, dy / length
    return npfg(rx * tn - ry * te, te, tn, 0.0, ve, vn, wx, wy, period, damping)


@compiled
def _steer_circle(
    state: Floats, x: float, y: float, radius: float, limits: Floats, wx: float, wy: float
) -> float:
    """Return the lateral acceleration to follow a circle."""
    ve, vn = state[3], state[4]
    rx, ry = state[0] - x, state[1] - y
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
    extra = excess_sink(limits, v, load)
    most = limits[CLIMB_MAX] - extra
    least = -limits[SINK_MIN] - extra
    climb = (height - state[2]) / limits[HEIGHT_S]
    climb = min(max(climb, -limits[SINK_RATE]), limits[CLIMB_RATE])
    # Rates of the kinetic energy over the weight.
    fast = (airspeed - v) / limits[SPEED_S] * v / GRAVITY_M_S2
    fast = min(max(fast, 0.5 * min(least, -0.2)), 0.5 * max(most, 0.2))
    if full:
        throttle = limits[THROTTLE_LIMIT]
        climb = limits[CLIMB_MAX]
    else:
        throttle = min(max((climb + fast - least) / max(most - least, 0.1), 0.0), limits[THROTTLE_LIMIT])
    rate = least + state[THROTTLE] * (most - least)
    # Where it climbs out, is too slow or has no power, the speed is held first and what is left climbs.
    least_speed = min(limits[AIRSPEED_MIN], limits[LANDING_AIRSPEED])
    slow = min(max(10.0 * (1.0 - v / least_speed), 0.0), 1.0)
    if full or limits[THROTTLE_LIMIT] == 0.0:
        slow = 1.0
    climb = (1.0 - slow) * 0.5 * (rate + climb - fast) + slow * (rate - fast)
    return throttle, min(max(climb, -limits[SINK_MAX]), limits[CLIMB_MAX]), rate


@compiled
def _acceptance(state: Floats, row: Floats, limits: Floats) -> float:
    """Return how near to a waypoint counts as reached."""
    ground = sqrt(state[3] * state[3] + state[4] * state[4])
    if limits[LAW] == NPFG:
        near = switch_distance(ground, limits[PERIOD], limits[DAMPING], limits[SWITCH_SHARE])
        return float(max(limits[ACCEPTANCE], near))
    if row[4] > 0.0:
        return float(row[4])
    near = min(limits[ACCEPTANCE], l1_distance(ground, limits[PERIOD], limits[DAMPING]))
    return float(near * min(row[14] / (0.5 * pi), 1.0))


@compiled
def _circled(state: Floats, row: Floats, limits: Floats, step: int) -> bool:
    """Keep count on a circle and tell whether it may be left."""
    rx, ry = state[0] - row[0], state[1] - row[1]
    away = sqrt(rx * rx + ry * ry)
    radius = abs(row[7])
    sense = 1.0 if row[7] > 0.0 else -1.0
    if isnan(state[BEARING]):
        ground = sqrt(state[3] * state[3] + state[4] * state[4])
        room = radius + min(limits[ACCEPTANCE], 0.5 * radius)
        if limits[LAW] == NPFG:
            near = switch_distance(ground, limits[PERIOD], limits[DAMPING], limits[SWITCH_SHARE])
            room = radius + max(limits[ACCEPTANCE], near)
        # An airspeed that is too high for the circle leads round it outside.
        tight = ground * ground / (GRAVITY_M_S2 * tan(limits[BANK_LIMIT]))
        room = max(room, 2.2 * tight)
        if away > room or abs(row[2] - state[2]) > row[13]:
            return False
        state[BEARING] = atan2(rx, ry)
        state[TURNED] = 0.0
        state[PAUSE_END] = step + row[11] / limits[STEP_S]
    bearing = atan2(rx, ry)
    change = (bearing - state[BEARING] + pi) % (2.0 * pi) - pi
    state[TURNED] += sense * change
    state[BEARING] = bearing
    if step < state[PAUSE_END] or state[TURNED] < 2.0 * pi * row[8]:
        return False
    if isnan(row[9]) or state[TURNED] > 2.0 * pi * (row[8] + 2.0):
        return True
    ex, ey = row[9] - state[0], row[10] - state[1]
    size = sqrt(ex * ex + ey * ey) * sqrt(state[3] * state[3] + state[4] * state[4])
    return size < 1.0 or ex * state[3] + ey * state[4] > ALIGNED * size


@compiled
def _roll_on_ground(state: Floats, limits: Floats, rate: float, wx: float, wy: float) -> None:
    """Change the speed over ground by ``rate`` along the course on the ground."""
    dt = limits[STEP_S]
    ce, cn = sin(state[COURSE]), cos(state[COURSE])
    before = state[3] * ce + state[4] * cn
    speed = max(before + rate * dt, 0.0)
    state[0] += 0.5 * (before + speed) * dt * ce
    state[1] += 0.5 * (before + speed) * dt * cn
    state[2] = 0.0
    state[12] += 0.5 * (before + speed) * dt
    state[6], state[7], state[8] = (speed - before) / dt * ce, (speed - before) / dt * cn, 0.0
    state[3], state[4], state[5] = speed * ce, speed * cn, 0.0
    state[9], state[10] = state[COURSE] % (2.0 * pi), 0.0
    state[AIRSPEED] = max(speed - wx * ce - wy * cn, 0.0)
    state[CLIMB] = state[BANK] = state[COMMAND] = state[PITCH] = 0.0


@compiled
def _fly(
    state: Floats, limits: Floats, bank: float, climb: float, rate: float, wx: float, wy: float, rising: float
) -> float:
    """Move a step through the air and return the load factor.

    Parameters
    ----------
    bank, climb : float
        What is commanded.
    rate : float
        Gain of energy over the weight, m/s.
    wx, wy, rising : float
        Wind.
    """
    dt = limits[STEP_S]
    change = limits[ROLL_SLEW] * dt
    command = state[COMMAND] + min(max(bank - state[COMMAND], -change), change)
    state[COMMAND] = command
    roll = min(max((command - state[BANK]) / limits[ROLL_S], -limits[ROLL_RATE]), limits[ROLL_RATE])
    state[BANK] += roll * dt
    bank = state[BANK]
    change = limits[VERTICAL_ACCELERATION] * dt
    w = state[CLIMB]
    w += min(max((climb - w) * dt / PITCH_S, -change), change)
    v = max(state[AIRSPEED], SHORT)
    v += (rate - w) * GRAVITY_M_S2 / v * dt
    v = max(v, SHORT)
    w = min(max(w, -0.8 * v), 0.8 * v)
    forward = sqrt(v * v - w * w)
    turn = GRAVITY_M_S2 * tan(bank) / forward
    middle = state[9] + 0.5 * turn * dt
    yaw = (state[9] + turn * dt) % (2.0 * pi)
    ve, vn, vz = forward * sin(yaw) + wx, forward * cos(yaw) + wy, w + rising
    east, north = (forward * sin(middle) + wx) * dt, (forward * cos(middle) + wy) * dt
    up = 0.5 * (state[5] + vz) * dt
    state[0] += east
    state[1] += north
    state[2] += up
    state[12] += sqrt(east * east + north * north + up * up)
    state[6], state[7], state[8] = (ve - state[3]) / dt, (vn - state[4]) / dt, (vz - state[5]) / dt
    state[3], state[4], state[5] = ve, vn, vz
    state[9], state[10] = yaw, turn
    state[AIRSPEED], state[CLIMB] = v, w
    load = 1.0 / cos(bank)
    state[PITCH] = atan2(w, forward) + ALPHA * load * (limits[AIRSPEED_TRIM] / v) ** 2
    return load


@compiled
def _drop(state: Floats, limits: Floats, wx: float, wy: float) -> None:
    """Fall a step."""
    dt = limits[STEP_S]
    keep = 1.0 - dt / FALL_S
    ve, vn = wx + (state[3] - wx) * keep, wy + (state[4] - wy) * keep
    vz = max(state[5] - GRAVITY_M_S2 * dt, -FALL_M_S)
    state[0] += ve * dt
    state[1] += vn * dt
    state[2] = max(state[2] + vz * dt, 0.0)
    state[12] += sqrt(ve * ve + vn * vn + vz * vz) * dt
    state[6], state[7], state[8] = (ve - state[3]) / dt, (vn - state[4]) / dt, (vz - state[5]) / dt
    state[3], state[4], state[5] = ve, vn, vz
    state[10] = 2.0
    state[9] = (state[9] + 2.0 * dt) % (2.0 * pi)
    state[AIRSPEED] = sqrt((ve - wx) ** 2 + (vn - wy) ** 2 + vz * vz)
    state[CLIMB] = vz


@compiled
def _blow(state: Floats, wx: float, wy: float, rising: float) -> None:
    """Change the wind: the velocity over ground stays, that through the air changes."""
    if state[DOING] == FLYING or state[DOING] == FLARE:
        ae, an, up = state[3] - wx, state[4] - wy, state[5] - rising
        state[AIRSPEED] = max(sqrt(ae * ae + an * an + up * up), SHORT)
        state[CLIMB] = up
        state[9] = atan2(ae, an) % (2.0 * pi)


@compiled
def _near_ground(state: Floats, limits: Floats, level: bool) -> float:
    """Return the bank limit: a wing tip must not touch the ground, and some keep level on their way up."""
    bank = limits[BANK_LIMIT]
    height = state[2]
    if level and height < limits[LEVEL_HEIGHT]:
        bank = min(bank, limits[LEVEL_BANK])
    tip = atan(max(2.0 * height, 0.0) / limits[WING_SPAN])
    return float(min(bank, max(tip, 0.09)))


@compiled
def _lift_off(state: Floats, wx: float, wy: float) -> None:
    ae, an = state[3] - wx, state[4] - wy
    state[AIRSPEED] = max(sqrt(ae * ae + an * an), SHORT)
    state[9] = atan2(ae, an) % (2.0 * pi)
    state[DOING] = FLYING


@compiled
def _enter(state: Floats, route: Floats, leg: int, step: int, limits: Floats) -> None:
    """Begin a leg."""
    row = route[leg]
    state[14] = step + _patience_steps(state, row, limits)
    state[TURNED], state[BEARING], state[PAUSE_END] = 0.0, float("nan"), inf
    state[GUIDANCE] = 0.0
    if leg > 0 and route[leg - 1, 3] == LINE:
        copy(state, BEGIN, route[leg - 1], 0, 3)
    elif leg > 0 or isnan(state[BEGIN]):
        copy(state, BEGIN, state, POSITION, 3)
    landing = row[3] in (LANDING, CIRCULAR_LANDING)
    if state[DOING] == FLARE or (state[DOING] == ROLLING and not landing):
        state[DOING] = FLYING if state[DOING] == FLARE else ON_GROUND
    if state[DOING] == ON_GROUND:
        east, north = row[0] - state[0], row[1] - state[1]
        if row[3] == TAKEOFF and east * east + north * north > 25.0:
            state[9] = atan2(east, north) % (2.0 * pi)
        state[COURSE] = state[9]
    elif row[3] == TAKEOFF:
        state[COURSE] = atan2(state[3], state[4])


@compiled
def _tick(
    state: Floats, row: Floats, arrived: bool, limits: Floats, step: int, wx: float, wy: float, rising: float
) -> bool:
    """Move one step and tell whether the leg is done."""
    kind = row[3]
    doing = state[DOING]
    if kind == FALL:
        _drop(state, limits, wx, wy)
        return bool(state[2] <= 0.0)
    if doing == ROLLING:
        state[THROTTLE] = 0.0
        _roll_on_ground(state, limits, -limits[BRAKING], wx, wy)
        return bool(state[3] * state[3] + state[4] * state[4] < STOPPED * STOPPED)
    if doing == ON_GROUND:
        state[THROTTLE] = limits[THROTTLE_LIMIT]
        _roll_on_ground(state, limits, limits[LAUNCH], wx, wy)
        if state[AIRSPEED] >= limits[ROTATION]:
            _lift_off(state, wx, wy)
        return False
    # What to follow.
    height, airspeed = row[2], row[5]
    x, y, radius = row[0], row[1], row[7]
    circling = kind in (CIRCLE, CIRCULAR_LANDING)
    landing = kind in (LANDING, CIRCULAR_LANDING)
    if arrived and not landing:
        circling = True
        x, y, height, radius = state[CENTRE], state[CENTRE + 1], state[CENTRE + 2], state[CENTRE_RADIUS]
        airspeed = limits[AIRSPEED_TRIM] if kind == TAKEOFF else airspeed
    elif kind == LINE and not isnan(state[BEARING]):
        circling = True
    be, bn = 0.0, 0.0
    rolls = _near_ground(state, limits, kind == TAKEOFF)
    if doing == FLARE:
        lateral = 0.0
        rolls = min(rolls, 0.09)
    elif circling:
        lateral = _steer_circle(state, x, y, radius, limits, wx, wy)
    elif kind == TAKEOFF:
        ce, cn = sin(state[COURSE]), cos(state[COURSE])
        rx, ry = state[0] - state[BEGIN], state[1] - state[BEGIN + 1]
        if limits[LAW] == NPFG:
            error = rx * cn - ry * ce
            lateral, be, bn = npfg(
                error, ce, cn, 0.0, state[3], state[4], wx, wy, limits[PERIOD], limits[DAMPING]
            )
        else:
            rate = sqrt(2.0) * pi / limits[PERIOD]
            error = (state[COURSE] - state[9] + pi) % (2.0 * pi) - pi
            error = min(max(error, -0.5 * pi), 0.5 * pi)
            lateral = 2.0 * sin(error) * rate * state[AIRSPEED]
    else:
        lateral, be, bn = _steer_line(state, row, limits, wx, wy)
    bank = min(max(atan(lateral / GRAVITY_M_S2), -rolls), rolls)
    # Speeds and heights.
    load = 1.0 / cos(state[BANK])
    full = kind == TAKEOFF and not arrived
    if full:
        airspeed = limits[TAKEOFF_AIRSPEED]
        height = row[2] + 10.0 * limits[HEIGHT_S]
    elif landing:
        airspeed = limits[LANDING_AIRSPEED]
    ground2 = limits[GROUND_MIN]
    if ground2 > 0.0 and not circling and (be != 0.0 or bn != 0.0):
        along, across = wx * be + wy * bn, wy * be - wx * bn
        if ground2 > along:
            airspeed = max(airspeed, sqrt((ground2 - along) ** 2 + across * across))
    airspeed = min(max(airspeed, min(limits[AIRSPEED_MIN], limits[LANDING_AIRSPEED])), limits[AIRSPEED_MAX])
    sink = 0.0
    if landing:
        ground = sqrt(state[3] * state[3] + state[4] * state[4])
        if kind == LANDING:
            dx, dy = row[0] - state[BEGIN], row[1] - state[BEGIN + 1]
            length = max(sqrt(dx * dx + dy * dy), 1e-3)
            to_go = ((row[0] - state[0]) * dx + (row[1] - state[1]) * dy) / length
            slope = max(state[BEGIN + 2], 1.0) / length
            height = min(max(slope * to_go, 0.0), max(state[BEGIN + 2], 0.0))
            if to_go < length:
                sink = slope * ground
        else:
            sink = row[15] * ground
            height = state[2]
        # The height follows the slope without lag: what the error asks for comes on top of the slope.
        height -= sink * limits[HEIGHT_S]
        if state[2] <= max(limits[FLARE_HEIGHT], limits[FLARE_S] * max(-state[5], 0.0)):
            state[DOING] = FLARE
    elif row[12] > 0.0 and not circling:
        dx, dy = row[0] - state[BEGIN], row[1] - state[BEGIN + 1]
        length2 = dx * dx + dy * dy
        if length2 > 1.0:
            part = ((state[0] - state[BEGIN]) * dx + (state[1] - state[BEGIN + 1]) * dy) / length2
            height = state[BEGIN + 2] + (row[2] - state[BEGIN + 2]) * min(max(part, 0.0), 1.0)
    if state[DOING] == FLARE:
        throttle = 0.0
        _, _, rate = _energy(state, limits, 0.0, airspeed, load, False)
        # The sink dies away on the way down to that of the touch.
        climb = -limits[FLARE_SINK] - max(state[2], 0.0) / max(limits[FLARE_S], SHORT)
    else:
        throttle, climb, rate = _energy(state, limits, height, airspeed, load, full)
    dt = limits[STEP_S]
    state[THROTTLE] += (throttle - state[THROTTLE]) * dt / THROTTLE_S
    load = _fly(state, limits, bank, climb, rate, wx, wy, rising)
    if state[2] <= 0.0:
        state[2] = 0.0
        if landing:
            state[DOING] = ROLLING
            state[COURSE] = atan2(state[3], state[4])
            state[5] = state[CLIMB] = 0.0
            return False
        state[5] = max(state[5], 0.0)
        state[CLIMB] = max(state[CLIMB], 0.0)
    if landing or arrived:
        return False
    if kind == TAKEOFF:
        return bool(state[2] >= row[2])
    if kind == CIRCLE:
        return _circled(state, row, limits, step)
    east, north = state[0] - row[0], state[1] - row[1]
    near = _acceptance(state, row, limits)
    close = east * east + north * north <= near * near
    if not close:
        dx, dy = row[0] - state[BEGIN], row[1] - state[BEGIN + 1]
        close = dx * dx + dy * dy > 1e-6 and east * dx + north * dy > 0.0
    if abs(row[2] - state[2]) <= row[13]:
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
    last = route.shape[0] - 1
    event = RAN
    for _ in range(max_steps):
        step, leg = counters[0], counters[1]
        row = route[leg]
        if state[14] == inf:
            _enter(state, route, leg, step, limits)
        if step % GRID == 0:
            index = 0
            if wind.shape[0] > 1:
                index = step // GRID - first_wind
                if index >= wind.shape[0]:
                    event = WIND
                    break
            wx, wy, up = wind_at(wind[index], state[2])
            if wx != state[15] or wy != state[16] or up != state[17]:
                _blow(state, wx, wy, up)
                state[15], state[16], state[17] = wx, wy, up
            if state[DOING] == FLYING or state[DOING] == FLARE:
                load = 1.0 / cos(state[BANK])
                v = state[AIRSPEED]
                rate = state[THROTTLE] * (limits[CLIMB_MAX] + limits[SINK_MIN]) - limits[SINK_MIN]
                rate -= excess_sink(limits, v, load)
                state[13] = wing_power(power, v if state[THROTTLE] > 1e-3 else 0.0, rate, load)
            elif state[DOING] == ON_GROUND:
                state[13] = wing_power(power, limits[AIRSPEED_TRIM], limits[CLIMB_MAX], 1.0)
            else:
                state[13] = wing_power(power, 0.0, 0.0, 1.0)
            if track_every > 0 and (step // GRID) % track_every == 0 and counters[5] < track.shape[0]:
                point = counters[5]
                track[point, 0], track[point, 1], track[point, 2] = state[0], state[1], state[2]
                counters[5] = point + 1
            if counters[3] == 0 and step > state[14]:
                event = STALLED
                break
        done = _tick(state, row, counters[3] != 0, limits, step, state[15], state[16], state[17])
        state[11] += state[13] * limits[STEP_S]
        counters[0] = step + 1
        if counters[3] == 0:
            if done:
                arrivals[leg] = step + 1
                counters[4] = 0
                if leg == last:
                    counters[3] = 1
                    event = REACHED
                    _settle(state, row, limits)
                else:
                    counters[1] = leg + 1
                    state[14] = inf
                    if stop_each:
                        event = REACHED
            elif counters[4] == 0 and row[6] > 0.0:
                rx, ry, rz = row[0] - state[0], row[1] - state[1], row[2] - state[2]
                if rx * rx + ry * ry + rz * rz < row[6] * row[6]:
                    counters[4] = 1
                    event = NEAR
        if state[11] >= limits[ENERGY_LIMIT]:
            event = ENERGY
        if event != RAN:
            break
    return event


@compiled
def _settle(state: Floats, row: Floats, limits: Floats) -> None:
    """Choose the circle that is flown after the end of a route."""
    copy(state, CENTRE, row, 0, 3)
    state[CENTRE_RADIUS] = row[7] if row[3] == CIRCLE else limits[LOITER_RADIUS]
    if row[3] == TAKEOFF:
        state[CENTRE], state[CENTRE + 1] = state[0], state[1]
