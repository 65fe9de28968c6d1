"""Compiled height, airspeed and bank control of ArduPlane along a route; TECS sets pitch and throttle.

Behaviour as published for ArduPlane 4.5 to 4.7 (``altitude.cpp``, ``takeoff.cpp``, ``Attitude.cpp``,
``AP_Landing_Slope.cpp``): slopes between waypoints, climb-out, approach, flare.
"""

from __future__ import annotations

from math import acos, atan, cos, isnan, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record
from wbf_mission.addons.wings.motion import layout as at
from wbf_mission.addons.wings.motion import tecs
from wbf_mission.addons.wings.motion.guidance import circles, ground_speed, leg_airspeed, steer

# Above this height, climbs also follow the line to the next waypoint.
_CLIMB_ALONG_M = 20.0
_LEVEL_OFF_FROM_M = 10.0
_LINED_UP_RAD = 0.1745
_ON_LINE_M = 5.0
_SLOW_BANK = 0.4363
# The approach line aims at a point this far beyond the landing point.
_PROJECTION_M = 500.0


@compiled(allocates=False)
def begin_slope(state: Record, row: Record, limits: Record) -> None:
    """At the start of a leg, set whether its height is reached at once or along a slope."""
    rise = row.z - state.begin_z
    along = state.position_z > _CLIMB_ALONG_M or state.position_z > row.z
    small = abs(rise) < limits.slope_min
    state.slope = 0.0 if small or not along or (rise > 0.0 and row.at_once > 0.0) else rise
    state.stage = at.LINING_UP
    state.level_off = 0.0
    state.target = state.position_z


@compiled(allocates=False)
def _ahead_of_landing(state: Record, row: Record) -> tuple[float, float]:
    """Return the length of the leg to a landing, and the fraction of the leg that is flown."""
    dx, dy = row.x - state.begin_x, row.y - state.begin_y
    length2 = max(dx * dx + dy * dy, 1.0)
    rx, ry = state.position_x - state.begin_x, state.position_y - state.begin_y
    return sqrt(length2), (rx * dx + ry * dy) / length2


@compiled(allocates=False)
def _command_bank(state: Record, limits: Record, lateral: float, takeoff: bool, flaring: bool) -> None:
    """Set the demanded bank for a lateral acceleration, within the limits of height and airspeed."""
    bank = atan(lateral / (GRAVITY_M_S2 * cos(state.pitch)))
    limit = limits.bank_limit
    height, level = state.position_z, limits.level_height
    if takeoff and height < 3.0 * level:
        part = max(height - level, 0.0) / max(2.0 * level, 0.1)
        limit = min(limit, limits.level_bank + part * (limit - limits.level_bank))
    if flaring:
        limit = min(limit, limits.level_bank)
    # The possible load factor grows with the square of the airspeed.
    margin = state.airspeed / max(limits.airspeed_min, 1.0)
    stall = acos(1.0 / (margin * margin)) if margin > 1.0 else 0.0
    limit = min(limit, max(stall, _SLOW_BANK))
    state.bank_demand = min(max(bank, -limit), limit)


@compiled(allocates=False)
def _approach_height(state: Record, limits: Record, length: float, portion: float) -> float:
    """Return the height of the line that leads to the point where the flare should start."""
    top = state.begin_z
    ground = max(ground_speed(state), 0.5)
    sink = top / max(length / ground, 0.5)
    aim = limits.flare_s * sink
    if aim <= 0.0:
        aim = limits.flare_height
    if limits.flare_height > 0.0:
        aim = min(aim, 2.0 * limits.flare_height)
    share = limits.flare_aim
    mean = max(share * limits.flare_sink + (1.0 - share) * sink, 0.1)
    before = min(ground * aim / mean, 0.5 * length)
    slope = (top - aim) / (length - before)
    low = aim - slope * _PROJECTION_M
    part = portion * length / (length - before + _PROJECTION_M)
    return float(min(max(top + (low - top) * min(max(part, 0.0), 1.0), low), top))


@compiled(allocates=False)
def _land(state: Record, row: Record, limits: Record, sink: float) -> tuple[float, float, float]:
    """Advance a landing; return the demanded height and airspeed, and the fraction of the leg flown."""
    length, portion = _ahead_of_landing(state, row)
    height = state.position_z
    straight = row.kind == at.LANDING
    if not straight:
        state.stage = max(state.stage, at.APPROACH)
        lower = row.slope * ground_speed(state) * tecs.PERIOD_S
        state.target = max(state.target - lower, -_LEVEL_OFF_FROM_M)
        portion = 0.5
    elif state.stage == at.LINING_UP:
        dx, dy = row.x - state.begin_x, row.y - state.begin_y
        rx, ry = state.position_x - state.begin_x, state.position_y - state.begin_y
        aside = abs(rx * dy - ry * dx) / length
        lined_up = abs(state.guidance) < _LINED_UP_RAD
        low = height < state.begin_z
        if (
            (portion >= 0.0 and lined_up and aside < _ON_LINE_M)
            or (portion > 0.15 and lined_up and low)
            or portion > 0.5
        ):
            state.stage = at.APPROACH
    slow = limits.preflare_airspeed
    low = height <= max(limits.preflare_height, sink * limits.preflare_s)
    if state.stage == at.APPROACH and slow > 0.0 and low:
        state.stage = at.PREFLARE
    if state.stage != at.LINING_UP:
        soon = height <= sink * limits.flare_s and portion > 0.5
        if height <= limits.flare_height or (straight and soon):
            state.doing = at.FLARE
    if straight and portion >= 1.0:
        state.doing = at.FLARE
    airspeed = row.airspeed
    if state.stage == at.LINING_UP:
        airspeed = limits.airspeed_trim
    elif state.stage == at.PREFLARE or (state.doing == at.FLARE and slow > 0.0):
        airspeed = slow
    if not straight:
        return state.target, airspeed, portion
    if state.stage == at.LINING_UP:
        return state.begin_z * (1.0 - min(max(portion, 0.0), 1.0)), airspeed, portion
    return _approach_height(state, limits, length, portion), airspeed, portion


@compiled(allocates=False)
def _least_pitch(state: Record, row: Record, limits: Record, climb: float) -> float:
    """Return the minimum pitch of a climb-out, reduced near its final height."""
    pitch = row.pitch
    left = row.z - state.position_z
    if limits.level_off_s <= 0.0:
        return float(pitch)
    if state.level_off > 0.0:
        return float(pitch * left / state.level_off)
    soon = climb > 0.1 and 0.0 < left <= limits.level_off_s * climb
    if soon and state.position_z >= _LEVEL_OFF_FROM_M:
        state.level_off = left
    return float(pitch)


@compiled(allocates=False)
def arduplane_control(
    state: Record, row: Record, arrived: bool, limits: Record, wx: float, wy: float
) -> None:
    """Set the demanded bank, pitch and throttle for a leg."""
    lateral, be, bn = steer(state, row, arrived, limits, wx, wy)
    kind = row.kind
    _command_bank(state, limits, lateral, kind == at.TAKEOFF and not arrived, state.doing == at.FLARE)
    airspeed = leg_airspeed(row, arrived, limits, be, bn, wx, wy)
    climb = state.velocity_z
    stage, portion, least_pitch = tecs.CRUISE, 0.0, 0.0
    if kind == at.TAKEOFF and not arrived:
        stage = tecs.CLIMB_OUT
        airspeed = limits.takeoff_airspeed
        least_pitch = _least_pitch(state, row, limits, climb)
        target = state.position_z
    elif kind in (at.LANDING, at.CIRCULAR_LANDING):
        target, airspeed, portion = _land(state, row, limits, -climb)
        stage = tecs.FLARING if state.doing == at.FLARE else tecs.LAND
        head_wind = -(wx * sin(state.heading) + wy * cos(state.heading))
        raised = airspeed + max(head_wind, 0.0) * limits.head_wind_share
        airspeed = max(airspeed, min(raised, limits.airspeed_trim))
    elif arrived:
        target = state.centre_z
    else:
        target = row.z
        reached = kind == at.CIRCLE and not isnan(state.bearing)
        if state.slope != 0.0 and not reached and not (kind == at.LINE and circles(state, row, arrived)):
            _, flown = _ahead_of_landing(state, row)
            target -= state.slope * (1.0 - min(max(flown, 0.0), 1.0))
    tecs.control_energy(state, limits, stage, target, airspeed, portion, least_pitch)
    if stage == tecs.FLARING:
        state.throttle_demand = 0.0
