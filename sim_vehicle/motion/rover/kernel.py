"""The compiled motion of one ground vehicle: pure pursuit, turns within its radius or on the spot.

The model is described in docs/fixed-wing-and-rover.md; pure pursuit is that of R. C. Coulter, "Implementation
of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992. State and counters begin as those of
`sim_vehicle.motion.multirotor.kernel`.
"""

from __future__ import annotations

from math import atan2, cos, inf, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import rover_power
from sim_vehicle.motion.columns import ENERGY, GRID, NEAR, RAN, REACHED, STALLED, WIND
from sim_vehicle.motion.multirotor.kernel import Floats, Integers
from sim_vehicle.weather.gust_kernel import wind_at

# beyond the first 19: speed over ground 19, throttle 20 (0 to 1), whether it turns on the spot 21, beginning
# of the leg 22-23, step at which a pause ends 24 (infinity: none runs)
SPEED, THROTTLE, PIVOTING, BEGIN, PAUSE_END = 19, 20, 21, 22, 24
STATE = 25

# leg: target 0-1, kind 2, acceptance radius 3, speed 4, distance to notify at 5, speed at its end 6, pause 7,
# heading to keep 8
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
    x, y = state[0], state[1]
    ahead = min(max(limits[AHEAD_GAIN] * state[SPEED], limits[AHEAD_MIN]), limits[AHEAD_MAX])
    gx, gy = row[0] - x, row[1] - y
    dx, dy = row[0] - state[BEGIN], row[1] - state[BEGIN + 1]
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
    """Whether a place is not inside the tightest turn, round which the vehicle would circle for ever."""
    cx = state[0] + sense * radius * cos(state[9])
    cy = state[1] - sense * radius * sin(state[9])
    dx, dy = row[0] - cx, row[1] - cy
    inner = max(radius - row[3], 0.0)
    return bool(dx * dx + dy * dy > inner * inner)


@compiled
def _tick(state: Floats, row: Floats, arrived: bool, limits: Floats, step: int) -> bool:
    """Move one step and tell whether the leg is done."""
    dt = limits[STEP_S]
    kind = row[2]
    if kind == AT_ONCE and not arrived:
        return True
    speed, yaw = state[SPEED], state[9]
    gx, gy = row[0] - state[0], row[1] - state[1]
    left = sqrt(gx * gx + gy * gy)
    wanted, rate = 0.0, 0.0
    if not arrived and kind != BRAKE and state[PAUSE_END] == inf:
        if kind == VELOCITY:
            bearing, wanted = row[8], row[4]
        else:
            bearing = _bearing(state, row, limits)
            wanted = row[4]
            way = max(left - (row[3] if kind == THROUGH else 0.0), 0.0)
            end = row[6] if kind == THROUGH else 0.0
            wanted = min(wanted, sqrt(end * end + 2.0 * 0.9 * limits[DECELERATION] * way))
            wanted = max(wanted, min(CREEP, row[4]))
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
    state[10] += (rate - state[10]) * min(dt / limits[STEERING_S], 1.0)
    if speed == 0.0 and state[PIVOTING] == 0.0:
        state[10] = 0.0
    middle = yaw + 0.5 * state[10] * dt
    state[9] = (yaw + state[10] * dt) % (2.0 * pi)
    way = 0.5 * (before + speed) * dt
    state[0] += way * sin(middle)
    state[1] += way * cos(middle)
    state[12] += way
    ve, vn = speed * sin(state[9]), speed * cos(state[9])
    state[6], state[7] = (ve - state[3]) / dt, (vn - state[4]) / dt
    state[3], state[4] = ve, vn
    state[SPEED] = speed
    state[THROTTLE] = speed / limits[SPEED_MAX]
    if arrived or kind == VELOCITY:
        return False
    if kind == BRAKE:
        return bool(speed < STOPPED)
    gx, gy = row[0] - state[0], row[1] - state[1]
    left2 = gx * gx + gy * gy
    dx, dy = row[0] - state[BEGIN], row[1] - state[BEGIN + 1]
    past = gx * dx + gy * dy < 0.0 and dx * dx + dy * dy > 1e-4
    if kind == THROUGH:
        return bool(left2 <= row[3] * row[3] or (past and limits[PASSES] > 0.0))
    if state[PAUSE_END] == inf:
        if left2 > row[3] * row[3] and not (past and left2 < 4.0 * row[3] * row[3]):
            return False
        state[PAUSE_END] = step + row[7] / limits[STEP_S]
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
        step, leg = counters[0], counters[1]
        row = route[leg]
        if state[14] == inf:
            state[PAUSE_END] = inf
            state[PIVOTING] = 0.0
            state[BEGIN], state[BEGIN + 1] = state[0], state[1]
            if leg > 0:
                state[BEGIN], state[BEGIN + 1] = route[leg - 1, 0], route[leg - 1, 1]
            rx, ry = row[0] - state[0], row[1] - state[1]
            slow = SLOW_SHARE * min(max(row[4], CREEP), limits[SPEED_MAX])
            state[14] = step + (PATIENCE_S + row[7] + sqrt(rx * rx + ry * ry) / slow) / limits[STEP_S]
            if row[2] == VELOCITY:
                state[14] = 1e300
        if step % GRID == 0:
            index = 0
            if wind.shape[0] > 1:
                index = step // GRID - first_wind
                if index >= wind.shape[0]:
                    event = WIND
                    break
            state[15], state[16], _ = wind_at(wind[index], 0.0)
            speed = state[SPEED]
            head = speed - state[15] * sin(state[9]) - state[16] * cos(state[9])
            pull = state[6] * sin(state[9]) + state[7] * cos(state[9])
            state[13] = rover_power(power, speed, head, pull)
            if track_every > 0 and (step // GRID) % track_every == 0 and counters[5] < track.shape[0]:
                point = counters[5]
                track[point, 0], track[point, 1], track[point, 2] = state[0], state[1], 0.0
                counters[5] = point + 1
            if counters[3] == 0 and step > state[14]:
                event = STALLED
                break
        done = _tick(state, row, counters[3] != 0, limits, step)
        state[11] += state[13] * limits[STEP_S]
        counters[0] = step + 1
        if counters[3] == 0:
            if done:
                arrivals[leg] = step + 1
                counters[4] = 0
                if leg == last:
                    counters[3] = 1
                    event = REACHED
                else:
                    counters[1] = leg + 1
                    state[14] = inf
                    if stop_each:
                        event = REACHED
            elif counters[4] == 0 and row[5] > 0.0:
                rx, ry = row[0] - state[0], row[1] - state[1]
                if rx * rx + ry * ry < row[5] * row[5]:
                    counters[4] = 1
                    event = NEAR
        if state[11] >= limits[ENERGY_LIMIT]:
            event = ENERGY
        if event != RAN:
            break
    return event
