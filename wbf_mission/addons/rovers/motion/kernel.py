"""Compiled motion of a ground vehicle: pure pursuit, with turns at a turn radius or on the spot.

docs/fixed-wing-and-rover.md describes the model. Pure pursuit follows R. C. Coulter, "Implementation of the
pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992. A vehicle without `force` reaches the demanded
speed and turn rate exactly; PX4's simulated rover uses `move`.
"""

from __future__ import annotations

from math import atan, atan2, cos, exp, inf, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.multirotor.kernel import Floats, Integers, Vector
from sim_vehicle.motion.stepping import kernel_of, take_velocity
from wbf_mission.addons.rovers import kind as own_kind
from wbf_mission.addons.rovers.motion.layout import AT_ONCE, BRAKE, STOPPED, THROUGH, VELOCITY

rover_power = compiled(allocates=False)(own_kind.rover_power)

CREEP = 0.3
PATIENCE_S = 60.0
SLOW_SHARE = 0.1
# Turn rate per heading error in a turn on the spot, which therefore slows down near its end.
PIVOT_GAIN = 2.0


# Rover of PX4's simulator: the bicycle model of ``Sih::generate_rover_ackermann_dynamics`` and the lag before
# it in ``Sih::read_motors`` (PX4 1.17, `sih.cpp`). PX4's controllers of the rover: ``AckermannRateControl``,
# ``AckermannActControl`` and ``RoverControl::speedControl``. Lags are integrated exactly over a step, because
# the time constants of the tyres are short at low speed. PX4 does not steer below its estimated speed of
# ``RO_SPEED_TH``.
_STEERS_M_S = 0.1


@compiled(allocates=False)
def thought_speed(state: Record, limits: Record) -> float:
    """Return the speed that PX4 estimates from the throttle, and uses for steering."""
    return float(state.throttle * limits.throttle_speed)


@compiled(allocates=False)
def steer(state: Record, limits: Record, rate: float) -> None:
    """Set the steering for a turn rate by feed-forward (for tyres without slip) and a PI loop."""
    speed, wanted = thought_speed(state, limits), 0.0
    if speed > _STEERS_M_S:
        error = rate - state.heading_rate
        wanted = limits.rate_ff * atan(rate * limits.wheel_base / speed)
        wanted += limits.rate_p * error + state.rate_integral
        wanted = min(max(wanted / limits.steer_max, -1.0), 1.0)
        integral = state.rate_integral + limits.rate_i * error * limits.step_s
        state.rate_integral = min(max(integral, -1.0), 1.0)
    else:
        state.rate_integral = 0.0
    change = wanted - state.steer_asked
    state.steer_asked += min(max(change, -limits.steer_step), limits.steer_step)


@compiled(allocates=False)
def throttle(state: Record, limits: Record, wanted: float) -> None:
    """Set the throttle for a speed, with limited acceleration."""
    dt = limits.step_s
    speed = sqrt(state.speed * state.speed + state.sideways * state.sideways)
    change = (limits.acceleration if wanted >= speed else limits.deceleration) * dt
    asked = state.speed_asked + min(max(wanted - state.speed_asked, -change), change)
    if abs(asked - speed) > abs(wanted - speed):
        asked = wanted
    state.speed_asked = asked
    share = 0.0
    if asked > 0.0:
        error = asked - speed
        state.speed_integral = min(max(state.speed_integral + limits.speed_i * error * dt, -1.0), 1.0)
        share = asked / limits.throttle_speed + limits.speed_p * error + state.speed_integral
        share = min(max(share, -1.0), 1.0)
    else:
        state.speed_integral = 0.0
    state.throttle = share


@compiled(allocates=False)
def move(state: Record, limits: Record) -> None:
    """Update the ground velocity and turn rate by one step of PX4's simulator.

    Drag acts along each axis of the Earth separately, so it depends on the direction of travel. As in the
    simulator, the sideways speed lost in a turn counts twice: in the tyre force, and in the motion itself.
    """
    dt, ahead, right, yaw = limits.step_s, state.speed, state.sideways, state.heading
    share = limits.actuator_share
    state.push += share * (state.throttle - state.push)
    state.steer += share * (state.steer_asked - state.steer)
    total = sqrt(ahead * ahead + right * right)
    north = ahead * cos(yaw) - right * sin(yaw)
    east = ahead * sin(yaw) + right * cos(yaw)
    drag_north = drag_east = 0.0
    axes = ((limits.north_1, limits.east_1), (limits.north_2, limits.east_2), (limits.north_3, limits.east_3))
    for axis in range(3):
        to_north, to_east = axes[axis]
        along = north * to_north + east * to_east
        drag_north += limits.drag * along * abs(along) * to_north
        drag_east += limits.drag * along * abs(along) * to_east
    held = limits.friction / max(total, STOPPED)
    turns = state.heading_rate
    pull = limits.force * state.push - held * ahead + right * turns
    state.speed = max(ahead + (pull - drag_north * cos(yaw) - drag_east * sin(yaw)) * dt, 0.0)
    if ahead <= STOPPED:
        state.sideways = 0.0
        state.heading_rate = turns * exp(-limits.turn_damping * dt)
        return
    angle, base = limits.steer_max * state.steer, limits.wheel_base
    fade = limits.turn_grip * base * base / ahead + limits.turn_damping
    steady = limits.turn_grip * base * angle / fade
    state.heading_rate = steady + (turns - steady) * exp(-fade * dt)
    fade = 2.0 * limits.grip / ahead + held
    push = limits.grip * angle - 2.0 * ahead * turns + drag_north * sin(yaw) - drag_east * cos(yaw)
    steady = push / fade
    state.sideways = steady + (right - steady) * exp(-fade * dt)


@compiled(allocates=False)
def _bearing(state: Record, row: Record, limits: Record, pace: float) -> float:
    """Return the bearing to the pursued point on the leg, at the look-ahead distance for a speed."""
    x, y = state.position_x, state.position_y
    ahead = min(max(limits.ahead_gain * pace, limits.ahead_min), limits.ahead_max)
    gx, gy = row.x - x, row.y - y
    dx, dy = row.x - state.begin_x, row.y - state.begin_y
    length = sqrt(dx * dx + dy * dy)
    if gx * gx + gy * gy <= ahead * ahead or length < 1e-3:
        return atan2(gx, gy)
    tx, ty = dx / length, dy / length
    rx, ry = x - state.begin_x, y - state.begin_y
    along = rx * tx + ry * ty
    aside = rx * ty - ry * tx
    if abs(aside) >= ahead:
        point = min(max(along, 0.0), length)
    else:
        point = min(max(along + sqrt(ahead * ahead - aside * aside), 0.0), length)
    return atan2(state.begin_x + point * tx - x, state.begin_y + point * ty - y)


@compiled(allocates=False)
def _may_turn(state: Record, row: Record, sense: float, radius: float) -> bool:
    """Return whether a waypoint is outside the tightest turn; otherwise the vehicle would circle round it."""
    cx = state.position_x + sense * radius * cos(state.heading)
    cy = state.position_y - sense * radius * sin(state.heading)
    dx, dy = row.x - cx, row.y - cy
    inner = max(radius - row.radius, 0.0)
    return bool(dx * dx + dy * dy > inner * inner)


@compiled(allocates=False)
def _speed_before(limits: Record, way: float, end: float) -> float:
    """Return the maximum speed from which the vehicle can slow down to `end` within `way`.

    With a jerk limit, the formula is PX4's ``computeMaxSpeedFromDistance``.
    """
    slow = limits.deceleration
    if limits.jerk == 0.0:
        return sqrt(end * end + 2.0 * 0.9 * slow * way)
    lost = 4.0 * slow * slow / limits.jerk
    return float(max(0.5 * (sqrt(lost * lost + 4.0 * (2.0 * slow * way + end * end)) - lost), end))


@compiled(allocates=False)
def _turned_to(state: Record, limits: Record, bearing: float, speed: float) -> float:
    """Return PX4's demanded turn rate towards a bearing at a speed.

    The demanded heading moves to the bearing as fast as possible, but is never farther from the bearing than
    the vehicle's heading. The turn rate is proportional to the heading error, with limited acceleration.
    """
    dt, yaw = limits.step_s, state.heading
    fastest = limits.turn_rate
    if limits.turn_radius > 0.0:
        fastest = min(fastest, speed / limits.turn_radius)
    gap = (bearing - state.yaw_asked + pi) % (2.0 * pi) - pi
    state.yaw_asked += min(max(gap, -fastest * dt), fastest * dt)
    error = (state.yaw_asked - yaw + pi) % (2.0 * pi) - pi
    whole = (bearing - yaw + pi) % (2.0 * pi) - pi
    if abs(error) > abs(whole):
        state.yaw_asked, error = bearing, whole
    rate = min(max(limits.yaw_p * error, -fastest), fastest)
    change = limits.yaw_acceleration * dt
    turns = state.heading_rate
    if abs(state.rate_asked - turns) > abs(rate - turns):
        state.rate_asked = turns
    state.rate_asked += min(max(rate - state.rate_asked, -change), change)
    return float(state.rate_asked)


@compiled(allocates=False)
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: tuple[()]) -> bool:
    """Move one step and return whether the leg is done."""
    row, arrived = route[counters[col.LEG_INDEX]], counters[col.ARRIVED] != 0
    dt = limits.step_s
    kind = row.kind
    if kind == AT_ONCE and not arrived:
        return True
    speed, yaw = state.speed, state.heading
    gx, gy = row.x - state.position_x, row.y - state.position_y
    left = sqrt(gx * gx + gy * gy)
    wanted, rate = 0.0, 0.0
    if not arrived and kind != BRAKE and state.pause_end == inf:
        if kind == VELOCITY:
            bearing, wanted = row.heading, row.speed
        else:
            way = max(left - (row.radius if kind == THROUGH else 0.0), 0.0)
            end = row.end_speed if kind == THROUGH else 0.0
            wanted = min(row.speed, _speed_before(limits, way, end))
            wanted = max(wanted, min(CREEP, row.speed))
            bearing = _bearing(state, row, limits, wanted if limits.yaw_p > 0.0 else speed)
        wanted = min(wanted, limits.speed_max)
        error = (bearing - yaw + pi) % (2.0 * pi) - pi
        if limits.pivot_begin > 0.0:
            if abs(error) > limits.pivot_begin:
                state.pivoting = 1.0
            elif abs(error) < limits.pivot_end:
                state.pivoting = 0.0
        if state.pivoting > 0.0:
            wanted = 0.0
            if speed < STOPPED:
                rate = min(max(PIVOT_GAIN * error, -limits.pivot_rate), limits.pivot_rate)
        elif limits.yaw_p > 0.0:
            pace = thought_speed(state, limits) if limits.force > 0.0 else speed
            rate = _turned_to(state, limits, bearing, pace)
            sense = 1.0 if error > 0.0 else -1.0
            radius = max(limits.turn_radius, speed / limits.turn_rate)
            inside = not _may_turn(state, row, sense, radius)
            if kind != VELOCITY and abs(error) > 0.5 and inside:
                rate = 0.0
            if speed > 0.1:
                most = limits.lateral / speed
                rate = min(max(rate, -most), most)
        elif wanted > 0.0 or speed > 0.0:
            sense = 1.0 if error > 0.0 else -1.0
            radius = limits.turn_radius
            if abs(error) > 0.6:
                wanted = min(wanted, max(sqrt(limits.lateral * max(radius, 0.1)), CREEP))
            ahead = min(max(limits.ahead_gain * speed, limits.ahead_min), limits.ahead_max)
            ahead = max(min(ahead, left), 0.2) if kind != VELOCITY else ahead
            bend = 2.0 * sin(min(abs(error), 0.5 * pi)) / ahead
            if radius > 0.0:
                bend = min(bend, 1.0 / radius)
                if kind != VELOCITY and abs(error) > 0.5 and not _may_turn(state, row, sense, radius):
                    bend = 0.0
            if speed > 0.1:
                bend = min(bend, limits.lateral / (speed * speed))
            rate = sense * min(bend * speed, limits.turn_rate)
    before, aside = speed, state.sideways
    if limits.force > 0.0:
        throttle(state, limits, wanted)
        steer(state, limits, rate)
        move(state, limits)
        speed = state.speed
    else:
        change = limits.acceleration if wanted > speed else limits.deceleration
        speed += min(max(wanted - speed, -change * dt), change * dt)
        state.throttle = speed / limits.speed_max
        state.heading_rate += (rate - state.heading_rate) * min(dt / limits.steering_s, 1.0)
    if speed < 1e-6:
        speed = 0.0
    if speed == 0.0 and state.pivoting == 0.0:
        state.heading_rate = 0.0
    middle = yaw + 0.5 * state.heading_rate * dt
    state.heading = (yaw + state.heading_rate * dt) % (2.0 * pi)
    way, drift = 0.5 * (before + speed) * dt, 0.5 * (aside + state.sideways) * dt
    state.position_x += way * sin(middle) + drift * cos(middle)
    state.position_y += way * cos(middle) - drift * sin(middle)
    state.path_length += sqrt(way * way + drift * drift)
    aside, yaw = state.sideways, state.heading
    ve, vn = speed * sin(yaw) + aside * cos(yaw), speed * cos(yaw) - aside * sin(yaw)
    take_velocity(state, ve, vn, state.velocity_z, dt)
    state.speed = speed
    if arrived or kind == VELOCITY:
        return False
    if kind == BRAKE:
        return bool(speed < STOPPED)
    gx, gy = row.x - state.position_x, row.y - state.position_y
    left2 = gx * gx + gy * gy
    dx, dy = row.x - state.begin_x, row.y - state.begin_y
    past = gx * dx + gy * dy < 0.0 and dx * dx + dy * dy > 1e-4
    if kind == THROUGH:
        return bool(left2 <= row.radius * row.radius or (past and limits.passes > 0.0))
    if state.pause_end == inf:
        if left2 > row.radius * row.radius and not (past and left2 < 4.0 * row.radius * row.radius):
            return False
        state.pause_end = counters[col.STEP] + row.pause / limits.step_s
        return False
    return bool(speed < STOPPED and counters[col.STEP] >= state.pause_end)


@compiled(inline="always")
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: tuple[()]) -> None:
    if state.give_up_step != inf:
        return
    step, leg = counters[col.STEP], counters[col.LEG_INDEX]
    row = route[leg]
    state.pause_end = inf
    state.pivoting = 0.0
    if state.speed == 0.0:
        state.yaw_asked, state.rate_asked = state.heading, 0.0
    state.begin_x, state.begin_y = state.position_x, state.position_y
    if leg > 0:
        state.begin_x, state.begin_y = route[leg - 1].x, route[leg - 1].y
    rx, ry = row.x - state.position_x, row.y - state.position_y
    slow = SLOW_SHARE * min(max(row.speed, CREEP), limits.speed_max)
    state.give_up_step = step + (PATIENCE_S + row.pause + sqrt(rx * rx + ry * ry) / slow) / limits.step_s
    if row.kind == VELOCITY:
        state.give_up_step = 1e300


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: tuple[()]
) -> bool:
    state.wind_east, state.wind_north = air[0], air[1]
    sine, cosine = sin(state.heading), cos(state.heading)
    head = state.speed - state.wind_east * sine - state.wind_north * cosine
    pull = state.acceleration_x * sine + state.acceleration_y * cosine
    state.power = rover_power(power, state.speed, head, pull)
    return bool(counters[col.ARRIVED] == 0 and counters[col.STEP] > state.give_up_step)


@compiled(inline="always")
def _leave(
    state: Record, counters: Integers, row: Record, route: Record, limits: Record, own: tuple[()]
) -> None:
    if counters[col.ARRIVED] == 0:
        state.give_up_step = inf


advance = kernel_of(__name__, _enter, _feel, _move, _leave)
