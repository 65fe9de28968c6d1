"""Compiled motion of a ground vehicle under ArduPilot's Rover; SI units, east-north from home.

Formulas after ArduPilot 4.7: `AR_WPNav.cpp` and Rover's `mode_auto.cpp`, `AR_PosControl.cpp`,
`AR_AttitudeControl.cpp`, `AR_PivotTurn.cpp`, `AP_MotorsUGV.cpp`, and the vehicle of its simulator,
`SIM_Rover.cpp`. The S-curves are computed by `sim_vehicle.motion.arducopter`. docs/fixed-wing-and-rover.md
explains the formulas.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, cos, inf, pi, radians, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter import control as at
from sim_vehicle.motion.arducopter.control import Guide, Law, halt, rooted
from sim_vehicle.motion.arducopter.guidance import end_of, lead_legs, make, take_next
from sim_vehicle.motion.arducopter.kernel import Own, chain
from sim_vehicle.motion.arducopter.scurve import TIME, change_speed
from sim_vehicle.motion.columns import Record, record_type
from sim_vehicle.motion.multirotor.kernel import Floats, Integers, Vector
from sim_vehicle.motion.stepping import kernel_of, take_velocity
from wbf_mission.addons.rovers.motion.kernel import PATIENCE_S, SLOW_SHARE, rover_power
from wbf_mission.addons.rovers.motion.layout import STOPPED

Drive = IntEnum(
    "Drive",
    "SPEED_ASKED TURN_ASKED "  # Demanded speed and turn rate, within limits.
    "STEER_ERROR STEER_I DRIVE_ERROR DRIVE_I "  # Filtered errors, and integrals.
    "PIVOTS "  # 1: turning on the spot; 2: pausing after the turn.
    "PIVOTS_NEXT "  # Whether to turn on the spot at the next waypoint.
    "STANDS",  # Whether a stop was commanded and reached.
    start=len(Guide),
)


# Parameters of the control law besides S-curves; SI units, radians, throttle and steering from -1 to 1.
DriveLaw = IntEnum(
    "DriveLaw",
    "ACCELERATION DECELERATION "  # Limits of the demanded acceleration.
    "LATERAL TURN_SPEED "  # Maximum lateral acceleration; speed kept in turns.
    "NEAR "  # Distance within which a stop counts as reached.
    "STEER_ACCELERATION STEER_RATE "  # Limits of the demanded turn rate.
    "STEER_FF STEER_P STEER_I STEER_IMAX STEER_FILTER "  # Controller of the turn rate by the steering.
    "SCALE_BASE "  # Speed above which the steering is scaled down.
    "TIGHTEST "  # Turn radius at full steering; 0 for a tracked vehicle.
    "STEER_LAG "  # Filter gain of turns of a tracked vehicle.
    # Turns on the spot (delay in steps); an angle of 0 disables them.
    "ANGLE_P PIVOT_ANGLE PIVOT_RATE PIVOT_DELAY "
    "DRIVE_BASE DRIVE_P DRIVE_I DRIVE_IMAX DRIVE_FILTER "  # Controller of the speed by the throttle.
    "STOP_SPEED "  # Speed below which a stopping vehicle has zero throttle.
    "TOP_SPEED DRIVE_LAG",  # Speed at full throttle; filter gain of the speed.
    start=len(Law),
)
GUIDE, LAW = record_type(Guide, Drive), record_type(Law, DriveLaw)

AT_ONCE = -1
"""Kind of a leg without effect on the ground."""


_PIVOTED = radians(5.0)
_LEAST_RATE = radians(1.0)
# Minimum speed for the conversion of lateral acceleration to turn rate.
_LEAST_SPEED_M_S = 1.0
# Heading estimates drift by half a degree (from recordings). Without this error, a vehicle would never turn
# to a target exactly behind it.
_HEADING_ERROR = radians(0.5)
# Wheel angle at full steering; at partial steering the curvature is proportional to the sine of the angle.
_LOCK = radians(35.0)
_SINE_OF_LOCK = sin(_LOCK)


@compiled(inline="always")
def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled(allocates=False)
def ask(state: Record, guide: Record, law: Record, step: int) -> float:
    """Set the demanded speed and return the demanded turn rate.

    The speed is the forward component of the wanted velocity. In a corner it stays above `turn_speed`, the
    speed of the tightest turn at half of the maximum lateral acceleration. The turn rate follows from the
    wanted lateral acceleration.
    """
    if guide.pivots != 0.0:
        _slow_down(guide, law, 0.0)
        return _pivot(state, guide, law, step) if guide.speed_asked == 0.0 else 0.0
    ex, ey = guide.px - state.position_x, guide.py - state.position_y
    size = sqrt(ex * ex + ey * ey)
    gain = rooted(size, law.pos_p, min(law.accel, law.lateral)) / size if size > 0.0 else 0.0
    wx, wy = guide.vx + gain * ex, guide.vy + gain * ey
    wanted = sqrt(wx * wx + wy * wy)
    if wanted > guide.level:
        wx, wy, wanted = wx * guide.level / wanted, wy * guide.level / wanted, guide.level
    ux, uy = wx - state.velocity_x, wy - state.velocity_y
    share = law.error_filter
    if guide.reset != 0.0:
        guide.reset, share = 0.0, 1.0
    guide.error_x += share * (ux - guide.error_x)
    guide.error_y += share * (uy - guide.error_y)
    ax = law.vel_p * guide.error_x + guide.ax
    ay = law.vel_p * guide.error_y + guide.ay
    heading = state.heading + _HEADING_ERROR
    sine, cosine = sin(heading), cos(heading)
    _slow_down(guide, law, max(wx * sine + wy * cosine, min(wanted, law.turn_speed)))
    return float((ax * cosine - ay * sine) / max(guide.speed_asked, _LEAST_SPEED_M_S))


@compiled(allocates=False)
def _slow_down(guide: Record, law: Record, wanted: float) -> None:
    """Change the demanded speed towards `wanted` within the acceleration limits."""
    before = guide.speed_asked
    change = (law.acceleration if wanted >= before else law.deceleration) * law.dt
    guide.speed_asked = before + _limited(wanted - before, change)


@compiled(allocates=False)
def _pivot(state: Record, guide: Record, law: Record, step: int) -> float:
    """Return the turn rate of a turn on the spot to the waypoint; the turn ends at an error of 5 degrees."""
    bearing = atan2(guide.end_x - state.position_x, guide.end_y - state.position_y)
    error = (bearing - state.heading + pi) % (2.0 * pi) - pi
    rate = _limited(law.angle_p * error, law.pivot_rate)
    rate = _limited(rate, sqrt(2.0 * abs(error) * law.steer_acceleration))
    if abs(error) < _PIVOTED and guide.pivots == 1.0:
        guide.pivots = 2.0
        guide.until = step + law.pivot_delay
    if guide.pivots == 2.0 and step >= guide.until:
        guide.pivots = 0.0
    return rate


@compiled(allocates=False)
def steer(state: Record, guide: Record, law: Record, rate: float) -> None:
    """Steer towards the demanded turn rate."""
    dt, speed = law.dt, abs(state.speed)
    rate = guide.turn_asked + _limited(rate - guide.turn_asked, law.steer_acceleration * dt)
    rate = _limited(rate, law.steer_rate)
    rate = _limited(rate, max(law.lateral / max(speed, _LEAST_SPEED_M_S), _LEAST_RATE))
    guide.turn_asked = rate
    if law.tightest == 0.0:
        state.heading_rate += (rate - state.heading_rate) * law.steer_lag
        return
    guide.steer_error += law.steer_filter * (rate - state.heading_rate - guide.steer_error)
    error = guide.steer_error
    # Wheels cannot turn a standing vehicle, so the integrator may only shrink while the vehicle stands.
    if speed > law.scale_base or error * guide.steer_i < 0.0:
        guide.steer_i = _limited(guide.steer_i + law.steer_i * error * dt, law.steer_imax)
    output = law.steer_ff * rate + law.steer_p * error + guide.steer_i
    if speed > law.scale_base > 0.0:
        output *= law.scale_base / speed
    # In reverse, the steering is inverted so that the vehicle turns as demanded.
    state.heading_rate = wheels(speed, output, law.tightest)


@compiled(allocates=False)
def centre(state: Record, guide: Record, law: Record) -> None:
    """Slow down to a stop with straight wheels."""
    _slow_down(guide, law, 0.0)
    guide.turn_asked = guide.steer_error = guide.steer_i = 0.0
    state.heading_rate = 0.0
    guide.reset = 1.0


@compiled(inline="always")
def wheels(speed: float, output: float, tightest: float) -> float:
    """Return the turn rate of steered wheels (`SIM_Rover.cpp`)."""
    return speed / tightest * sin(_LOCK * _limited(output, 1.0)) / _SINE_OF_LOCK


@compiled(allocates=False)
def drive(state: Record, guide: Record, law: Record) -> None:
    """Control the throttle for the demanded speed, and move one step."""
    dt, before = law.dt, state.speed
    asked = guide.speed_asked
    if asked != 0.0:
        guide.stands = 0.0
    elif abs(before) <= law.stop_speed:
        guide.stands = 1.0
    if guide.stands != 0.0:
        guide.drive_error = guide.drive_i = throttle = 0.0
    else:
        guide.drive_error += law.drive_filter * (asked - before - guide.drive_error)
        error = guide.drive_error
        throttle = law.drive_base * asked + law.drive_p * error + guide.drive_i
        if abs(throttle) < 1.0 or error * guide.drive_i < 0.0:
            guide.drive_i = _limited(guide.drive_i + law.drive_i * error * dt, law.drive_imax)
        throttle = _limited(throttle, 1.0)
    speed = before + law.drive_lag * (throttle * law.top_speed - before)
    if guide.stands != 0.0 and abs(speed) < STOPPED:
        speed = 0.0
    turn = state.heading_rate * dt
    middle = state.heading + 0.5 * turn
    state.heading = (state.heading + turn) % (2.0 * pi)
    way = 0.5 * (before + speed) * dt
    state.position_x += way * sin(middle)
    state.position_y += way * cos(middle)
    state.path_length += abs(way)
    ve, vn = speed * sin(state.heading), speed * cos(state.heading)
    take_velocity(state, ve, vn, state.velocity_z, dt)
    state.speed, state.throttle = speed, throttle


@compiled(allocates=False)
def look_along(state: Record, guide: Record) -> None:
    """Set the vehicle's lag behind the target, and its speed in the target's direction."""
    wx, wy = guide.vx, guide.vy
    wanted = sqrt(wx * wx + wy * wy)
    guide.lag = guide.along = 0.0
    if wanted > 1e-6:
        ex, ey = guide.px - state.position_x, guide.py - state.position_y
        guide.lag = (ex * wx + ey * wy) / wanted
        guide.along = (state.velocity_x * wx + state.velocity_y * wy) / wanted


@compiled(allocates=False)
def _stop_here(state: Record, guide: Record, law: Record) -> None:
    """Start the leg from the point where the vehicle would come to rest."""
    ahead = 0.5 * abs(state.speed) / law.deceleration
    guide.px = state.position_x + ahead * state.velocity_x
    guide.py = state.position_y + ahead * state.velocity_y
    guide.pz = 0.0
    halt(guide)
    guide.begin_x, guide.begin_y, guide.begin_z = guide.px, guide.py, guide.pz
    guide.end_x, guide.end_y, guide.end_z = guide.px, guide.py, guide.pz
    guide.pace = 1.0


@compiled(allocates=False)
def _turns_by(x: float, y: float, from_x: float, from_y: float, bearing: float) -> float:
    """Return the angle between a bearing and a leg; 0 if the leg has no length."""
    dx, dy = x - from_x, y - from_y
    if dx * dx + dy * dy < at.LEAST_WAY * at.LEAST_WAY:
        return 0.0
    return abs((atan2(dx, dy) - bearing + pi) % (2.0 * pi) - pi)


@compiled(allocates=False)
def begin(
    state: Record, guide: Record, law: Record, heads: Floats, curves: Floats, route: Record, leg: int
) -> None:
    """Start a leg; `guide.begins` is the transition from the previous leg."""
    how = guide.begins
    guide.begins = at.NOTHING
    guide.until, guide.done = inf, 0.0
    row = route[leg]
    before = guide.mode
    if int(row.kind) in (AT_ONCE, at.STAY):
        guide.mode = at.HOLDING
        return
    speed = row.speed if row.speed >= at.LEAST_SPEED else guide.level
    faster = speed != guide.level
    guide.level = speed
    if how == at.ANEW or before != at.LEGS:
        _stop_here(state, guide, law)
        before = at.NO_MODE
    guide.mode = at.LEGS
    if before == at.LEGS and faster:
        for i in range(1, 3):
            change_speed(heads[i], curves[i], speed, speed, speed)
    pivots = law.pivot_angle > 0.0
    if how != at.SAME:
        passed = before == at.LEGS and guide.fast != 0.0
        take_next(guide, law, heads, curves, row, before, 0.0)
        if not passed:
            guide.pivots = 0.0
            turn = _turns_by(row.x, row.y, state.position_x, state.position_y, state.heading)
            if pivots and (turn > law.pivot_angle or guide.pivots_next != 0.0):
                guide.pivots = 1.0
    elif guide.fast != 0.0 and heads[2, TIME] > 0.0:
        # The vehicle is already in the corner.
        return
    guide.fast = guide.pivots_next = 0.0
    if leg + 1 < len(route) and row.radius > 0.0 and row.pause <= 0.0:
        after = route[leg + 1]
        if 0.0 <= after.kind <= at.HOME:
            course = atan2(guide.end_x - guide.begin_x, guide.end_y - guide.begin_y)
            corner = _turns_by(after.x, after.y, guide.end_x, guide.end_y, course)
            if pivots and corner > law.pivot_angle:
                guide.pivots_next = 1.0
                return
            guide.fast = 1.0
            make(2, end_of(guide), (after.x, after.y, after.z), guide, law, heads, curves)


@compiled(allocates=False)
def _lead(state: Record, guide: Record, law: Record, heads: Floats, curves: Floats) -> bool:
    """Move the target one step, and return whether the leg is done."""
    if guide.pivots != 0.0:
        return False
    look_along(state, guide)
    done = lead_legs(guide, law, heads, curves)
    if done and guide.fast == 0.0:
        gx, gy = guide.end_x - state.position_x, guide.end_y - state.position_y
        dx, dy = guide.end_x - guide.begin_x, guide.end_y - guide.begin_y
        near = gx * gx + gy * gy <= law.near**2
        done = bool(near or gx * dx + gy * dy < 0.0)
    return done


@compiled(inline="always")
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> None:
    guide, law, leg = own[0][0], own[1][0], counters[col.LEG_INDEX]
    if guide.begins != at.NOTHING:
        begin(state, guide, law, own[2], own[3], route, leg)
        state.give_up_step = inf
    if state.give_up_step == inf:
        row = route[leg]
        left = sqrt((row.x - state.position_x) ** 2 + (row.y - state.position_y) ** 2)
        slowest = SLOW_SHARE * max(guide.level, at.LEAST_SPEED)
        state.give_up_step = counters[col.STEP] + (PATIENCE_S + row.pause + left / slowest) / law.dt


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: Own
) -> bool:
    state.wind_east, state.wind_north = air[0], air[1]
    speed, ux, uy = abs(state.speed), 0.0, 0.0
    if speed > 0.0:
        ux, uy = state.velocity_x / speed, state.velocity_y / speed
    head = speed - state.wind_east * ux - state.wind_north * uy
    pull = state.acceleration_x * ux + state.acceleration_y * uy
    state.power = rover_power(power, speed, head, pull)
    return bool(counters[col.ARRIVED] == 0 and counters[col.STEP] > state.give_up_step)


@compiled(inline="always")
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> bool:
    guide, law = own[0][0], own[1][0]
    step, leg = counters[col.STEP], counters[col.LEG_INDEX]
    row = route[leg]
    stops = guide.mode == at.HOLDING or counters[col.ARRIVED] != 0
    if stops:
        centre(state, guide, law)
    else:
        steer(state, guide, law, ask(state, guide, law, step))
    drive(state, guide, law)
    step += 1
    if counters[col.ARRIVED] != 0:
        return False
    if stops:
        done = row.kind == AT_ONCE or leg + 1 < len(route) or bool(abs(state.speed) < STOPPED)
    else:
        done = _lead(state, guide, law, own[2], own[3])
    if done and row.pause > 0.0 and guide.done == 0.0:
        guide.done = 1.0
        guide.until = step + round(row.pause / law.dt)
    if guide.done != 0.0:
        done = step >= guide.until
    return done


advance = kernel_of(__name__, _enter, _feel, _move, chain)
