"""Compiled guidance of a fixed wing along the legs of a route: lines, circles and their completion.

Two guidance laws follow lines and circles; each returns a lateral acceleration. Axes are east and north.
Accelerations and errors to the right are positive.

PX4 uses NPFG: T. Stastny and R. Siegwart, "On Flying Backwards: Preventing Run-away of Small, Low-speed,
Fixed-wing UAVs in Strong Winds", IROS 2019, with the bearing law of T. Stastny, "L1 guidance logic extension
for small UAVs: handling high winds and small loiter radii", arXiv:1804.04209. ArduPilot uses L1: S. Park, J.
Deyst and J. P. How, "A New Nonlinear Guidance Logic for Trajectory Tracking", AIAA 2004-4900, with its PD law
for circles.
"""

from __future__ import annotations

from math import asin, atan2, cos, isnan, pi, sin, sqrt, tan

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record
from wbf_mission.addons.wings.motion import layout as at
from wbf_mission.addons.wings.motion.layout import NPFG, PERIOD_S

# If airspeed minus crosswind is below this (m/s), NPFG reduces the acceleration for curved paths.
AIRSPEED_BUFFER = 1.5
LEAST_RADIUS_M = 0.5
_CAPTURE = 0.7071
_LATE_S = 3.0
_DECIDED = 0.9 * pi
ALIGNED = 0.985
AHEAD_OF_LANDING_M = 200.0
_NEAR_CIRCLE = 3.0


@compiled(inline="always")
def ground_speed(state: Record) -> float:
    """Return the horizontal speed over ground."""
    return sqrt(state.velocity_x * state.velocity_x + state.velocity_y * state.velocity_y)


@compiled(inline="always")
def _error_bound(ground: float, limits: Record) -> float:
    """Return the distance to a path within which NPFG turns in to the path."""
    constant = limits.period * limits.damping
    return float(ground * constant if ground > 1.0 else 0.5 * constant * (ground * ground + 1.0))


@compiled(allocates=False)
def _switch_distance(state: Record, limits: Record) -> float:
    """Return the distance to a waypoint at which NPFG turns to the next leg."""
    return float(min(limits.switch_share * _error_bound(ground_speed(state), limits), 500.0))


@compiled(allocates=False)
def _l1_distance(ground: float, limits: Record) -> float:
    """Return L1's look-ahead distance."""
    return float(max(limits.damping * limits.period * ground / pi, 0.1))


@compiled(allocates=False)
def _feasible(across: float, along: float, airspeed: float, wind: float) -> float:
    across = wind if along < 0.0 else abs(across)
    share = min(max((airspeed - across) / AIRSPEED_BUFFER, 0.0), 1.0)
    s = sin(0.5 * pi * share)
    return float(s * s)


@compiled(allocates=False)
def _npfg(
    state: Record, limits: Record, error: float, te: float, tn: float, curvature: float, we: float, wn: float
) -> tuple[float, float, float]:
    """Return NPFG's lateral acceleration and demanded bearing (east, north).

    `error` is the vehicle's distance from a path (m), positive if the vehicle is to its right. The path has
    the unit tangent (`te`, `tn`) and a curvature, positive to the right.
    """
    ve, vn = state.velocity_x, state.velocity_y
    bound = _error_bound(ground_speed(state), limits)
    ae, an = ve - we, vn - wn
    airspeed = max(sqrt(ae * ae + an * an), 1.0)
    wind = sqrt(we * we + wn * wn)
    near = min(abs(error) / bound, 1.0) - 1.0
    ahead = 0.5 * pi * near * near
    toward, along = cos(ahead), sin(ahead)
    side = -toward if error > 0.0 else toward
    # The right-hand normal of the tangent is (tn, -te).
    be, bn = along * te + side * tn, along * tn - side * te
    wind_across, wind_along = wn * be - we * bn, we * be + wn * bn
    path_across, path_along = wn * te - we * tn, we * te + wn * tn
    acceleration = 0.0
    if curvature != 0.0:
        bent = curvature / max(1.0 - curvature * error, abs(curvature) * LEAST_RADIUS_M)
        rate = bent * max(ve * te + vn * tn, 0.0)
        free = airspeed * airspeed - path_across * path_across
        ratio = 1.0 + path_along / max(sqrt(free) if free > 0.0 else 0.0, 0.1)
        held = _feasible(path_across, path_along, airspeed, wind) * _feasible(
            wind_across, wind_along, airspeed, wind
        )
        acceleration = airspeed * ratio * rate * held * along * along
    if abs(wind_across) < airspeed and (wind_along > 0.0 or wind < airspeed):
        # Wind triangle: with this heading, the course over ground is the bearing.
        forward = sqrt(airspeed * airspeed - wind_across * wind_across)
        he = forward * be + wind_across * bn
        hn = forward * bn - wind_across * be
    else:
        away = wind * wind - airspeed * airspeed
        away = sqrt(away) if away > 0.0 else 0.0
        he, hn = away * be - we, away * bn - wn
    size = max(sqrt(he * he + hn * hn), 1e-6)
    he, hn = he / size, hn / size
    turn = an * he - ae * hn
    if ae * he + an * hn < 0.0:
        turn = airspeed if turn >= 0.0 else -airspeed
    return acceleration + 4.0 * pi * limits.damping / limits.period * turn, be, bn


@compiled(allocates=False)
def _decide(nu: float, state: Record) -> float:
    """Limit the angle to the goal; while the goal is behind the vehicle, keep the turn direction."""
    last = state.guidance
    if abs(nu) > _DECIDED and abs(last) > _DECIDED and nu * last < 0.0:
        nu = last
    state.guidance = nu
    return float(min(max(nu, -0.5 * pi), 0.5 * pi))


@compiled(allocates=False)
def _l1_line(
    state: Record, limits: Record, rx: float, ry: float, te: float, tn: float, length: float
) -> tuple[float, float, float]:
    """Return L1's lateral acceleration along a leg, and its bearing (east, north).

    (`rx`, `ry`) is the vehicle's position from the leg's start, (`te`, `tn`) the leg's unit direction.
    """
    ve, vn = state.velocity_x, state.velocity_y
    ground = max(ground_speed(state), 0.1)
    distance = _l1_distance(ground, limits)
    k, gain = 4.0 * limits.damping * limits.damping, limits.integral
    away = sqrt(rx * rx + ry * ry)
    along = rx * te + ry * tn
    be, bn = te, tn
    direct = False
    if away > distance and along / max(away, 1.0) < -_CAPTURE:
        be, bn = -rx / away, -ry / away
        direct = True
    elif along > length + _LATE_S * ground:
        be, bn = length * te - rx, length * tn - ry
        size = max(sqrt(be * be + bn * bn), 1e-6)
        be, bn = be / size, bn / size
        direct = True
    # Angle of the bearing to the right of the velocity.
    angle = atan2(vn * be - ve * bn, ve * be + vn * bn)
    if not direct:
        error = rx * tn - ry * te
        share = min(max(error / distance, -_CAPTURE), _CAPTURE)
        capture = -asin(share)
        if gain > 0.0 and abs(capture) < 0.0873:
            integral = state.guidance_integral + capture * gain * PERIOD_S
            state.guidance_integral = min(max(integral, -0.1), 0.1)
        capture += state.guidance_integral
        angle += capture
        c, s = cos(capture), sin(capture)
        be, bn = be * c + bn * s, bn * c - be * s
    angle = _decide(angle, state)
    return k * ground * ground / distance * sin(angle), be, bn


@compiled(allocates=False)
def _l1_circle(state: Record, limits: Record, rx: float, ry: float, radius: float, sense: float) -> float:
    """Return L1's lateral acceleration to join and follow a circle, from a position relative to its centre.

    `sense` is 1 for clockwise, -1 for anticlockwise.
    """
    ve, vn, damping = state.velocity_x, state.velocity_y, limits.damping
    ground = max(ground_speed(state), 1.0)
    omega = 2.0 * pi / limits.period
    distance = _l1_distance(ground, limits)
    away = sqrt(rx * rx + ry * ry)
    if away > 0.1:
        oe, on = rx / away, ry / away
    else:
        oe, on = ve / ground, vn / ground
    # Velocity away from the centre, and clockwise around it.
    outward = ve * oe + vn * on
    clockwise = ve * on - vn * oe
    angle = _decide(atan2(clockwise, -outward), state)
    capture = 4.0 * damping * damping * ground * ground / distance * sin(angle)
    error = away - radius
    correction = error * omega * omega + outward * 2.0 * damping * omega
    tangent = clockwise * sense
    if outward > 0.0 and tangent < 0.0:
        correction = max(correction, 0.0)
    circle = sense * (correction + tangent * tangent / max(0.5 * radius, away))
    return float(capture) if error > 0.0 and sense * capture < sense * circle else float(circle)


@compiled(allocates=False)
def _steer_line(
    state: Record, row: Record, limits: Record, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the lateral acceleration along a leg, and its bearing."""
    dx, dy = row.x - state.begin_x, row.y - state.begin_y
    length = sqrt(dx * dx + dy * dy)
    rx, ry = state.position_x - state.begin_x, state.position_y - state.begin_y
    goal_x, goal_y = row.x - state.position_x, row.y - state.position_y
    if limits.law != NPFG:
        if state.direct > 0.0:
            length = 0.0
    elif length >= at.SHORT and row.kind != at.TAKEOFF:
        behind = dx * rx + dy * ry < 0.0
        near = _switch_distance(state, limits)
        if behind and rx * rx + ry * ry > near * near:
            dx, dy, length = -rx, -ry, sqrt(rx * rx + ry * ry)
            rx = ry = 0.0
        elif row.kind == at.LINE and (state.position_x - row.x) * dx + (state.position_y - row.y) * dy > 0.0:
            length = 0.0
    if length < at.SHORT:
        dx, dy, length, rx, ry = goal_x, goal_y, sqrt(goal_x * goal_x + goal_y * goal_y), 0.0, 0.0
        if length < 1e-6:
            dx, dy, length = sin(state.heading), cos(state.heading), 1.0
    te, tn = dx / length, dy / length
    if limits.law == NPFG:
        return _npfg(state, limits, rx * tn - ry * te, te, tn, 0.0, wx, wy)
    if row.kind == at.LANDING:
        # The vehicle keeps to the line beyond the landing point.
        length = length + sqrt(rx * rx + ry * ry) + AHEAD_OF_LANDING_M
    return _l1_line(state, limits, rx, ry, te, tn, length)


@compiled(allocates=False)
def _steer_circle(
    state: Record, x: float, y: float, radius: float, limits: Record, wx: float, wy: float
) -> float:
    """Return the lateral acceleration to follow a circle."""
    rx, ry = state.position_x - x, state.position_y - y
    sense = 1.0 if radius > 0.0 else -1.0
    radius = abs(radius)
    if limits.law != NPFG:
        return _l1_circle(state, limits, rx, ry, radius, sense)
    away = sqrt(rx * rx + ry * ry)
    if away > 0.1:
        oe, on = rx / away, ry / away
    else:
        ground = max(ground_speed(state), 1e-3)
        oe, on = state.velocity_x / ground, state.velocity_y / ground
    # The clockwise tangent is the outward direction rotated to the right by 90 degrees.
    te, tn = sense * on, -sense * oe
    error = sense * (radius - away)
    return _npfg(state, limits, error, te, tn, sense / radius, wx, wy)[0]


@compiled(allocates=False)
def circles(state: Record, row: Record, arrived: bool) -> bool:
    """Return whether the vehicle is flying a circle."""
    if arrived or row.kind == at.LINE:
        return row.kind != at.LANDING and (arrived or not isnan(state.bearing))
    return row.kind in (at.CIRCLE, at.CIRCULAR_LANDING)


@compiled(allocates=False)
def _comes_along_line(state: Record, row: Record, limits: Record) -> bool:
    """Return whether ArduPlane still flies along the line from the last waypoint to a mission's circle.

    ArduPlane leaves the line near the circle (``Plane::update_loiter``). A return has no such line.
    """
    of_mission = row.kind == at.CIRCLE and row.at_once == 0.0
    return bool(limits.law != NPFG and of_mission and isnan(state.bearing) and state.direct == 0.0)


@compiled(allocates=False)
def steer(
    state: Record, row: Record, arrived: bool, limits: Record, wx: float, wy: float
) -> tuple[float, float, float]:
    """Return the guidance's lateral acceleration, and the bearing along a line (0, 0 on a circle)."""
    kind = row.kind
    if state.doing == at.FLARE and (limits.law == NPFG or kind != at.LANDING):
        return 0.0, 0.0, 0.0
    if circles(state, row, arrived):
        x, y, radius = row.x, row.y, row.circle_radius
        if arrived and kind != at.CIRCULAR_LANDING:
            x, y, radius = state.centre_x, state.centre_y, state.centre_radius
        elif _comes_along_line(state, row, limits):
            east, north = state.position_x - x, state.position_y - y
            if east * east + north * north > _NEAR_CIRCLE * _NEAR_CIRCLE * radius * radius:
                return _steer_line(state, row, limits, wx, wy)
        return _steer_circle(state, x, y, radius, limits, wx, wy), 0.0, 0.0
    if kind != at.TAKEOFF:
        return _steer_line(state, row, limits, wx, wy)
    ce, cn = sin(state.course), cos(state.course)
    if limits.law == NPFG:
        rx, ry = state.position_x - state.begin_x, state.position_y - state.begin_y
        return _npfg(state, limits, rx * cn - ry * ce, ce, cn, 0.0, wx, wy)
    rate = sqrt(2.0) * pi / limits.period
    error = (state.course - state.heading + pi) % (2.0 * pi) - pi
    error = min(max(error, -0.5 * pi), 0.5 * pi)
    return 2.0 * sin(error) * rate * state.airspeed, 0.0, 0.0


@compiled(allocates=False)
def leg_airspeed(
    row: Record, arrived: bool, limits: Record, be: float, bn: float, wx: float, wy: float
) -> float:
    """Return the airspeed of a leg, raised if the minimum ground speed along a bearing requires it."""
    kind = row.kind
    airspeed = row.airspeed
    if kind == at.TAKEOFF:
        airspeed = limits.airspeed_trim if arrived else limits.takeoff_airspeed
    elif kind in (at.LANDING, at.CIRCULAR_LANDING):
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
    if limits.law == NPFG:
        return float(limits.acceptance)
    if row.radius > 0.0:
        return float(row.radius)
    near = min(limits.acceptance, _l1_distance(ground_speed(state), limits))
    return float(near * min(row.turn_angle / (0.5 * pi), 1.0))


@compiled(allocates=False)
def passed(state: Record, row: Record, limits: Record) -> bool:
    """Return whether a waypoint is reached."""
    east, north = state.position_x - row.x, state.position_y - row.y
    near = _acceptance(state, row, limits)
    close = east * east + north * north <= near * near
    if not close:
        dx, dy = row.x - state.begin_x, row.y - state.begin_y
        close = dx * dx + dy * dy > 1e-6 and east * dx + north * dy > 0.0
    if abs(row.z - state.position_z) <= row.height_tolerance:
        return close or not isnan(state.bearing)
    if close:
        # The remaining height is gained or lost on a circle around the waypoint.
        state.bearing = 0.0
    return False


@compiled(allocates=False)
def circled(state: Record, row: Record, limits: Record, step: int) -> bool:
    """Update the turn count of a circle and return whether the vehicle may leave it."""
    rx, ry = state.position_x - row.x, state.position_y - row.y
    away = sqrt(rx * rx + ry * ry)
    radius = abs(row.circle_radius)
    sense = 1.0 if row.circle_radius > 0.0 else -1.0
    if isnan(state.bearing):
        ground = ground_speed(state)
        room = radius + min(limits.acceptance, 0.5 * radius)
        if limits.law == NPFG:
            room = radius + max(limits.acceptance, _switch_distance(state, limits))
        # At a high ground speed the tightest turn may be wider than the circle.
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
    size = sqrt(ex * ex + ey * ey) * ground_speed(state)
    return size < 1.0 or ex * state.velocity_x + ey * state.velocity_y > ALIGNED * size
