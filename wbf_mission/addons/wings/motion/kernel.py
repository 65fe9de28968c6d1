"""Compiled motion of a fixed wing: coordinated turns, energy, guidance along the legs of a route.

This module controls height, airspeed and bank as PX4 does; `arduplane` controls them as ArduPlane does.

docs/fixed-wing-and-rover.md describes the model. Lengths are in metres, angles in radians, and axes
east-north-up from home. Headings are clockwise from north; banks and accelerations to the right are positive.
A vehicle is a record of `STATE` and a row of `COUNTERS` integers, as in
`sim_vehicle.motion.multirotor.kernel`; the first 19 columns and the counters are the same.
"""

from __future__ import annotations

from math import atan, atan2, cos, inf, isnan, pi, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.multirotor.kernel import Floats, Integers, Vector
from sim_vehicle.motion.stepping import kernel_of
from wbf_mission.addons.wings import kind as own_kind
from wbf_mission.addons.wings.motion import arduplane
from wbf_mission.addons.wings.motion import layout as at
from wbf_mission.addons.wings.motion.air import (
    blow,
    brake_rate,
    drop,
    energy_rate,
    fly,
    pitch_up,
    roll_on_ground,
    take_off,
)
from wbf_mission.addons.wings.motion.guidance import (
    circled,
    circles,
    ground_speed,
    leg_airspeed,
    passed,
    steer,
)
from wbf_mission.addons.wings.motion.layout import (
    CIRCULAR_LANDING,
    FLARE,
    LANDING,
    LINE,
    NPFG,
    SHORT,
    TAKEOFF,
)

THROTTLE_S = 0.4


@compiled(allocates=False)
def _near_ground(state: Record, limits: Record, level: bool) -> float:
    """Return the bank limit near the ground: the wing tips stay clear of it, and a climb-out stays level."""
    bank = limits.bank_limit
    height = state.position_z
    if level and height < limits.level_height:
        bank = min(bank, limits.level_bank)
    tip = atan(max(2.0 * height, 0.0) / limits.wing_span)
    return float(min(bank, max(tip, 0.09)))


@compiled(allocates=False)
def _climb(state: Record, limits: Record, height: float, full: bool) -> float:
    """Return the climb rate towards a height, with limited rate and acceleration (``TECSReferenceModel``)."""
    here, dt = state.position_z, limits.step_s
    if state.running == 0.0:
        state.running, state.reference_rate = 1.0, 0.0
        state.reference, state.throttle_integral, state.total_rate = here, 0.0, 0.0
    if full or state.doing == FLARE:
        state.reference, state.reference_rate = here, state.velocity_z
    else:
        gap, most = height - state.reference, limits.vertical_acceleration
        rate = sqrt(2.0 * most * abs(gap))
        rate = min(rate, limits.climb_rate) if gap > 0.0 else -min(rate, limits.sink_rate)
        state.reference_rate += min(max(rate - state.reference_rate, -most * dt), most * dt)
        state.reference += state.reference_rate * dt
    climb = (state.reference - here) / limits.height_s + limits.height_ahead * state.reference_rate
    return float(min(max(climb, -limits.sink_max), limits.climb_max))


@compiled(allocates=False)
def _height_along(state: Record, row: Record, limits: Record) -> float:
    """Return the height along a leg, which is the waypoint's from one circle radius before the end on."""
    dx, dy = row.x - state.begin_x, row.y - state.begin_y
    gx, gy = row.x - state.position_x, row.y - state.position_y
    before = abs(limits.loiter_radius)
    way = sqrt(dx * dx + dy * dy) - before
    if state.slope == 0.0 or way <= 0.0:
        return float(row.z)
    left = (sqrt(gx * gx + gy * gy) - before) / way
    return float(row.z - state.slope * min(max(left, 0.0), 1.0))


@compiled(allocates=False)
def _throttle(state: Record, limits: Record, asked: float, load: float) -> float:
    """Return the throttle for an energy rate divided by weight (``TECSControl::_calcThrottleControl``).

    The throttle is predicted from the parameters; damping and an integral of the error, slow by default, are
    added. Therefore a motor or a drag that differs from the parameters disturbs the airspeed for a minute.
    """
    most, least = limits.climb_max, -limits.sink_min
    asked = min(max(asked + limits.total_for_load * (load - 1.0) / GRAVITY_M_S2, least), most)
    level = limits.level_throttle
    predicted = level + (asked / most * (1.0 - level) if asked >= 0.0 else -asked / least * level)
    missing = (asked - state.total_rate) / (most - least)
    change = limits.total_integrator * missing * limits.step_s
    throttle = predicted + limits.total_damping * missing + state.throttle_integral
    if throttle >= limits.throttle_limit:
        change = min(change, 0.0)
    elif throttle <= 0.0:
        change = max(change, 0.0)
    state.throttle_integral += change
    return float(min(max(throttle, 0.0), limits.throttle_limit))


@compiled(allocates=False)
def _energy(
    state: Record, limits: Record, height: float, airspeed: float, load: float, full: bool
) -> tuple[float, float, float]:
    """Return throttle, climb rate and energy rate (divided by weight) demanded by total energy control.

    The sum of the demanded rates of height and speed sets the throttle (`_throttle`), and their difference
    sets the pitch. If energy is short, both height and speed fall short.
    """
    v = max(state.airspeed, SHORT)
    climb = _climb(state, limits, height, full)
    # Rate of kinetic energy divided by weight.
    fast = (airspeed - v) / limits.speed_s * v / GRAVITY_M_S2
    fast = min(max(fast, -0.5 * limits.sink_min), 0.5 * limits.climb_max)
    rate = energy_rate(limits, state.throttle, v, load)
    dt = limits.step_s
    state.total_rate += (rate - state.total_rate) * dt / (limits.total_s + dt)
    if full:
        throttle = limits.throttle_limit
        climb = limits.climb_max
    else:
        throttle = _throttle(state, limits, climb + fast, load)
    # Speed has priority in a climb-out, at low airspeed, and without power; spare energy goes into height.
    least_speed = min(limits.airspeed_min, limits.landing_airspeed)
    slow = min(max(10.0 * (1.0 - v / least_speed), 0.0), 1.0)
    if full or limits.throttle_limit == 0.0:
        slow = 1.0
    climb = (1.0 - slow) * 0.5 * (rate + climb - fast) + slow * (rate - fast)
    return throttle, min(max(climb, -limits.sink_max), limits.climb_max), rate


@compiled(allocates=False)
def _approach(state: Record, row: Record, limits: Record) -> float:
    """Return the demanded height of an approach, and start the flare when the vehicle is low."""
    if row.kind == LANDING:
        dx, dy = row.x - state.begin_x, row.y - state.begin_y
        length = max(sqrt(dx * dx + dy * dy), 1e-3)
        to_go = ((row.x - state.position_x) * dx + (row.y - state.position_y) * dy) / length
        slope = max(state.begin_z, 1.0) / length
        # The line continues below the ground, to avoid slowing down before the flare.
        height = min(slope * to_go, max(state.begin_z, 0.0))
    else:
        # Circular descent: the demanded height is below the vehicle, so that it sinks at the slope's rate.
        height = state.position_z - row.slope * ground_speed(state) * limits.height_s
    if state.position_z <= max(limits.flare_height, limits.flare_s * max(-state.velocity_z, 0.0)):
        state.doing = FLARE
        state.since = 0.0
        state.flare_rate = state.velocity_z
    return float(height)


@compiled(allocates=False)
def px4_control(
    state: Record, row: Record, arrived: bool, limits: Record, wx: float, wy: float
) -> tuple[float, float, float]:
    """Move the throttle as PX4 does; return the commanded bank and climb rate, and the energy rate."""
    kind = row.kind
    landing = kind in (LANDING, CIRCULAR_LANDING)
    circling = circles(state, row, arrived)
    lateral, be, bn = steer(state, row, arrived, limits, wx, wy)
    rolls = _near_ground(state, limits, kind == TAKEOFF)
    if state.doing == FLARE:
        rolls = min(rolls, 0.09)
    bank = min(max(atan(lateral / GRAVITY_M_S2), -rolls), rolls)
    airspeed = leg_airspeed(row, arrived, limits, be, bn, wx, wy)
    load = 1.0 / cos(state.bank)
    full = kind == TAKEOFF and not arrived
    height = state.centre_z if arrived and not landing else row.z
    if full:
        height = row.z + 10.0 * limits.height_s
    elif landing:
        height = _approach(state, row, limits)
    elif row.on_circle > 0.0 and not arrived and isnan(state.bearing):
        height = state.target
    elif kind == LINE and not circling:
        height = _height_along(state, row, limits)
    if state.doing == FLARE:
        throttle, _, rate = _energy(state, limits, height, airspeed, load, False)
        # The throttle closes first; then the sink rate falls to that of touchdown.
        state.since += limits.step_s
        passed = state.since / limits.flare_s
        throttle = min(throttle, 1.0 - sqrt(min(passed, 1.0)))
        # On a circle, throttle and sink rate fall together.
        waits = 1.0 if kind == LANDING else 0.0
        share = sqrt(min(max(passed - waits, 0.0), 1.0))
        climb = (1.0 - share) * state.flare_rate - share * limits.flare_sink
    else:
        throttle, climb, rate = _energy(state, limits, height, airspeed, load, full)
        if full:
            state.since += limits.step_s
            if state.since < limits.rotation_s:
                climb *= state.since / limits.rotation_s
    state.throttle += (throttle - state.throttle) * limits.step_s / THROTTLE_S
    return bank, climb, rate


fixed_wing_power = compiled(allocates=False)(own_kind.fixed_wing_power)

# A leg times out after this time plus the time that the leg takes at a slow speed.
PATIENCE_S = 120.0
SLOW_SHARE = 0.15


@compiled(allocates=False)
def _patience_steps(state: Record, row: Record, limits: Record) -> float:
    """Return the timeout of a leg (steps)."""
    east, north = row.x - state.position_x, row.y - state.position_y
    way = sqrt(east * east + north * north)
    trim = limits.airspeed_trim
    seconds = PATIENCE_S + way / (SLOW_SHARE * trim) + abs(row.z - state.position_z) / 0.2 + 2.0 * row.pause
    seconds += (row.turns + 2.0) * 2.0 * pi * abs(row.circle_radius) / (0.2 * trim)
    return float(seconds / limits.step_s)


@compiled(allocates=False)
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: tuple[()]) -> None:
    """Start a leg, unless it has started."""
    if state.give_up_step != inf:
        return
    step, leg = counters[col.STEP], counters[col.LEG_INDEX]
    row = route[leg]
    state.give_up_step = step + _patience_steps(state, row, limits)
    state.turned, state.bearing, state.pause_end = 0.0, float("nan"), inf
    state.guidance = 0.0
    before = route[leg - 1].kind if leg > 0 else at.FALL
    # ArduPlane follows a line from the centre of the previous circle, but no line after a take-off.
    if before == at.LINE or (before == at.CIRCLE and limits.law != NPFG):
        state.begin_x, state.begin_y, state.begin_z = route[leg - 1].x, route[leg - 1].y, route[leg - 1].z
        state.direct = 0.0
    elif leg > 0 or isnan(state.begin_x):
        state.begin_x, state.begin_y, state.begin_z = state.position_x, state.position_y, state.position_z
        state.direct = 1.0
    else:
        state.direct = 0.0
    if limits.law == NPFG:
        # After a take-off, PX4 climbs at once (``calculateFirstOrderHoldAltitude``).
        state.slope = 0.0 if state.last_kind == at.TAKEOFF else row.z - state.begin_z
        state.target = state.position_z
    else:
        arduplane.begin_slope(state, row, limits)
    state.last_kind = row.kind
    landing = row.kind in (at.LANDING, at.CIRCULAR_LANDING)
    if state.doing == at.FLARE or (state.doing == at.ROLLING and not landing):
        state.doing = at.FLYING if state.doing == at.FLARE else at.ON_GROUND
    if state.doing == at.ON_GROUND:
        state.running = 0.0
        east, north = row.x - state.position_x, row.y - state.position_y
        if row.kind == at.TAKEOFF and east * east + north * north > 25.0:
            state.heading = atan2(east, north) % (2.0 * pi)
        state.course = state.heading
        state.since = state.throttle = 0.0
    elif row.kind == at.TAKEOFF:
        state.course = atan2(state.velocity_x, state.velocity_y)


@compiled(allocates=False)
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: tuple[()]) -> bool:
    """Move one step and return whether the leg is done."""
    step, arrived = counters[col.STEP], counters[col.ARRIVED] != 0
    row = route[counters[col.LEG_INDEX]]
    wx, wy, rising = state.wind_east, state.wind_north, state.wind_up
    kind = row.kind
    doing = state.doing
    if kind == at.FALL:
        drop(state, limits, wx, wy)
        return bool(state.position_z <= 0.0)
    if doing == at.ROLLING:
        state.throttle = 0.0
        roll_on_ground(state, limits, -brake_rate(state, limits), wx, wy)
        return bool(
            state.velocity_x * state.velocity_x + state.velocity_y * state.velocity_y
            < at.STOPPED_M_S * at.STOPPED_M_S
        )
    if doing == at.ON_GROUND:
        take_off(state, limits, wx, wy)
        return False
    # ArduPlane's guidance and energy control run at a lower rate.
    if limits.law == NPFG:
        bank, climb, rate = px4_control(state, row, arrived, limits, wx, wy)
    else:
        if step % col.GRID == 0 or state.running == 0.0:
            arduplane.arduplane_control(state, row, arrived, limits, wx, wy)
        bank = state.bank_demand
        state.throttle = min(state.throttle_demand, limits.throttle_limit)
        rate = energy_rate(limits, state.throttle, state.airspeed, 1.0 / cos(state.bank))
        climb = pitch_up(state, limits, state.pitch_demand)
    fly(state, limits, bank, climb, rate, wx, wy, rising)
    landing = kind in (at.LANDING, at.CIRCULAR_LANDING)
    if state.position_z <= 0.0:
        state.position_z = 0.0
        if landing:
            state.doing = at.ROLLING
            state.course = atan2(state.velocity_x, state.velocity_y)
            state.velocity_z = state.climb = 0.0
            return False
        state.velocity_z = max(state.velocity_z, 0.0)
        state.climb = max(state.climb, 0.0)
    if landing or arrived or (limits.law != NPFG and step % col.GRID != 0):
        return False
    if kind == at.TAKEOFF:
        return bool(state.position_z >= row.z)
    if kind == at.CIRCLE:
        return circled(state, row, limits, step)
    return passed(state, row, limits)


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: tuple[()]
) -> bool:
    wx, wy, up = air
    if wx != state.wind_east or wy != state.wind_north or up != state.wind_up:
        blow(state, wx, wy, up)
        state.wind_east, state.wind_north, state.wind_up = wx, wy, up
    v, rate, load = 0.0, 0.0, 1.0
    if state.doing == at.FLYING or state.doing == at.FLARE:
        load = 1.0 / cos(state.bank)
        rate = energy_rate(limits, state.throttle, state.airspeed, load)
        v = state.airspeed if state.throttle > 1e-3 else 0.0
    elif state.doing == at.ON_GROUND:
        v, rate = limits.airspeed_trim, limits.climb_max
    state.power = fixed_wing_power(power, v, rate, load)
    return bool(counters[col.ARRIVED] == 0 and counters[col.STEP] > state.give_up_step)


@compiled(inline="always")
def _leave(
    state: Record, counters: Integers, row: Record, route: Record, limits: Record, own: tuple[()]
) -> None:
    """End a leg; after the last leg, set the circle that the vehicle then flies.

    That circle is the last leg's circle or, if the leg has no circle, a circle around the leg's end.
    """
    if counters[col.ARRIVED] == 0:
        state.give_up_step = inf
        return
    state.centre_x, state.centre_y, state.centre_z = row.x, row.y, row.z
    state.centre_radius = row.circle_radius if row.kind == at.CIRCLE else limits.loiter_radius
    if row.kind == at.TAKEOFF:
        state.centre_x, state.centre_y = state.position_x, state.position_y


advance = kernel_of(__name__, _enter, _feel, _move, _leave)
