"""Guidance of a fixed wing along the legs of a route, compiled: lines, circles, and when they are done."""

from __future__ import annotations

from math import atan2, cos, isnan, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.fixed_wing.guidance import (
    NPFG,
    l1_circle,
    l1_distance,
    l1_line,
    npfg,
    switch_distance,
)
from sim_vehicle.motion.fixed_wing.layout import (
    CIRCLE,
    CIRCULAR_LANDING,
    FLARE,
    LANDING,
    LINE,
    SHORT,
    TAKEOFF,
)
from sim_vehicle.motion.fixed_wing.tecs import PERIOD_S

__all__ = ["circled", "circles", "leg_airspeed", "passed", "steer"]

ALIGNED = 0.985
AHEAD_OF_LANDING_M = 200.0
_NEAR_CIRCLE = 3.0


@compiled(allocates=False)
def _steer_line(
    state: Record, row: Record, limits: Record, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration along a leg, and its bearing."""
    ve, vn = state.velocity_x, state.velocity_y
    period, damping = limits.period, limits.damping
    dx, dy = row.x - state.begin_x, row.y - state.begin_y
    length = sqrt(dx * dx + dy * dy)
    rx, ry = state.position_x - state.begin_x, state.position_y - state.begin_y
    goal_x, goal_y = row.x - state.position_x, row.y - state.position_y
    if limits.law != NPFG:
        if length < SHORT or state.direct > 0.0:
            dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
            if length < 1e-6:
                dx, dy, length = sin(state.heading), cos(state.heading), 1.0
        if row.kind == LANDING:
            # Past the landing point it keeps the line.
            te, tn = dx / length, dy / length
            far = length + sqrt(rx * rx + ry * ry) + AHEAD_OF_LANDING_M
            return l1_line(
                rx, ry, te, tn, far, ve, vn, period, damping, limits.integral, PERIOD_S, state,
            )  # fmt: skip
        return l1_line(
            rx, ry, dx / length, dy / length, length, ve, vn, period, damping, limits.integral,
            PERIOD_S, state,
        )  # fmt: skip
    ground = sqrt(ve * ve + vn * vn)
    if length >= SHORT and row.kind != TAKEOFF:
        behind = dx * rx + dy * ry < 0.0
        near = switch_distance(ground, period, damping, limits.switch_share)
        if behind and rx * rx + ry * ry > near * near:
            dx, dy, length = -rx, -ry, sqrt(rx * rx + ry * ry)
            rx = ry = 0.0
        elif row.kind == LINE and (state.position_x - row.x) * dx + (state.position_y - row.y) * dy > 0.0:
            length = 0.0
    if length < SHORT:
        dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
        if length < 1e-6:
            dx, dy, length = sin(state.heading), cos(state.heading), 1.0
    te, tn = dx / length, dy / length
    return npfg(rx * tn - ry * te, te, tn, 0.0, ve, vn, wx, wy, period, damping)


@compiled(allocates=False)
def _steer_circle(
    state: Record, x: float, y: float, radius: float, limits: Record, wx: float, wy: float
) -> float:
    """Return the lateral acceleration to follow a circle."""
    ve, vn = state.velocity_x, state.velocity_y
    rx, ry = state.position_x - x, state.position_y - y
    sense = 1.0 if radius > 0.0 else -1.0
    radius = abs(radius)
    period, damping = limits.period, limits.damping
    if limits.law != NPFG:
        return l1_circle(rx, ry, radius, sense, ve, vn, period, damping, state)
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


@compiled(allocates=False)
def circles(state: Record, row: Record, arrived: bool) -> bool:
    """Tell whether a circle is flown now."""
    if arrived or row.kind == LINE:
        return row.kind != LANDING and (arrived or not isnan(state.bearing))
    return row.kind in (CIRCLE, CIRCULAR_LANDING)


@compiled(allocates=False)
def _comes_along_line(state: Record, row: Record, limits: Record) -> bool:
    """Tell whether ArduPlane comes to a circle of a mission along the line from the waypoint before.

    It does until it is near the circle (``Plane::update_loiter``); a return comes to the circle at once.
    """
    of_mission = row.kind == CIRCLE and row.at_once == 0.0
    return bool(limits.law != NPFG and of_mission and isnan(state.bearing) and state.direct == 0.0)


@compiled(allocates=False)
def steer(
    state: Record, row: Record, arrived: bool, limits: Record, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration that the guidance asks for, and the bearing of a line."""
    kind = row.kind
    if state.doing == FLARE and (limits.law == NPFG or kind != LANDING):
        return 0.0, 0.0, 0.0
    if circles(state, row, arrived):
        x, y, radius = row.x, row.y, row.circle_radius
        if arrived and kind != CIRCULAR_LANDING:
            x, y, radius = state.centre_x, state.centre_y, state.centre_radius
        elif _comes_along_line(state, row, limits):
            east, north = state.position_x - x, state.position_y - y
            if east * east + north * north > _NEAR_CIRCLE * _NEAR_CIRCLE * radius * radius:
                return _steer_line(state, row, limits, wx, wy)
        return _steer_circle(state, x, y, radius, limits, wx, wy), 0.0, 0.0
    if kind != TAKEOFF:
        return _steer_line(state, row, limits, wx, wy)
    ce, cn = sin(state.course), cos(state.course)
    if limits.law == NPFG:
        rx, ry = state.position_x - state.begin_x, state.position_y - state.begin_y
        return npfg(
            rx * cn - ry * ce, ce, cn, 0.0, state.velocity_x, state.velocity_y, wx, wy,
            limits.period, limits.damping,
        )  # fmt: skip
    rate = sqrt(2.0) * pi / limits.period
    error = (state.course - state.heading + pi) % (2.0 * pi) - pi
    error = min(max(error, -0.5 * pi), 0.5 * pi)
    return 2.0 * sin(error) * rate * state.airspeed, 0.0, 0.0


@compiled(allocates=False)
def leg_airspeed(
    row: Record, arrived: bool, limits: Record, be: float, bn: float, wx: float, wy: float
) -> float:
    """Return the airspeed of a leg, raised for the least ground speed along a bearing."""
    kind = row.kind
    airspeed = row.airspeed
    if kind == TAKEOFF:
        airspeed = limits.airspeed_trim if arrived else limits.takeoff_airspeed
    elif kind in (LANDING, CIRCULAR_LANDING):
        airspeed = limits.landing_airspeed
    ground = limits.ground_min
    if ground > 0.0 and (be != 0.0 or bn != 0.0):
        along, across = wx * be + wy * bn, wy * be - wx * bn
        if ground > along:
            airspeed = max(airspeed, sqrt((ground - along) ** 2 + across * across))
    return float(min(max(airspeed, min(limits.airspeed_min, limits.landing_airspeed)), limits.airspeed_max))


@compiled(allocates=False)
def _acceptance(state: Record, row: Record, limits: Record) -> float:
    """Return the distance at which a waypoint counts as reached."""
    ground = sqrt(state.velocity_x * state.velocity_x + state.velocity_y * state.velocity_y)
    if limits.law == NPFG:
        return float(limits.acceptance)
    if row.radius > 0.0:
        return float(row.radius)
    near = min(limits.acceptance, l1_distance(ground, limits.period, limits.damping))
    return float(near * min(row.turn_angle / (0.5 * pi), 1.0))


@compiled(allocates=False)
def passed(state: Record, row: Record, limits: Record) -> bool:
    """Tell whether a waypoint is reached."""
    east, north = state.position_x - row.x, state.position_y - row.y
    near = _acceptance(state, row, limits)
    close = east * east + north * north <= near * near
    if not close:
        dx, dy = row.x - state.begin_x, row.y - state.begin_y
        close = dx * dx + dy * dy > 1e-6 and east * dx + north * dy > 0.0
    if abs(row.z - state.position_z) <= row.height_tolerance:
        return close or not isnan(state.bearing)
    if close:
        # The height is still to come: it is reached on a circle about the waypoint.
        state.bearing = 0.0
    return False


@compiled(allocates=False)
def circled(state: Record, row: Record, limits: Record, step: int) -> bool:
    """Keep count on a circle and tell whether it may be left."""
    rx, ry = state.position_x - row.x, state.position_y - row.y
    away = sqrt(rx * rx + ry * ry)
    radius = abs(row.circle_radius)
    sense = 1.0 if row.circle_radius > 0.0 else -1.0
    if isnan(state.bearing):
        ground = sqrt(state.velocity_x * state.velocity_x + state.velocity_y * state.velocity_y)
        room = radius + min(limits.acceptance, 0.5 * radius)
        if limits.law == NPFG:
            near = switch_distance(ground, limits.period, limits.damping, limits.switch_share)
            room = radius + max(limits.acceptance, near)
        # An airspeed that is too high for the circle leads round it outside.
        tight = ground * ground / (GRAVITY_M_S2 * tan(limits.bank_limit))
        room = max(room, 2.2 * tight)
        height = state.target if row.on_circle > 0.0 else row.z
        if away > room or abs(height - state.position_z) > row.height_tolerance:
            return False
        state.bearing = atan2(rx, ry)
        state.turned = 0.0
        state.pause_end = step + row.pause / limits.step_s
    bearing = atan2(rx, ry)
    change = (bearing - state.bearing + pi) % (2.0 * pi) - pi
    state.turned += sense * change
    state.bearing = bearing
    if row.on_circle > 0.0 and abs(row.z - state.position_z) > row.height_tolerance:
        state.turned = 0.0
        return False
    if step < state.pause_end or state.turned < 2.0 * pi * row.turns:
        return False
    if isnan(row.exit_x) or state.turned > 2.0 * pi * (row.turns + 2.0):
        return True
    ex, ey = row.exit_x - state.position_x, row.exit_y - state.position_y
    size = sqrt(ex * ex + ey * ey) * sqrt(
        state.velocity_x * state.velocity_x + state.velocity_y * state.velocity_y
    )
    return size < 1.0 or ex * state.velocity_x + ey * state.velocity_y > ALIGNED * size
