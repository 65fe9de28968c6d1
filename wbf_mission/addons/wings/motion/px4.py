"""Compiled height, airspeed and bank control of PX4's fixed wing: total energy control, approach, flare."""

from __future__ import annotations

from math import atan, cos, isnan, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record
from wbf_mission.addons.wings.motion.air import energy_rate
from wbf_mission.addons.wings.motion.guidance import circles, ground_speed, leg_airspeed, steer
from wbf_mission.addons.wings.motion.layout import CIRCULAR_LANDING, FLARE, LANDING, LINE, SHORT, TAKEOFF

THROTTLE_S = 0.4


@compiled(allocates=False)
def _near_ground(state: Record, limits: Record, level: bool) -> float:
    """Return the bank limit near the ground, which keeps the wing tips clear, and a climb-out level."""
    bank = limits.bank_limit
    height = state.position_z
    if level and height < limits.level_height:
        bank = min(bank, limits.level_bank)
    tip = atan(max(2.0 * height, 0.0) / limits.wing_span)
    return float(min(bank, max(tip, 0.09)))


@compiled(allocates=False)
def _climb(state: Record, limits: Record, height: float, full: bool) -> float:
    """Return the climb rate towards a height; the rates are limited (``TECSReferenceModel``)."""
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
    """Return the height along a leg; the waypoint's height is reached one circle radius before it."""
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

    The throttle is predicted from the parameters, plus damping and an integral of the error, slow by default.
    Therefore a motor or a drag that differs from the parameters disturbs the airspeed for a minute.
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
