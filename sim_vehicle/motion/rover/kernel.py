"""The compiled motion of one ground vehicle: pure pursuit, turns within its radius or on the spot.

The model is described in docs/fixed-wing-and-rover.md; pure pursuit is that of R. C. Coulter, "Implementation
of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992. State and counters begin as those of
`sim_vehicle.motion.multirotor.kernel`.
"""

from __future__ import annotations

from math import atan2, cos, inf, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import rover_power
from sim_vehicle.motion.columns import (
    ACCELERATION_X,
    ACCELERATION_Y,
    ARRIVED,
    ENERGY,
    ENERGY_USED,
    GIVE_UP_STEP,
    GRID,
    HEADING,
    HEADING_RATE,
    LEG_INDEX,
    NEAR,
    NEAR_TOLD,
    PATH_LENGTH,
    POSITION_X,
    POSITION_Y,
    POWER,
    RAN,
    REACHED,
    STALLED,
    STEP,
    TRACK_POINTS,
    VELOCITY_X,
    VELOCITY_Y,
    WIND,
    WIND_EAST,
    WIND_NORTH,
)
from sim_vehicle.motion.multirotor.kernel import Floats, Integers
from sim_vehicle.weather.gust_kernel import wind_at

# The state beyond the shared numbers: speed over ground, throttle (0 to 1), whether it turns on the spot,
# beginning of the leg (two numbers), step at which a pause ends (infinity: none runs).
SPEED, THROTTLE, PIVOTING, BEGIN, PAUSE_END = 19, 20, 21, 22, 24
STATE = 25

# One leg.
(
    LEG_X,
    LEG_Y,
    LEG_KIND,
    LEG_RADIUS,  # Acceptance radius.
    LEG_SPEED,
    LEG_NEAR,  # Distance to notify at.
    LEG_END_SPEED,  # Speed at its end.
    LEG_PAUSE,
    LEG_HEADING,  # Heading to keep.
) = range(9)
LEG = 9
THROUGH, STOP, AT_ONCE, VELOCITY, BRAKE = 0.0, 1.0, 2.0, 3.0, 4.0

# limits
(
    STEP_S,
    SPEED_MAX,
    ACCELERATION,
    DECELERATION,
    TURN_RADIUS,
    TURN_RATE,
    LATERAL,
    STEERING_S,
    AHEAD_GAIN,
    AHEAD_MIN,
    AHEAD_MAX,
    PIVOT_BEGIN,
    PIVOT_END,
    PIVOT_RATE,
    PASSES,
    ENERGY_LIMIT,
) = range(16)
LIMITS = 16

STOPPED = 0.05
CREEP = 0.3
PATIENCE_S = 60.0
SLOW_SHARE = 0.1
# A pivot slows down near the heading.
PIVOT_GAIN = 2.0


@compiled
def _bearing(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the bearing to the point that is pursued: on the leg, a look-ahead away."""
    x, y = state[POSITION_X], state[POSITION_Y]
    ahead = min(max(limits[AHEAD_GAIN] * state[SPEED], limits[AHEAD_MIN]), limits[AHEAD_MAX])
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
    cx = state[POSITION_X] + sense * radius * cos(state[HEADING])
    cy = state[POSITION_Y] - sense * radius * sin(state[HEADING])
    dx, dy = row[LEG_X] - cx, row[LEG_Y] - cy
    inner = max(radius - row[LEG_RADIUS], 0.0)
    return bool(dx * dx + dy * dy > inner * inner)


@compiled
def _tick(state: Floats, row: Floats, arrived: bool, limits: Floats, step: int) -> bool:
    """Move one step and tell whether the leg is done."""
    dt = limits[STEP_S]
    kind = row[LEG_KIND]
    if kind == AT_ONCE and not arrived:
        return True
    speed, yaw = state[SPEED], state[HEADING]
    gx, gy = row[LEG_X] - state[POSITION_X], row[LEG_Y] - state[POSITION_Y]
    left = sqrt(gx * gx + gy * gy)
    wanted, rate = 0.0, 0.0
    if not arrived and kind != BRAKE and state[PAUSE_END] == inf:
        if kind == VELOCITY:
            bearing, wanted = row[LEG_HEADING], row[LEG_SPEED]
        else:
            bearing = _bearing(state, row, limits)
            wanted = row[LEG_SPEED]
            way = max(left - (row[LEG_RADIUS] if kind == THROUGH else 0.0), 0.0)
            end = row[LEG_END_SPEED] if kind == THROUGH else 0.0
            wanted = min(wanted, sqrt(end * end + 2.0 * 0.9 * limits[DECELERATION] * way))
            wanted = max(wanted, min(CREEP, row[LEG_SPEED]))
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
    change = limits[ACCELERATION] if wanted > speed else limits[DECELERATION]
    before = speed
    speed += min(max(wanted - speed, -change * dt), change * dt)
    if speed < 1e-6:
        speed = 0.0
    state[HEADING_RATE] += (rate - state[HEADING_RATE]) * min(dt / limits[STEERING_S], 1.0)
    if speed == 0.0 and state[PIVOTING] == 0.0:
        state[HEADING_RATE] = 0.0
    middle = yaw + 0.5 * state[HEADING_RATE] * dt
    state[HEADING] = (yaw + state[HEADING_RATE] * dt) % (2.0 * pi)
    way = 0.5 * (before + speed) * dt
    state[POSITION_X] += way * sin(middle)
    state[POSITION_Y] += way * cos(middle)
    state[PATH_LENGTH] += way
    ve, vn = speed * sin(state[HEADING]), speed * cos(state[HEADING])
    state[ACCELERATION_X], state[ACCELERATION_Y] = (
        (ve - state[VELOCITY_X]) / dt,
        (vn - state[VELOCITY_Y]) / dt,
    )
    state[VELOCITY_X], state[VELOCITY_Y] = ve, vn
    state[SPEED] = speed
    state[THROTTLE] = speed / limits[SPEED_MAX]
    if arrived or kind == VELOCITY:
        return False
    if kind == BRAKE:
        return bool(speed < STOPPED)
    gx, gy = row[LEG_X] - state[POSITION_X], row[LEG_Y] - state[POSITION_Y]
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
    last = route.shape[0] - 1
    event = RAN
    for _ in range(max_steps):
        step, leg = counters[STEP], counters[LEG_INDEX]
        row = route[leg]
        if state[GIVE_UP_STEP] == inf:
            state[PAUSE_END] = inf
            state[PIVOTING] = 0.0
            state[BEGIN], state[BEGIN + 1] = state[POSITION_X], state[POSITION_Y]
            if leg > 0:
                state[BEGIN], state[BEGIN + 1] = route[leg - 1, LEG_X], route[leg - 1, LEG_Y]
            rx, ry = row[LEG_X] - state[POSITION_X], row[LEG_Y] - state[POSITION_Y]
            slow = SLOW_SHARE * min(max(row[LEG_SPEED], CREEP), limits[SPEED_MAX])
            state[GIVE_UP_STEP] = (
                step + (PATIENCE_S + row[LEG_PAUSE] + sqrt(rx * rx + ry * ry) / slow) / limits[STEP_S]
            )
            if row[LEG_KIND] == VELOCITY:
                state[GIVE_UP_STEP] = 1e300
        if step % GRID == 0:
            index = 0
            if wind.shape[0] > 1:
                index = step // GRID - first_wind
                if index >= wind.shape[0]:
                    event = WIND
                    break
            state[WIND_EAST], state[WIND_NORTH], _ = wind_at(wind[index], 0.0)
            speed = state[SPEED]
            head = speed - state[WIND_EAST] * sin(state[HEADING]) - state[WIND_NORTH] * cos(state[HEADING])
            pull = state[ACCELERATION_X] * sin(state[HEADING]) + state[ACCELERATION_Y] * cos(state[HEADING])
            state[POWER] = rover_power(power, speed, head, pull)
            if (
                track_every > 0
                and (step // GRID) % track_every == 0
                and counters[TRACK_POINTS] < track.shape[0]
            ):
                point = counters[TRACK_POINTS]
                track[point, 0], track[point, 1], track[point, 2] = state[POSITION_X], state[POSITION_Y], 0.0
                counters[TRACK_POINTS] = point + 1
            if counters[ARRIVED] == 0 and step > state[GIVE_UP_STEP]:
                event = STALLED
                break
        done = _tick(state, row, counters[ARRIVED] != 0, limits, step)
        state[ENERGY_USED] += state[POWER] * limits[STEP_S]
        counters[STEP] = step + 1
        if counters[ARRIVED] == 0:
            if done:
                arrivals[leg] = step + 1
                counters[NEAR_TOLD] = 0
                if leg == last:
                    counters[ARRIVED] = 1
                    event = REACHED
                else:
                    counters[LEG_INDEX] = leg + 1
                    state[GIVE_UP_STEP] = inf
                    if stop_each:
                        event = REACHED
            elif counters[NEAR_TOLD] == 0 and row[LEG_NEAR] > 0.0:
                rx, ry = row[LEG_X] - state[POSITION_X], row[LEG_Y] - state[POSITION_Y]
                if rx * rx + ry * ry < row[LEG_NEAR] * row[LEG_NEAR]:
                    counters[NEAR_TOLD] = 1
                    event = NEAR
        if state[ENERGY_USED] >= limits[ENERGY_LIMIT]:
            event = ENERGY
        if event != RAN:
            break
    return event
