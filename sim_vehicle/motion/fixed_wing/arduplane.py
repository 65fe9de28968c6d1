"""ArduPlane's heights, airspeeds and banks along a route, compiled; pitch and throttle are left to TECS.

The published behaviour of ArduPlane 4.5 to 4.7 (``altitude.cpp``, ``takeoff.cpp``, ``Attitude.cpp``,
``AP_Landing_Slope.cpp``): slopes between waypoints, climb-out, approach, flare.
"""

from __future__ import annotations

from math import acos, atan, cos, isnan, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing import layout as at
from sim_vehicle.motion.fixed_wing import tecs
from sim_vehicle.motion.fixed_wing.forces import Floats

__all__ = ["ahead_of_landing", "begin_slope", "command_bank", "command_energy"]

# Above this height a climb, too, follows the line to the next waypoint.
_CLIMB_ALONG_M = 20.0
_LEVEL_OFF_FROM_M = 10.0
_LINED_UP_RAD = 0.1745
_ON_LINE_M = 5.0
_SLOW_BANK = 0.4363
# The line of an approach is aimed at a point so far behind the landing point.
_PROJECTION_M = 500.0


@compiled
def begin_slope(state: Floats, row: Floats, limits: Floats) -> None:
    """Decide at the beginning of a leg whether its height is reached at once or evenly."""
    rise = row[at.LEG_Z] - state[at.BEGIN + 2]
    along = state[col.POSITION_Z] > _CLIMB_ALONG_M or state[col.POSITION_Z] > row[at.LEG_Z]
    small = abs(rise) < limits[at.SLOPE_MIN]
    state[at.SLOPE] = 0.0 if small or not along or (rise > 0.0 and row[at.LEG_AT_ONCE] > 0.0) else rise
    state[at.STAGE] = at.LINING_UP
    state[at.LEVEL_OFF] = 0.0
    state[at.TARGET] = state[col.POSITION_Z]


@compiled
def ahead_of_landing(state: Floats, row: Floats) -> tuple[float, float]:
    """Return the length of the leg to a landing and the part of it that was flown."""
    dx, dy = row[at.LEG_X] - state[at.BEGIN], row[at.LEG_Y] - state[at.BEGIN + 1]
    length2 = max(dx * dx + dy * dy, 1.0)
    rx, ry = state[col.POSITION_X] - state[at.BEGIN], state[col.POSITION_Y] - state[at.BEGIN + 1]
    return sqrt(length2), (rx * dx + ry * dy) / length2


@compiled
def command_bank(state: Floats, limits: Floats, lateral: float, takeoff: bool, flaring: bool) -> None:
    """Set the demanded bank for a lateral acceleration, within what height and airspeed allow."""
    bank = atan(lateral / (GRAVITY_M_S2 * cos(state[at.PITCH])))
    limit = limits[at.BANK_LIMIT]
    height, level = state[col.POSITION_Z], limits[at.LEVEL_HEIGHT]
    if takeoff and height < 3.0 * level:
        part = max(height - level, 0.0) / max(2.0 * level, 0.1)
        limit = min(limit, limits[at.LEVEL_BANK] + part * (limit - limits[at.LEVEL_BANK]))
    if flaring:
        limit = min(limit, limits[at.LEVEL_BANK])
    # The load factor that the airspeed allows: it goes with its square.
    margin = state[at.AIRSPEED] / max(limits[at.AIRSPEED_MIN], 1.0)
    stall = acos(1.0 / (margin * margin)) if margin > 1.0 else 0.0
    limit = min(limit, max(stall, _SLOW_BANK))
    state[at.BANK_DEMAND] = min(max(bank, -limit), limit)


@compiled
def _approach_height(state: Floats, limits: Floats, length: float, portion: float) -> float:
    """Return the height on the line to the point where the flare is to begin."""
    top = state[at.BEGIN + 2]
    ve, vn = state[col.VELOCITY_X], state[col.VELOCITY_Y]
    ground = max(sqrt(ve * ve + vn * vn), 0.5)
    sink = top / max(length / ground, 0.5)
    aim = limits[at.FLARE_S] * sink
    if aim <= 0.0:
        aim = limits[at.FLARE_HEIGHT]
    if limits[at.FLARE_HEIGHT] > 0.0:
        aim = min(aim, 2.0 * limits[at.FLARE_HEIGHT])
    share = limits[at.FLARE_AIM]
    mean = max(share * limits[at.FLARE_SINK] + (1.0 - share) * sink, 0.1)
    before = min(ground * aim / mean, 0.5 * length)
    slope = (top - aim) / (length - before)
    low = aim - slope * _PROJECTION_M
    part = portion * length / (length - before + _PROJECTION_M)
    return float(min(max(top + (low - top) * min(max(part, 0.0), 1.0), low), top))


@compiled
def _land(state: Floats, row: Floats, limits: Floats, sink: float) -> tuple[float, float, float]:
    """Go on with a landing; return height and airspeed to fly, and the part of the leg that was flown."""
    length, portion = ahead_of_landing(state, row)
    height = state[col.POSITION_Z]
    straight = row[at.LEG_KIND] == at.LANDING
    if not straight:
        ve, vn = state[col.VELOCITY_X], state[col.VELOCITY_Y]
        state[at.STAGE] = max(state[at.STAGE], at.APPROACH)
        state[at.TARGET] = max(
            state[at.TARGET] - row[at.LEG_SLOPE] * sqrt(ve * ve + vn * vn) * tecs.PERIOD_S, -_LEVEL_OFF_FROM_M
        )
        portion = 0.5
    elif state[at.STAGE] == at.LINING_UP:
        dx, dy = row[at.LEG_X] - state[at.BEGIN], row[at.LEG_Y] - state[at.BEGIN + 1]
        rx, ry = state[col.POSITION_X] - state[at.BEGIN], state[col.POSITION_Y] - state[at.BEGIN + 1]
        aside = abs(rx * dy - ry * dx) / length
        lined_up = abs(state[at.GUIDANCE]) < _LINED_UP_RAD
        low = height < state[at.BEGIN + 2]
        if (
            (portion >= 0.0 and lined_up and aside < _ON_LINE_M)
            or (portion > 0.15 and lined_up and low)
            or portion > 0.5
        ):
            state[at.STAGE] = at.APPROACH
    slow = limits[at.PREFLARE_AIRSPEED]
    low = height <= max(limits[at.PREFLARE_HEIGHT], sink * limits[at.PREFLARE_S])
    if state[at.STAGE] == at.APPROACH and slow > 0.0 and low:
        state[at.STAGE] = at.PREFLARE
    if state[at.STAGE] != at.LINING_UP:
        soon = height <= sink * limits[at.FLARE_S] and portion > 0.5
        if height <= limits[at.FLARE_HEIGHT] or (straight and soon):
            state[at.DOING] = at.FLARE
    if straight and portion >= 1.0:
        state[at.DOING] = at.FLARE
    airspeed = row[at.LEG_AIRSPEED]
    if state[at.STAGE] == at.LINING_UP:
        airspeed = limits[at.AIRSPEED_TRIM]
    elif state[at.STAGE] == at.PREFLARE or (state[at.DOING] == at.FLARE and slow > 0.0):
        airspeed = slow
    if not straight:
        return state[at.TARGET], airspeed, portion
    if state[at.STAGE] == at.LINING_UP:
        return state[at.BEGIN + 2] * (1.0 - min(max(portion, 0.0), 1.0)), airspeed, portion
    return _approach_height(state, limits, length, portion), airspeed, portion


@compiled
def _least_pitch(state: Floats, row: Floats, limits: Floats, climb: float) -> float:
    """Return the least pitch of a climb-out; near its height the nose may come down."""
    pitch = row[at.LEG_PITCH]
    left = row[at.LEG_Z] - state[col.POSITION_Z]
    if limits[at.LEVEL_OFF_S] <= 0.0:
        return float(pitch)
    if state[at.LEVEL_OFF] > 0.0:
        return float(pitch * left / state[at.LEVEL_OFF])
    soon = climb > 0.1 and 0.0 < left <= limits[at.LEVEL_OFF_S] * climb
    if soon and state[col.POSITION_Z] >= _LEVEL_OFF_FROM_M:
        state[at.LEVEL_OFF] = left
    return float(pitch)


@compiled
def command_energy(
    state: Floats,
    row: Floats,
    limits: Floats,
    arrived: bool,
    circling: bool,
    airspeed: float,
    wx: float,
    wy: float,
) -> None:
    """Set the demanded pitch and throttle for a leg.

    Parameters
    ----------
    state, row, limits : float64[STATE], float64[LEG], float64[LIMITS]
    arrived, circling : bool
        Whether the route has ended, and whether a circle is flown.
    airspeed : float
        That of the leg, or what the least ground speed needs.
    wx, wy : float
        Wind.
    """
    kind = row[at.LEG_KIND]
    climb = state[col.VELOCITY_Z]
    sinking = limits[at.THROTTLE_LIMIT] == 0.0
    stage, portion, least_pitch = tecs.CRUISE, 0.0, 0.0
    if kind == at.TAKEOFF and not arrived:
        stage = tecs.CLIMB_OUT
        airspeed = limits[at.TAKEOFF_AIRSPEED]
        least_pitch = _least_pitch(state, row, limits, climb)
        target = state[col.POSITION_Z]
    elif kind in (at.LANDING, at.CIRCULAR_LANDING):
        target, airspeed, portion = _land(state, row, limits, -climb)
        stage = tecs.FLARING if state[at.DOING] == at.FLARE else tecs.LAND
        head_wind = -(wx * sin(state[col.HEADING]) + wy * cos(state[col.HEADING]))
        raised = airspeed + max(head_wind, 0.0) * limits[at.HEAD_WIND_SHARE]
        airspeed = max(airspeed, min(raised, limits[at.AIRSPEED_TRIM]))
    elif arrived:
        target = state[at.CENTRE + 2]
    else:
        target = row[at.LEG_Z]
        reached = kind == at.CIRCLE and not isnan(state[at.BEARING])
        if state[at.SLOPE] != 0.0 and not reached and not (circling and kind == at.LINE):
            _, flown = ahead_of_landing(state, row)
            target -= state[at.SLOPE] * (1.0 - min(max(flown, 0.0), 1.0))
    tecs.control_energy(state, limits, stage, target, airspeed, climb, portion, least_pitch, sinking)
    if stage == tecs.FLARING:
        state[at.THROTTLE_DEMAND] = 0.0
