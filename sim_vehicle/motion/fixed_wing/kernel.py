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
from sim_vehicle.energy.power_kernels import fixed_wing_power
from sim_vehicle.motion import columns as col
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
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

# The state: the shared numbers, where the vertical wind takes the column of LOOK_EAST, and then these.
WIND_UP = 17
(
    BANK,
    AIRSPEED,  # True airspeed.
    CLIMB,  # Through the air.
    THROTTLE,  # 0 to 1.
    PITCH,
    COMMAND,  # Bank that is commanded.
) = range(19, 25)
BEGIN = 25  # Beginning of the leg, three numbers.
(
    COURSE,  # On the ground.
    TURNED,  # About the centre.
    BEARING,  # From the centre; NaN: not circling yet.
    PAUSE_END,  # Step at which a pause ends.
    DOING,  # ON_GROUND, FLYING, FLARE or ROLLING.
    GUIDANCE,  # Two numbers: last angle, integral.
) = range(28, 34)
# Position that is circled after the end of a route, three numbers, and the radius.
CENTRE, CENTRE_RADIUS = 35, 38
STATE = 39
ON_GROUND, FLYING, FLARE, ROLLING = 0.0, 1.0, 2.0, 3.0

# One leg.
(
    LEG_X,
    LEG_Y,
    LEG_Z,
    LEG_KIND,
    LEG_RADIUS,  # Acceptance radius; 0: the autopilot's.
    LEG_AIRSPEED,
    LEG_NEAR,  # Distance to notify at.
    LEG_CIRCLE_RADIUS,  # Positive: clockwise.
    LEG_TURNS,
    LEG_EXIT_X,  # Where to leave the circle to; NaN: anywhere.
    LEG_EXIT_Y,
    LEG_PAUSE,
    LEG_CLIMBS_ALONG,  # Whether the height changes along the leg.
    LEG_HEIGHT_TOLERANCE,
    LEG_TURN_ANGLE,  # Angle to the next leg.
    LEG_SLOPE,  # Of a circular landing.
) = range(16)
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
    """Return the loss of energy to drag beyond that of trimmed level flight, over the weight, m/s."""
    v, trim = max(airspeed, 3.0), limits[AIRSPEED_TRIM]
    drag = limits[PARASITIC] * v * v * v + limits[INDUCED] * load * load / v
    return float((drag - limits[PARASITIC] * trim * trim * trim - limits[INDUCED] / trim) / GRAVITY_M_S2)


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
        if length < SHORT:
            dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
            if length < 1e-6:
                dx, dy, length = sin(state[col.HEADING]), cos(state[col.HEADING]), 1.0
        return l1_line(
            rx, ry, dx / length, dy / length, length, ve, vn, period, damping, limits[INTEGRAL],
            limits[STEP_S], state, GUIDANCE,
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
    extra = excess_sink(limits, v, load)
    most = limits[CLIMB_MAX] - extra
    least = -limits[SINK_MIN] - extra
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
    """Return the distance at which a waypoint counts as reached."""
    ground = sqrt(
        state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
    )
    if limits[LAW] == NPFG:
        near = switch_distance(ground, limits[PERIOD], limits[DAMPING], limits[SWITCH_SHARE])
        return float(max(limits[ACCEPTANCE], near))
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
    state[PITCH] = atan2(w, forward) + ALPHA * load * (limits[AIRSPEED_TRIM] / v) ** 2
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
    if leg > 0 and route[leg - 1, LEG_KIND] == LINE:
        copy(state, BEGIN, route[leg - 1], LEG_X, 3)
    elif leg > 0 or isnan(state[BEGIN]):
        copy(state, BEGIN, state, col.POSITION, 3)
    landing = row[LEG_KIND] in (LANDING, CIRCULAR_LANDING)
    if state[DOING] == FLARE or (state[DOING] == ROLLING and not landing):
        state[DOING] = FLYING if state[DOING] == FLARE else ON_GROUND
    if state[DOING] == ON_GROUND:
        east, north = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
        if row[LEG_KIND] == TAKEOFF and east * east + north * north > 25.0:
            state[col.HEADING] = atan2(east, north) % (2.0 * pi)
        state[COURSE] = state[col.HEADING]
    elif row[LEG_KIND] == TAKEOFF:
        state[COURSE] = atan2(state[col.VELOCITY_X], state[col.VELOCITY_Y])


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
        _roll_on_ground(state, limits, -limits[BRAKING], wx, wy)
        return bool(
            state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
            < STOPPED * STOPPED
        )
    if doing == ON_GROUND:
        state[THROTTLE] = limits[THROTTLE_LIMIT]
        _roll_on_ground(state, limits, limits[LAUNCH], wx, wy)
        if state[AIRSPEED] >= limits[ROTATION]:
            _lift_off(state, wx, wy)
        return False
    # What to follow.
    height, airspeed = row[LEG_Z], row[LEG_AIRSPEED]
    x, y, radius = row[LEG_X], row[LEG_Y], row[LEG_CIRCLE_RADIUS]
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
        rx, ry = state[col.POSITION_X] - state[BEGIN], state[col.POSITION_Y] - state[BEGIN + 1]
        if limits[LAW] == NPFG:
            error = rx * cn - ry * ce
            lateral, be, bn = npfg(
                error,
                ce,
                cn,
                0.0,
                state[col.VELOCITY_X],
                state[col.VELOCITY_Y],
                wx,
                wy,
                limits[PERIOD],
                limits[DAMPING],
            )
        else:
            rate = sqrt(2.0) * pi / limits[PERIOD]
            error = (state[COURSE] - state[col.HEADING] + pi) % (2.0 * pi) - pi
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
        height = row[LEG_Z] + 10.0 * limits[HEIGHT_S]
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
        ground = sqrt(
            state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
        )
        if kind == LANDING:
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
        # The height follows the slope without lag: what the error asks for comes on top of the slope.
        height -= sink * limits[HEIGHT_S]
        if state[col.POSITION_Z] <= max(
            limits[FLARE_HEIGHT], limits[FLARE_S] * max(-state[col.VELOCITY_Z], 0.0)
        ):
            state[DOING] = FLARE
    elif row[LEG_CLIMBS_ALONG] > 0.0 and not circling:
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
    dt = limits[STEP_S]
    state[THROTTLE] += (throttle - state[THROTTLE]) * dt / THROTTLE_S
    load = _fly(state, limits, bank, climb, rate, wx, wy, rising)
    if state[col.POSITION_Z] <= 0.0:
        state[col.POSITION_Z] = 0.0
        if landing:
            state[DOING] = ROLLING
            state[COURSE] = atan2(state[col.VELOCITY_X], state[col.VELOCITY_Y])
            state[col.VELOCITY_Z] = state[CLIMB] = 0.0
            return False
        state[col.VELOCITY_Z] = max(state[col.VELOCITY_Z], 0.0)
        state[CLIMB] = max(state[CLIMB], 0.0)
    if landing or arrived:
        return False
    if kind == TAKEOFF:
        return bool(state[col.POSITION_Z] >= row[LEG_Z])
    if kind == CIRCLE:
        return _circled(state, row, limits, step)
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
                rate = state[THROTTLE] * (limits[CLIMB_MAX] + limits[SINK_MIN]) - limits[SINK_MIN]
                rate -= excess_sink(limits, v, load)
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
