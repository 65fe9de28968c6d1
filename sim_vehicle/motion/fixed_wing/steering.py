"""Guidance of a fixed wing along the legs of a route, compiled: lines, circles, and when they are done."""

from __future__ import annotations

from math import atan2, cos, isnan, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
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
from sim_vehicle.motion.fixed_wing.layout import (
    ACCEPTANCE,
    AIRSPEED,
    AIRSPEED_MAX,
    AIRSPEED_MIN,
    AIRSPEED_TRIM,
    BANK_LIMIT,
    BEARING,
    BEGIN,
    CENTRE,
    CENTRE_RADIUS,
    CIRCLE,
    CIRCULAR_LANDING,
    COURSE,
    DAMPING,
    DIRECT,
    DOING,
    FLARE,
    GROUND_MIN,
    GUIDANCE,
    INTEGRAL,
    LANDING,
    LANDING_AIRSPEED,
    LAW,
    LEG_AIRSPEED,
    LEG_AT_ONCE,
    LEG_CIRCLE_RADIUS,
    LEG_EXIT_X,
    LEG_EXIT_Y,
    LEG_HEIGHT_TOLERANCE,
    LEG_KIND,
    LEG_ON_CIRCLE,
    LEG_PAUSE,
    LEG_RADIUS,
    LEG_TURN_ANGLE,
    LEG_TURNS,
    LEG_X,
    LEG_Y,
    LEG_Z,
    LINE,
    PAUSE_END,
    PERIOD,
    SHORT,
    STEP_S,
    SWITCH_SHARE,
    TAKEOFF,
    TAKEOFF_AIRSPEED,
    TARGET,
    TURNED,
)
from sim_vehicle.motion.fixed_wing.tecs import PERIOD_S

__all__ = ["circled", "circles", "leg_airspeed", "passed", "steer"]

ALIGNED = 0.985
AHEAD_OF_LANDING_M = 200.0
_NEAR_CIRCLE = 3.0


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
        if length < SHORT or state[DIRECT] > 0.0:
            dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
            if length < 1e-6:
                dx, dy, length = sin(state[col.HEADING]), cos(state[col.HEADING]), 1.0
        if row[LEG_KIND] == LANDING:
            # Past the landing point it keeps the line.
            te, tn = dx / length, dy / length
            far = length + sqrt(rx * rx + ry * ry) + AHEAD_OF_LANDING_M
            return l1_line(
                rx, ry, te, tn, far, ve, vn, period, damping, limits[INTEGRAL], PERIOD_S, state,
                GUIDANCE,
            )  # fmt: skip
        return l1_line(
            rx, ry, dx / length, dy / length, length, ve, vn, period, damping, limits[INTEGRAL],
            PERIOD_S, state, GUIDANCE,
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
def circles(state: Floats, row: Floats, arrived: bool) -> bool:
    """Tell whether a circle is flown now."""
    if arrived or row[LEG_KIND] == LINE:
        return row[LEG_KIND] != LANDING and (arrived or not isnan(state[BEARING]))
    return row[LEG_KIND] in (CIRCLE, CIRCULAR_LANDING)


@compiled
def _comes_along_line(state: Floats, row: Floats, limits: Floats) -> bool:
    """Tell whether ArduPlane comes to a circle of a mission along the line from the waypoint before.

    It does until it is near the circle (``Plane::update_loiter``); a return comes to the circle at once.
    """
    of_mission = row[LEG_KIND] == CIRCLE and row[LEG_AT_ONCE] == 0.0
    return bool(limits[LAW] != NPFG and of_mission and isnan(state[BEARING]) and state[DIRECT] == 0.0)


@compiled
def steer(
    state: Floats, row: Floats, arrived: bool, limits: Floats, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration that the guidance asks for, and the bearing of a line."""
    kind = row[LEG_KIND]
    if state[DOING] == FLARE and (limits[LAW] == NPFG or kind != LANDING):
        return 0.0, 0.0, 0.0
    if circles(state, row, arrived):
        x, y, radius = row[LEG_X], row[LEG_Y], row[LEG_CIRCLE_RADIUS]
        if arrived and kind != CIRCULAR_LANDING:
            x, y, radius = state[CENTRE], state[CENTRE + 1], state[CENTRE_RADIUS]
        elif _comes_along_line(state, row, limits):
            east, north = state[col.POSITION_X] - x, state[col.POSITION_Y] - y
            if east * east + north * north > _NEAR_CIRCLE * _NEAR_CIRCLE * radius * radius:
                return _steer_line(state, row, limits, wx, wy)
        return _steer_circle(state, x, y, radius, limits, wx, wy), 0.0, 0.0
    if kind != TAKEOFF:
        return _steer_line(state, row, limits, wx, wy)
    ce, cn = sin(state[COURSE]), cos(state[COURSE])
    if limits[LAW] == NPFG:
        rx, ry = state[col.POSITION_X] - state[BEGIN], state[col.POSITION_Y] - state[BEGIN + 1]
        return npfg(
            rx * cn - ry * ce, ce, cn, 0.0, state[col.VELOCITY_X], state[col.VELOCITY_Y], wx, wy,
            limits[PERIOD], limits[DAMPING],
        )  # fmt: skip
    rate = sqrt(2.0) * pi / limits[PERIOD]
    error = (state[COURSE] - state[col.HEADING] + pi) % (2.0 * pi) - pi
    error = min(max(error, -0.5 * pi), 0.5 * pi)
    return 2.0 * sin(error) * rate * state[AIRSPEED], 0.0, 0.0


@compiled
def leg_airspeed(
    row: Floats, arrived: bool, limits: Floats, be: float, bn: float, wx: float, wy: float
) -> float:
    """Return the airspeed of a leg, raised for the least ground speed along a bearing."""
    kind = row[LEG_KIND]
    airspeed = row[LEG_AIRSPEED]
    if kind == TAKEOFF:
        airspeed = limits[AIRSPEED_TRIM] if arrived else limits[TAKEOFF_AIRSPEED]
    elif kind in (LANDING, CIRCULAR_LANDING):
        airspeed = limits[LANDING_AIRSPEED]
    ground = limits[GROUND_MIN]
    if ground > 0.0 and (be != 0.0 or bn != 0.0):
        along, across = wx * be + wy * bn, wy * be - wx * bn
        if ground > along:
            airspeed = max(airspeed, sqrt((ground - along) ** 2 + across * across))
    return float(
        min(max(airspeed, min(limits[AIRSPEED_MIN], limits[LANDING_AIRSPEED])), limits[AIRSPEED_MAX])
    )


@compiled
def _acceptance(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the distance at which a waypoint counts as reached."""
    ground = sqrt(
        state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
    )
    if limits[LAW] == NPFG:
        return float(limits[ACCEPTANCE])
    if row[LEG_RADIUS] > 0.0:
        return float(row[LEG_RADIUS])
    near = min(limits[ACCEPTANCE], l1_distance(ground, limits[PERIOD], limits[DAMPING]))
    return float(near * min(row[LEG_TURN_ANGLE] / (0.5 * pi), 1.0))


@compiled
def passed(state: Floats, row: Floats, limits: Floats) -> bool:
    """Tell whether a waypoint is reached."""
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
def circled(state: Floats, row: Floats, limits: Floats, step: int) -> bool:
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
        height = state[TARGET] if row[LEG_ON_CIRCLE] > 0.0 else row[LEG_Z]
        if away > room or abs(height - state[col.POSITION_Z]) > row[LEG_HEIGHT_TOLERANCE]:
            return False
        state[BEARING] = atan2(rx, ry)
        state[TURNED] = 0.0
        state[PAUSE_END] = step + row[LEG_PAUSE] / limits[STEP_S]
    bearing = atan2(rx, ry)
    change = (bearing - state[BEARING] + pi) % (2.0 * pi) - pi
    state[TURNED] += sense * change
    state[BEARING] = bearing
    if row[LEG_ON_CIRCLE] > 0.0 and abs(row[LEG_Z] - state[col.POSITION_Z]) > row[LEG_HEIGHT_TOLERANCE]:
        state[TURNED] = 0.0
        return False
    if step < state[PAUSE_END] or state[TURNED] < 2.0 * pi * row[LEG_TURNS]:
        return False
    if isnan(row[LEG_EXIT_X]) or state[TURNED] > 2.0 * pi * (row[LEG_TURNS] + 2.0):
        return True
    ex, ey = row[LEG_EXIT_X] - state[col.POSITION_X], row[LEG_EXIT_Y] - state[col.POSITION_Y]
    size = sqrt(ex * ex + ey * ey) * sqrt(
        state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
    )
    return size < 1.0 or ex * state[col.VELOCITY_X] + ey * state[col.VELOCITY_Y] > ALIGNED * size
