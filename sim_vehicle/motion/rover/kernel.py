"""The compiled motion of one ground vehicle: pure pursuit, turns within its radius or on the spot.

The model is described in docs/fixed-wing-and-rover.md; pure pursuit is that of R. C. Coulter, "Implementation
of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992. A vehicle without a force of its own has
the speed that is asked for and turns as it is asked to; PX4's simulated rover moves by `.sih`.
"""

from __future__ import annotations

from math import atan2, cos, inf, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import rover_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.multirotor.kernel import Floats, Integers
from sim_vehicle.motion.rover.layout import (
    ACCELERATION,
    AHEAD_GAIN,
    AHEAD_MAX,
    AHEAD_MIN,
    AT_ONCE,
    BEGIN,
    BRAKE,
    DECELERATION,
    ENERGY_LIMIT,
    FORCE,
    JERK,
    LATERAL,
    LEG_END_SPEED,
    LEG_HEADING,
    LEG_KIND,
    LEG_NEAR,
    LEG_PAUSE,
    LEG_RADIUS,
    LEG_SPEED,
    LEG_X,
    LEG_Y,
    PASSES,
    PAUSE_END,
    PIVOT_BEGIN,
    PIVOT_END,
    PIVOT_RATE,
    PIVOTING,
    RATE_ASKED,
    SIDEWAYS,
    SPEED,
    SPEED_MAX,
    STEERING_S,
    STEP_S,
    STOPPED,
    THROTTLE,
    THROUGH,
    TURN_RADIUS,
    TURN_RATE,
    VELOCITY,
    YAW_ACCELERATION,
    YAW_ASKED,
    YAW_P,
)
from sim_vehicle.motion.rover.sih import move, steer, thought_speed, throttle
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

CREEP = 0.3
PATIENCE_S = 60.0
SLOW_SHARE = 0.1
# A pivot slows down near the heading.
PIVOT_GAIN = 2.0


@compiled
def _bearing(state: Floats, row: Floats, limits: Floats, pace: float) -> float:
    """Return the bearing to the point that is pursued: on the leg, a look-ahead for a speed away."""
    x, y = state[col.POSITION_X], state[col.POSITION_Y]
    ahead = min(max(limits[AHEAD_GAIN] * pace, limits[AHEAD_MIN]), limits[AHEAD_MAX])
    gx, gy = row[LEG_X] - x, row[LEG_Y] - y
    dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
    length = sqrt(dx * dx + dy * dy)
    if gx * gx + gy * gy <= ahead * ahead or length < 1e-3:
        return atan2(gx, gy)
    tx, ty = dx / length, dy / length
    rx, ry = x - state[BEGIN], y - state[BEGIN + 1]
    along = rx * tx + ry * ty
    aside = rx * ty - ry * tx
    if abs(aside) >= ahead:
        point = min(max(along, 0.0), length)
    else:
        point = min(max(along + sqrt(ahead * ahead - aside * aside), 0.0), length)
    return atan2(state[BEGIN] + point * tx - x, state[BEGIN + 1] + point * ty - y)


@compiled
def _may_turn(state: Floats, row: Floats, sense: float, radius: float) -> bool:
    """Whether a position is not inside the tightest turn, round which the vehicle would circle for ever."""
    cx = state[col.POSITION_X] + sense * radius * cos(state[col.HEADING])
    cy = state[col.POSITION_Y] - sense * radius * sin(state[col.HEADING])
    dx, dy = row[LEG_X] - cx, row[LEG_Y] - cy
    inner = max(radius - row[LEG_RADIUS], 0.0)
    return bool(dx * dx + dy * dy > inner * inner)


@compiled
def _speed_before(limits: Floats, way: float, end: float) -> float:
    """Return the speed from which it can still slow down to another one.

    With a limit of the jerk as PX4's ``computeMaxSpeedFromDistance`` does it.
    """
    slow = limits[DECELERATION]
    if limits[JERK] == 0.0:
        return sqrt(end * end + 2.0 * 0.9 * slow * way)
    lost = 4.0 * slow * slow / limits[JERK]
    return float(max(0.5 * (sqrt(lost * lost + 4.0 * (2.0 * slow * way + end * end)) - lost), end))


@compiled
def _turned_to(state: Floats, limits: Floats, bearing: float, speed: float) -> float:
    """Return the rate of turning towards a bearing, as PX4 asks for it at a speed.

    The heading that is asked for goes to the bearing as fast as the vehicle can turn, unless it is nearer to
    that; the rate is in proportion to its error and has a limited acceleration.
    """
    dt, yaw = limits[STEP_S], state[col.HEADING]
    fastest = limits[TURN_RATE]
    if limits[TURN_RADIUS] > 0.0:
        fastest = min(fastest, speed / limits[TURN_RADIUS])
    gap = (bearing - state[YAW_ASKED] + pi) % (2.0 * pi) - pi
    state[YAW_ASKED] += min(max(gap, -fastest * dt), fastest * dt)
    error = (state[YAW_ASKED] - yaw + pi) % (2.0 * pi) - pi
    whole = (bearing - yaw + pi) % (2.0 * pi) - pi
    if abs(error) > abs(whole):
        state[YAW_ASKED], error = bearing, whole
    rate = min(max(limits[YAW_P] * error, -fastest), fastest)
    change = limits[YAW_ACCELERATION] * dt
    turns = state[col.HEADING_RATE]
    if abs(state[RATE_ASKED] - turns) > abs(rate - turns):
        state[RATE_ASKED] = turns
    state[RATE_ASKED] += min(max(rate - state[RATE_ASKED], -change), change)
    return float(state[RATE_ASKED])


@compiled
def _tick(state: Floats, row: Floats, arrived: bool, limits: Floats, step: int) -> bool:
    """Move one step and tell whether the leg is done."""
    dt = limits[STEP_S]
    kind = row[LEG_KIND]
    if kind == AT_ONCE and not arrived:
        return True
    speed, yaw = state[SPEED], state[col.HEADING]
    gx, gy = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
    left = sqrt(gx * gx + gy * gy)
    wanted, rate = 0.0, 0.0
    if not arrived and kind != BRAKE and state[PAUSE_END] == inf:
        if kind == VELOCITY:
            bearing, wanted = row[LEG_HEADING], row[LEG_SPEED]
        else:
            way = max(left - (row[LEG_RADIUS] if kind == THROUGH else 0.0), 0.0)
            end = row[LEG_END_SPEED] if kind == THROUGH else 0.0
            wanted = min(row[LEG_SPEED], _speed_before(limits, way, end))
            wanted = max(wanted, min(CREEP, row[LEG_SPEED]))
            bearing = _bearing(state, row, limits, wanted if limits[YAW_P] > 0.0 else speed)
        wanted = min(wanted, limits[SPEED_MAX])
        error = (bearing - yaw + pi) % (2.0 * pi) - pi
        if limits[PIVOT_BEGIN] > 0.0:
            if abs(error) > limits[PIVOT_BEGIN]:
                state[PIVOTING] = 1.0
            elif abs(error) < limits[PIVOT_END]:
                state[PIVOTING] = 0.0
        if state[PIVOTING] > 0.0:
            wanted = 0.0
            if speed < STOPPED:
                rate = min(max(PIVOT_GAIN * error, -limits[PIVOT_RATE]), limits[PIVOT_RATE])
        elif limits[YAW_P] > 0.0:
            pace = thought_speed(state, limits) if limits[FORCE] > 0.0 else speed
            rate = _turned_to(state, limits, bearing, pace)
            sense = 1.0 if error > 0.0 else -1.0
            radius = max(limits[TURN_RADIUS], speed / limits[TURN_RATE])
            inside = not _may_turn(state, row, sense, radius)
            if kind != VELOCITY and abs(error) > 0.5 and inside:
                rate = 0.0
            if speed > 0.1:
                most = limits[LATERAL] / speed
                rate = min(max(rate, -most), most)
        elif wanted > 0.0 or speed > 0.0:
            sense = 1.0 if error > 0.0 else -1.0
            radius = limits[TURN_RADIUS]
            if abs(error) > 0.6:
                wanted = min(wanted, max(sqrt(limits[LATERAL] * max(radius, 0.1)), CREEP))
            ahead = min(max(limits[AHEAD_GAIN] * speed, limits[AHEAD_MIN]), limits[AHEAD_MAX])
            ahead = max(min(ahead, left), 0.2) if kind != VELOCITY else ahead
            bend = 2.0 * sin(min(abs(error), 0.5 * pi)) / ahead
            if radius > 0.0:
                bend = min(bend, 1.0 / radius)
                if kind != VELOCITY and abs(error) > 0.5 and not _may_turn(state, row, sense, radius):
                    bend = 0.0
            if speed > 0.1:
                bend = min(bend, limits[LATERAL] / (speed * speed))
            rate = sense * min(bend * speed, limits[TURN_RATE])
    before, aside = speed, state[SIDEWAYS]
    if limits[FORCE] > 0.0:
        throttle(state, limits, wanted)
        steer(state, limits, rate)
        move(state, limits)
        speed = state[SPEED]
    else:
        change = limits[ACCELERATION] if wanted > speed else limits[DECELERATION]
        speed += min(max(wanted - speed, -change * dt), change * dt)
        state[THROTTLE] = speed / limits[SPEED_MAX]
        state[col.HEADING_RATE] += (rate - state[col.HEADING_RATE]) * min(dt / limits[STEERING_S], 1.0)
    if speed < 1e-6:
        speed = 0.0
    if speed == 0.0 and state[PIVOTING] == 0.0:
        state[col.HEADING_RATE] = 0.0
    middle = yaw + 0.5 * state[col.HEADING_RATE] * dt
    state[col.HEADING] = (yaw + state[col.HEADING_RATE] * dt) % (2.0 * pi)
    way, drift = 0.5 * (before + speed) * dt, 0.5 * (aside + state[SIDEWAYS]) * dt
    state[col.POSITION_X] += way * sin(middle) + drift * cos(middle)
    state[col.POSITION_Y] += way * cos(middle) - drift * sin(middle)
    state[col.PATH_LENGTH] += sqrt(way * way + drift * drift)
    aside, yaw = state[SIDEWAYS], state[col.HEADING]
    ve, vn = speed * sin(yaw) + aside * cos(yaw), speed * cos(yaw) - aside * sin(yaw)
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y] = (
        (ve - state[col.VELOCITY_X]) / dt,
        (vn - state[col.VELOCITY_Y]) / dt,
    )
    state[col.VELOCITY_X], state[col.VELOCITY_Y] = ve, vn
    state[SPEED] = speed
    if arrived or kind == VELOCITY:
        return False
    if kind == BRAKE:
        return bool(speed < STOPPED)
    gx, gy = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
    left2 = gx * gx + gy * gy
    dx, dy = row[LEG_X] - state[BEGIN], row[LEG_Y] - state[BEGIN + 1]
    past = gx * dx + gy * dy < 0.0 and dx * dx + dy * dy > 1e-4
    if kind == THROUGH:
        return bool(left2 <= row[LEG_RADIUS] * row[LEG_RADIUS] or (past and limits[PASSES] > 0.0))
    if state[PAUSE_END] == inf:
        if left2 > row[LEG_RADIUS] * row[LEG_RADIUS] and not (
            past and left2 < 4.0 * row[LEG_RADIUS] * row[LEG_RADIUS]
        ):
            return False
        state[PAUSE_END] = step + row[LEG_PAUSE] / limits[STEP_S]
        return False
    return bool(speed < STOPPED and step >= state[PAUSE_END])


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
    """Drive up to ``max_steps`` steps along the route, as `sim_vehicle.motion.multirotor.kernel.advance`.

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
            state[PAUSE_END] = inf
            state[PIVOTING] = 0.0
            if state[SPEED] == 0.0:
                state[YAW_ASKED], state[RATE_ASKED] = state[col.HEADING], 0.0
            state[BEGIN], state[BEGIN + 1] = state[col.POSITION_X], state[col.POSITION_Y]
            if leg > 0:
                state[BEGIN], state[BEGIN + 1] = route[leg - 1, LEG_X], route[leg - 1, LEG_Y]
            rx, ry = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
            slow = SLOW_SHARE * min(max(row[LEG_SPEED], CREEP), limits[SPEED_MAX])
            state[col.GIVE_UP_STEP] = (
                step + (PATIENCE_S + row[LEG_PAUSE] + sqrt(rx * rx + ry * ry) / slow) / limits[STEP_S]
            )
            if row[LEG_KIND] == VELOCITY:
                state[col.GIVE_UP_STEP] = 1e300
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            state[col.WIND_EAST], state[col.WIND_NORTH], _ = wind_at(wind[index], 0.0)
            speed = state[SPEED]
            head = (
                speed
                - state[col.WIND_EAST] * sin(state[col.HEADING])
                - state[col.WIND_NORTH] * cos(state[col.HEADING])
            )
            pull = state[col.ACCELERATION_X] * sin(state[col.HEADING]) + state[col.ACCELERATION_Y] * cos(
                state[col.HEADING]
            )
            state[col.POWER] = rover_power(power, speed, head, pull)
            mark_track(counters, step, track, track_every, state[col.POSITION_X], state[col.POSITION_Y], 0.0)
            if counters[col.ARRIVED] == 0 and step > state[col.GIVE_UP_STEP]:
                event = col.STALLED
                break
        done = _tick(state, row, counters[col.ARRIVED] != 0, limits, step)
        state[col.ENERGY_USED] += state[col.POWER] * limits[STEP_S]
        counters[col.STEP] = step + 1
        if counters[col.ARRIVED] == 0:
            if done:
                event = complete_leg(counters, arrivals, step + 1, stop_each)
                if counters[col.ARRIVED] == 0:
                    state[col.GIVE_UP_STEP] = inf
            elif counters[col.NEAR_TOLD] == 0 and row[LEG_NEAR] > 0.0:
                rx, ry = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
                if rx * rx + ry * ry < row[LEG_NEAR] * row[LEG_NEAR]:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state[col.ENERGY_USED] >= limits[ENERGY_LIMIT]:
            event = col.ENERGY
        if event != col.RAN:
            break
    return event
