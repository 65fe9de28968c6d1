"""Compiled height, airspeed and bank control of ArduPlane along a route.

The behaviour is that of ArduPlane 4.5 to 4.7: slopes between waypoints, climb-out, approach, flare
(``altitude.cpp``, ``takeoff.cpp``, ``Attitude.cpp``, ``AP_Landing_Slope.cpp``), and total energy control, a
controller of pitch and throttle for a height and an airspeed (``AP_TECS``, P. Riseborough, 2013), with the
parameters ``TECS_*``, after A. A. Lambregts, "Vertical flight path and speed control autopilot design using
total energy principles", AIAA 83-2239. Throttle controls the sum of potential and kinetic energy:
feed-forward from the wanted rate around TRIM_THROTTLE, damping and an integral. Pitch controls the difference
of the two energies. The controller assumes a climb at TECS_CLMB_MAX with full throttle, and a sink at
TECS_SINK_MIN without throttle; the airframe may differ. All energies are per mass.
"""

from __future__ import annotations

from math import acos, atan, cos, isnan, nan, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record
from wbf_mission.addons.wings.motion import layout as at
from wbf_mission.addons.wings.motion.guidance import circles, ground_speed, leg_airspeed, steer
from wbf_mission.addons.wings.motion.layout import PERIOD_S

# Stages of total energy control.
CRUISE, CLIMB_OUT, LAND, FLARING = 0.0, 1.0, 2.0, 3.0
_SATURATION = 0.1
_PITCH_MARGIN = 0.0873
_SLOWEST = 3.0
_UNDERSPEED_S = 3.0
_BAD_DESCENT = 200.0


@compiled(allocates=False)
def _clip(value: float, low: float, high: float) -> float:
    return float(min(max(value, low), high))


@compiled(allocates=False)
def _begin(state: Record, limits: Record) -> None:
    """Initialise the controller from the current flight state."""
    state.last_speed = state.speed_demand = max(state.airspeed, _SLOWEST)
    state.speed_rate_filter = state.acceleration_filter = 0.0
    state.speed_max = limits.airspeed_max
    height = state.position_z
    state.height_in = state.height_limited = state.height_filter = height
    state.height_demand = height
    state.height_offset = state.energy_rate_error = 0.0
    state.climb_scale = state.sink_scale = 1.0
    state.throttle_integral = state.balance_integral = state.speed_integral = 0.0
    state.throttle_last = limits.trim_throttle
    state.pitch_demand = state.pitch_free = state.pitch
    state.throttle_clip = state.balance_clip = state.throttle_floor = 0.0
    state.underspeed = state.bad_descent = 0.0
    state.flare_from = nan
    state.running = 1.0


@compiled(allocates=False)
def _demand_speed(
    state: Record, limits: Record, stage: float, airspeed: float, v: float, time_s: float
) -> tuple[float, float, float]:
    """Limit the demanded airspeed; return its rate and the minimum and maximum airspeed."""
    up = 0.5 * limits.tecs_climb * state.climb_scale * GRAVITY_M_S2 / v
    down = -0.5 * limits.tecs_sink_min * GRAVITY_M_S2 / v
    # If full throttle does not suffice, the airspeed limit falls so that the vehicle climbs.
    rate = down if state.throttle_clip > 0.0 else up
    fastest = state.speed_max + rate * PERIOD_S
    fastest = _clip(fastest, limits.airspeed_trim, limits.airspeed_max)
    state.speed_max = fastest
    # A load factor raises the stall speed by its square root.
    slowest = limits.airspeed_min / sqrt(cos(state.bank_demand))
    slowest = min(slowest, fastest)
    if state.bad_descent > 0.0 or state.underspeed > 0.0:
        airspeed = slowest
    wanted = _clip(airspeed, slowest, fastest)
    before = wanted if stage == CLIMB_OUT else state.speed_demand
    rate = _clip((wanted - before) / PERIOD_S, down, up)
    share = PERIOD_S / (PERIOD_S + time_s)
    state.speed_rate_filter += share * (rate - state.speed_rate_filter)
    state.speed_demand = _clip(before + rate * PERIOD_S, slowest, fastest)
    return rate, slowest, fastest


@compiled(allocates=False)
def _demand_height(
    state: Record, limits: Record, stage: float, target: float, pitch_min: float, pitch_max: float
) -> float:
    """Filter the demanded height and return its rate."""
    climbs = limits.tecs_climb * state.climb_scale
    sinks = limits.tecs_sink_max * state.sink_scale
    high = state.pitch_free > pitch_max
    low = state.pitch_free < pitch_min
    before = state.height_in
    # A demand that cannot be followed is held, so that the filter does not run away.
    full, idle = state.throttle_clip > 0.0, state.throttle_clip < 0.0
    if ((high or full) and target > before) or ((low or idle) and target < before):
        target = before
    state.height_in = target
    middle = 0.5 * (target + before)
    change = middle - state.height_limited
    state.height_limited += _clip(change, -sinks * PERIOD_S, climbs * PERIOD_S)
    constant = max(limits.demand_s, PERIOD_S)
    share = PERIOD_S / (PERIOD_S + constant)
    rate = (state.height_limited - state.height_filter) / constant
    state.height_filter += share * (state.height_limited - state.height_filter)
    state.height_offset *= 1.0 - share
    demand = state.height_filter + state.height_offset
    if stage == LAND:
        # The slope of a landing is followed without the filter's lag.
        demand += constant * rate
    elif (high or full or state.balance_clip > 0.0) and demand > state.height_demand:
        state.climb_scale *= 1.0 - share
    elif (low or idle or state.balance_clip < 0.0) and demand < state.height_demand:
        state.sink_scale *= 1.0 - share
    else:
        state.climb_scale += share * (1.0 - state.climb_scale)
        state.sink_scale += share * (1.0 - state.sink_scale)
    state.height_demand = demand
    return float(rate)


@compiled(allocates=False)
def _demand_flare(state: Record, limits: Record, climb: float) -> float:
    """Reduce the sink rate with the height in a flare; return the demanded climb rate."""
    height = state.position_z
    if isnan(state.flare_from):
        state.flare_from, state.flare_rate = height, climb
        state.flare_followed, state.flare_ideal = state.height_demand, height
    room = state.flare_from - limits.hold_off_height
    part = _clip((state.flare_from - height) / room, 0.0, 1.0) if room > 0.0 else 1.0
    rate = state.flare_rate * (1.0 - part) - limits.flare_sink * part
    state.flare_ideal += rate * PERIOD_S
    state.flare_followed += rate * PERIOD_S
    state.height_demand = state.flare_followed * (1.0 - part) + state.flare_ideal * part
    state.height_in = state.height_limited = state.height_filter = height
    return float(rate)


@compiled(allocates=False)
def _notice_underspeed(state: Record, slowest: float, v: float, stage: float) -> None:
    """Detect an airspeed that full throttle does not hold; airspeed then has priority over height."""
    state.underspeed_s += PERIOD_S
    below = state.position_z < state.height_demand
    slow = v < 0.9 * slowest and state.throttle_demand >= 0.95 and stage != FLARING
    if state.underspeed > 0.0 and v >= 1.15 * slowest and state.underspeed_s > _UNDERSPEED_S:
        state.underspeed = 0.0
    if slow or (below and state.underspeed > 0.0):
        state.underspeed = 1.0
        if v < 0.9 * slowest:
            state.underspeed_s = 0.0
    else:
        state.underspeed = 0.0


@compiled(allocates=False)
def _speed_weight(state: Record, limits: Record, stage: float, portion: float, sinking: bool) -> float:
    """Return the airspeed's weight w in pitch control, 0 to 2; the height's weight is 2 - w."""
    if state.underspeed > 0.0 or stage == CLIMB_OUT or sinking:
        return 2.0
    weight = _clip(limits.speed_weight, 0.0, 2.0)
    if stage in (LAND, FLARING):
        if limits.land_speed_weight >= 0.0:
            return _clip(limits.land_speed_weight, 0.0, 2.0)
        weight *= 1.0 - _clip(portion, 0.0, 1.0)
    return weight


@compiled(allocates=False)
def control_energy(
    state: Record,
    limits: Record,
    stage: float,
    target: float,
    airspeed: float,
    portion: float,
    least_pitch: float,
) -> None:
    """Set the demanded pitch and throttle for a height and an airspeed; call every `PERIOD_S`.

    `stage` is CRUISE, CLIMB_OUT, LAND or FLARING. `portion` is the fraction of the leg flown; as it grows, a
    landing reduces the speed weight. `least_pitch` is the minimum pitch of a take-off. If the motor is dead,
    pitch alone holds the airspeed.
    """
    if state.running == 0.0:
        _begin(state, limits)
    landing = stage in (LAND, FLARING)
    time_s = max(limits.land_s if landing else limits.time_s, 0.1)
    height, climb = state.position_z, state.velocity_z
    sinking = limits.throttle_limit == 0.0
    v = max(state.airspeed, _SLOWEST)
    acceleration = (v - state.last_speed) / PERIOD_S
    state.last_speed = v
    share = PERIOD_S / (PERIOD_S + time_s)
    state.acceleration_filter += share * (acceleration - state.acceleration_filter)

    pitch_min, pitch_max = limits.pitch_min, limits.pitch_max
    throttle_max, throttle_min = limits.throttle_max, limits.throttle_min
    if stage == CLIMB_OUT:
        pitch_min = least_pitch
        pitch_max = max(pitch_max, pitch_min)
        throttle_max = limits.takeoff_throttle
        state.height_in = state.height_limited = state.height_filter = height
        state.height_demand = target = height
        state.height_offset = min(climb, limits.tecs_climb) * limits.demand_s
        state.underspeed = state.bad_descent = 0.0
        state.climb_scale = state.sink_scale = 1.0
    # After a climb-out, the throttle falls no faster than TECS_THR_ERATE.
    state.throttle_floor -= limits.throttle_ease * PERIOD_S
    if stage == CLIMB_OUT:
        state.throttle_floor = throttle_max if limits.throttle_ease > 0.0 else 0.0
    throttle_min = min(max(throttle_min, state.throttle_floor), throttle_max - 0.01)
    if stage == FLARING:
        part = 0.0
        if not isnan(state.flare_from):
            part = 1.0
            if state.flare_from > limits.hold_off_height:
                part = _clip((state.flare_from - height) / state.flare_from, 0.0, 1.0)
        pitch_min = max(pitch_min, (1.0 - part) * pitch_min + part * limits.land_pitch)
        if limits.land_pitch_max > 0.0:
            pitch_max = limits.land_pitch_max
        pitch_max = max(pitch_max, pitch_min)
        throttle_min = 0.0
        state.throttle_floor = 0.0
    else:
        state.flare_from = nan

    speed_rate, slowest, fastest = _demand_speed(state, limits, stage, airspeed, v, time_s)
    if stage == FLARING:
        rate = _demand_flare(state, limits, climb)
    elif stage == CLIMB_OUT:
        rate = 0.0
        state.height_demand = height
    else:
        rate = _demand_height(state, limits, stage, target, pitch_min, pitch_max)
    _notice_underspeed(state, slowest, v, stage)

    # Energies and their rates; the kinetic rates are high-pass filtered.
    wanted = state.speed_demand
    kinetic, wanted_kinetic = 0.5 * v * v, 0.5 * wanted * wanted
    potential, wanted_potential = GRAVITY_M_S2 * height, GRAVITY_M_S2 * state.height_demand
    wanted_kinetic_rate = v * (speed_rate - state.speed_rate_filter)
    kinetic_rate = v * (acceleration - state.acceleration_filter)
    potential_rate = GRAVITY_M_S2 * climb

    # Pitch, from the balance of potential and kinetic energy.
    weight = _speed_weight(state, limits, stage, portion, sinking)
    of_height, of_speed = min(2.0 - weight, 1.0), min(weight, 1.0)
    kinetic_error = wanted_kinetic - kinetic
    error = (wanted_potential - potential) * of_height - kinetic_error * of_speed
    wanted = GRAVITY_M_S2 * rate * of_height + error / time_s
    least, most = -limits.tecs_sink_max * GRAVITY_M_S2, limits.tecs_climb * GRAVITY_M_S2
    state.balance_clip = -1.0 if wanted < least else (1.0 if wanted > most else 0.0)
    wanted = _clip(wanted, least, most)
    missing = wanted - (potential_rate * of_height - kinetic_rate * of_speed)
    damping = limits.land_damping if stage == FLARING else limits.pitch_damping
    total = wanted + missing * damping
    per_radian = v * GRAVITY_M_S2
    if stage == CLIMB_OUT:
        total += pitch_min * per_radian
    low = per_radian * (pitch_min - _PITCH_MARGIN) - total
    high = per_radian * (pitch_max + _PITCH_MARGIN) - total
    tenth = 0.1 * (high - low)
    delta = _clip(missing * limits.integrator * PERIOD_S, -tenth, tenth)
    free = (total + state.balance_integral + delta + state.speed_integral) / per_radian
    if (free > pitch_max and delta > 0.0) or (free < pitch_min and delta < 0.0):
        keep = 1.0 - PERIOD_S / (PERIOD_S + time_s)
        state.balance_integral *= keep
        state.speed_integral *= keep
    else:
        state.balance_integral += delta
        state.speed_integral -= kinetic_error * of_speed * PERIOD_S / time_s
    state.balance_integral = _clip(state.balance_integral, low, high)
    bound = 0.25 * (pitch_max - pitch_min) * per_radian
    state.speed_integral = _clip(state.speed_integral, -bound, bound)
    free = (total + state.balance_integral + state.speed_integral) / per_radian
    state.pitch_free = free
    change = PERIOD_S * limits.vertical_acceleration / v
    last = state.pitch_demand
    state.pitch_demand = _clip(_clip(free, pitch_min, pitch_max), last - change, last + change)

    # Throttle.
    most = limits.tecs_climb * state.climb_scale * GRAVITY_M_S2
    least = -limits.tecs_sink_min * GRAVITY_M_S2
    high = max(kinetic - 0.5 * slowest * slowest, 0.0)
    low = min(kinetic - 0.5 * fastest * fastest, 0.0)
    error = _clip(wanted_potential - potential, low, high) + wanted_kinetic - kinetic
    wanted_rate = (wanted_potential - potential) / time_s + wanted_kinetic_rate
    wanted_rate = _clip(wanted_rate, least, most)
    missing = wanted_rate - potential_rate - kinetic_rate
    share = 2.0 * PERIOD_S
    missing = share * missing + (1.0 - share) * state.energy_rate_error
    state.energy_rate_error = missing
    clip = 0.0
    if sinking:
        throttle = 0.0
    elif state.underspeed > 0.0:
        throttle = 1.0
    else:
        span = throttle_max - throttle_min
        gain = span / (time_s * max(most - least, 0.1))
        # A turn needs more lift and therefore has more drag.
        cos2 = _clip(cos(state.bank) ** 2, 0.1, 1.0)
        forward = wanted_rate + limits.roll_to_throttle * (1.0 / cos2 - 1.0)
        throttle = limits.trim_throttle + forward * gain * time_s
        throttle += (error + missing * limits.throttle_damping) * gain
        half = 0.5 * (throttle_max - max(throttle_min, 0.0))
        upper = _clip(throttle_max - throttle + _SATURATION, -half, half)
        lower = _clip(throttle_min - throttle - _SATURATION, -half, half)
        integral = state.throttle_integral + error * limits.integrator * PERIOD_S * gain
        state.throttle_integral = upper if stage == CLIMB_OUT else _clip(integral, lower, upper)
        if limits.throttle_slew > 0.0:
            step = PERIOD_S * limits.throttle_slew
            last = state.throttle_last
            throttle = _clip(throttle, last - step, last + step)
        state.throttle_last = throttle
        throttle += state.throttle_integral
        clip = 1.0 if throttle > throttle_max else (-1.0 if throttle < throttle_min else 0.0)
        # A climb-out uses all available throttle (TKOFF_OPTIONS 0).
        throttle = throttle_max if stage == CLIMB_OUT else _clip(throttle, throttle_min, throttle_max)
    if throttle > throttle_min:
        state.throttle_floor = min(state.throttle_floor, 0.0) if stage != CLIMB_OUT else throttle_max
    state.throttle_clip = clip
    state.throttle_demand = throttle
    # If the vehicle is far too low and still loses energy at full throttle, the airspeed is unreachable.
    losing = potential_rate + kinetic_rate < 0.0
    falls = error > _BAD_DESCENT and losing and throttle >= 0.9 * throttle_max
    stays = state.bad_descent > 0.0 and error > 0.0
    state.bad_descent = 1.0 if state.underspeed == 0.0 and not sinking and (falls or stays) else 0.0


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
        lower = row.slope * ground_speed(state) * PERIOD_S
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
    stage, portion, least_pitch = CRUISE, 0.0, 0.0
    if kind == at.TAKEOFF and not arrived:
        stage = CLIMB_OUT
        airspeed = limits.takeoff_airspeed
        least_pitch = _least_pitch(state, row, limits, climb)
        target = state.position_z
    elif kind in (at.LANDING, at.CIRCULAR_LANDING):
        target, airspeed, portion = _land(state, row, limits, -climb)
        stage = FLARING if state.doing == at.FLARE else LAND
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
    control_energy(state, limits, stage, target, airspeed, portion, least_pitch)
    if stage == FLARING:
        state.throttle_demand = 0.0
