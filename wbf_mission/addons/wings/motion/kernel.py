"""Compiled motion of a fixed wing: coordinated turns, energy, guidance along the legs of a route.

docs/fixed-wing-and-rover.md describes the model. Lengths are in metres, angles in radians, and axes
east-north-up from home. Headings are clockwise from north; banks and accelerations to the right are positive.
A vehicle is a record of `STATE` and a row of `COUNTERS` integers, as in
`sim_vehicle.motion.multirotor.kernel`; the first 19 columns and the counters are the same.
"""

from __future__ import annotations

from math import atan2, cos, inf, isnan, pi, sqrt

from geo.compiled import compiled
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
from wbf_mission.addons.wings.motion.guidance import circled, passed
from wbf_mission.addons.wings.motion.layout import NPFG
from wbf_mission.addons.wings.motion.px4 import px4_control

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

    This is the last leg's circle or, if the leg has no circle, a circle around the leg's end.
    """
    if counters[col.ARRIVED] == 0:
        state.give_up_step = inf
        return
    state.centre_x, state.centre_y, state.centre_z = row.x, row.y, row.z
    state.centre_radius = row.circle_radius if row.kind == at.CIRCLE else limits.loiter_radius
    if row.kind == at.TAKEOFF:
        state.centre_x, state.centre_y = state.position_x, state.position_y


advance = kernel_of(__name__, _enter, _feel, _move, _leave)
