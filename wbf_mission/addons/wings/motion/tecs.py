"""Compiled total energy control of ArduPlane: pitch and throttle for a height and an airspeed.

Behaviour as published for ``AP_TECS`` (P. Riseborough, 2013; ArduPlane 4.5 to 4.7) with its parameters
``TECS_*``, after A. A. Lambregts, "Vertical flight path and speed control autopilot design using total energy
principles", AIAA 83-2239. Throttle controls the sum of potential and kinetic energy: feed-forward from the
wanted rate around TRIM_THROTTLE, damping and an integral. Pitch controls the difference of the two energies.
The controller assumes a climb at TECS_CLMB_MAX with full throttle, and a sink at TECS_SINK_MIN without
throttle; the airframe may differ. All energies are per mass.
"""

from __future__ import annotations

from math import cos, isnan, nan, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record

PERIOD_S = 0.1
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
    """Return the airspeed's weight in pitch control, 0 to 2; the height's weight is the rest up to 2."""
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
