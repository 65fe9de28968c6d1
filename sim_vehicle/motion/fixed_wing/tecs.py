"""ArduPlane's control of total energy, compiled: from a height and an airspeed to pitch and throttle.

The published behaviour of ``AP_TECS`` (P. Riseborough, 2013; ArduPlane 4.5 to 4.7) with its parameters
``TECS_*``, after A. A. Lambregts, "Vertical flight path and speed control autopilot design using total energy
principles", AIAA 83-2239. The throttle controls the sum of potential and kinetic energy: feed-forward from
the wanted rate, about TRIM_THROTTLE, damping and an integral. Pitch controls their difference. It believes
that full throttle climbs at TECS_CLMB_MAX and none sinks at TECS_SINK_MIN; the airframe may do otherwise. All
energies are per mass.
"""

from __future__ import annotations

from math import cos, isnan, nan, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing import layout as at
from sim_vehicle.motion.fixed_wing.forces import Floats

__all__ = ["CLIMB_OUT", "CRUISE", "FLARING", "LAND", "PERIOD_S", "control_energy"]

PERIOD_S = 0.1
CRUISE, CLIMB_OUT, LAND, FLARING = 0.0, 1.0, 2.0, 3.0
_SATURATION = 0.1
_PITCH_MARGIN = 0.0873
_SLOWEST = 3.0
_UNDERSPEED_S = 3.0
_BAD_DESCENT = 200.0


@compiled
def _clip(value: float, low: float, high: float) -> float:
    return float(min(max(value, low), high))


@compiled
def _begin(state: Floats, limits: Floats) -> None:
    """Take the flight as it is."""
    state[at.LAST_SPEED] = state[at.SPEED_DEMAND] = max(state[at.AIRSPEED], _SLOWEST)
    state[at.SPEED_RATE_FILTER] = state[at.ACCELERATION_FILTER] = 0.0
    state[at.SPEED_MAX] = limits[at.AIRSPEED_MAX]
    height = state[col.POSITION_Z]
    state[at.HEIGHT_IN] = state[at.HEIGHT_LIMITED] = state[at.HEIGHT_FILTER] = height
    state[at.HEIGHT_DEMAND] = height
    state[at.HEIGHT_OFFSET] = state[at.ENERGY_RATE_ERROR] = 0.0
    state[at.CLIMB_SCALE] = state[at.SINK_SCALE] = 1.0
    state[at.THROTTLE_INTEGRAL] = state[at.BALANCE_INTEGRAL] = state[at.SPEED_INTEGRAL] = 0.0
    state[at.THROTTLE_LAST] = limits[at.TRIM_THROTTLE]
    state[at.PITCH_DEMAND] = state[at.PITCH_FREE] = state[at.PITCH]
    state[at.THROTTLE_CLIP] = state[at.BALANCE_CLIP] = state[at.THROTTLE_FLOOR] = 0.0
    state[at.UNDERSPEED] = state[at.BAD_DESCENT] = 0.0
    state[at.FLARE_FROM] = nan
    state[at.RUNNING] = 1.0


@compiled
def _demand_speed(
    state: Floats, limits: Floats, stage: float, airspeed: float, v: float, time_s: float
) -> tuple[float, float, float]:
    """Limit the demanded airspeed; return its rate and the least and greatest airspeed."""
    up = 0.5 * limits[at.TECS_CLIMB] * state[at.CLIMB_SCALE] * GRAVITY_M_S2 / v
    down = -0.5 * limits[at.TECS_SINK_MIN] * GRAVITY_M_S2 / v
    # Full throttle and not yet there: the upper limit comes down, so that it climbs.
    rate = down if state[at.THROTTLE_CLIP] > 0.0 else up
    fastest = state[at.SPEED_MAX] + rate * PERIOD_S
    fastest = _clip(fastest, limits[at.AIRSPEED_TRIM], limits[at.AIRSPEED_MAX])
    state[at.SPEED_MAX] = fastest
    # A load factor raises the stall speed by its root.
    slowest = limits[at.AIRSPEED_MIN] / sqrt(cos(state[at.BANK_DEMAND]))
    slowest = min(slowest, fastest)
    if state[at.BAD_DESCENT] > 0.0 or state[at.UNDERSPEED] > 0.0:
        airspeed = slowest
    wanted = _clip(airspeed, slowest, fastest)
    before = wanted if stage == CLIMB_OUT else state[at.SPEED_DEMAND]
    rate = _clip((wanted - before) / PERIOD_S, down, up)
    share = PERIOD_S / (PERIOD_S + time_s)
    state[at.SPEED_RATE_FILTER] += share * (rate - state[at.SPEED_RATE_FILTER])
    state[at.SPEED_DEMAND] = _clip(before + rate * PERIOD_S, slowest, fastest)
    return rate, slowest, fastest


@compiled
def _demand_height(
    state: Floats, limits: Floats, stage: float, target: float, pitch_min: float, pitch_max: float
) -> float:
    """Filter the demanded height; return its rate."""
    climbs = limits[at.TECS_CLIMB] * state[at.CLIMB_SCALE]
    sinks = limits[at.TECS_SINK_MAX] * state[at.SINK_SCALE]
    high = state[at.PITCH_FREE] > pitch_max
    low = state[at.PITCH_FREE] < pitch_min
    before = state[at.HEIGHT_IN]
    # A demand that cannot be followed does not run away.
    full, idle = state[at.THROTTLE_CLIP] > 0.0, state[at.THROTTLE_CLIP] < 0.0
    if ((high or full) and target > before) or ((low or idle) and target < before):
        target = before
    state[at.HEIGHT_IN] = target
    middle = 0.5 * (target + before)
    change = middle - state[at.HEIGHT_LIMITED]
    state[at.HEIGHT_LIMITED] += _clip(change, -sinks * PERIOD_S, climbs * PERIOD_S)
    constant = max(limits[at.DEMAND_S], PERIOD_S)
    share = PERIOD_S / (PERIOD_S + constant)
    rate = (state[at.HEIGHT_LIMITED] - state[at.HEIGHT_FILTER]) / constant
    state[at.HEIGHT_FILTER] += share * (state[at.HEIGHT_LIMITED] - state[at.HEIGHT_FILTER])
    state[at.HEIGHT_OFFSET] *= 1.0 - share
    demand = state[at.HEIGHT_FILTER] + state[at.HEIGHT_OFFSET]
    if stage == LAND:
        # The slope of a landing is followed without the lag of the filter.
        demand += constant * rate
    elif (high or full or state[at.BALANCE_CLIP] > 0.0) and demand > state[at.HEIGHT_DEMAND]:
        state[at.CLIMB_SCALE] *= 1.0 - share
    elif (low or idle or state[at.BALANCE_CLIP] < 0.0) and demand < state[at.HEIGHT_DEMAND]:
        state[at.SINK_SCALE] *= 1.0 - share
    else:
        state[at.CLIMB_SCALE] += share * (1.0 - state[at.CLIMB_SCALE])
        state[at.SINK_SCALE] += share * (1.0 - state[at.SINK_SCALE])
    state[at.HEIGHT_DEMAND] = demand
    return float(rate)


@compiled
def _demand_flare(state: Floats, limits: Floats, climb: float) -> float:
    """Let the sink die away with the height; return the demanded climb rate."""
    height = state[col.POSITION_Z]
    if isnan(state[at.FLARE_FROM]):
        state[at.FLARE_FROM], state[at.FLARE_RATE] = height, climb
        state[at.FLARE_FOLLOWED], state[at.FLARE_IDEAL] = state[at.HEIGHT_DEMAND], height
    room = state[at.FLARE_FROM] - limits[at.HOLD_OFF_HEIGHT]
    part = _clip((state[at.FLARE_FROM] - height) / room, 0.0, 1.0) if room > 0.0 else 1.0
    rate = state[at.FLARE_RATE] * (1.0 - part) - limits[at.FLARE_SINK] * part
    state[at.FLARE_IDEAL] += rate * PERIOD_S
    state[at.FLARE_FOLLOWED] += rate * PERIOD_S
    state[at.HEIGHT_DEMAND] = state[at.FLARE_FOLLOWED] * (1.0 - part) + state[at.FLARE_IDEAL] * part
    state[at.HEIGHT_IN] = state[at.HEIGHT_LIMITED] = state[at.HEIGHT_FILTER] = height
    return float(rate)


@compiled
def _notice_underspeed(state: Floats, slowest: float, v: float, stage: float) -> None:
    """Note an airspeed that full throttle does not hold: it then comes before the height."""
    state[at.UNDERSPEED_S] += PERIOD_S
    below = state[col.POSITION_Z] < state[at.HEIGHT_DEMAND]
    slow = v < 0.9 * slowest and state[at.THROTTLE_DEMAND] >= 0.95 and stage != FLARING
    if state[at.UNDERSPEED] > 0.0 and v >= 1.15 * slowest and state[at.UNDERSPEED_S] > _UNDERSPEED_S:
        state[at.UNDERSPEED] = 0.0
    if slow or (below and state[at.UNDERSPEED] > 0.0):
        state[at.UNDERSPEED] = 1.0
        if v < 0.9 * slowest:
            state[at.UNDERSPEED_S] = 0.0
    else:
        state[at.UNDERSPEED] = 0.0


@compiled
def control_energy(
    state: Floats,
    limits: Floats,
    stage: float,
    target: float,
    airspeed: float,
    climb: float,
    portion: float,
    least_pitch: float,
    sinking: bool,
) -> None:
    """Set the demanded pitch and throttle; to be called every `PERIOD_S`.

    Parameters
    ----------
    state, limits : float64[STATE], float64[LIMITS]
    stage : {CRUISE, CLIMB_OUT, LAND, FLARING}
    target, airspeed : float
        Height and airspeed to reach.
    climb : float
        Climb rate over ground.
    portion : float
        Of the leg that was flown; the weight of the speed fades with it in a landing.
    least_pitch : float
        Of a take-off.
    sinking : bool
        Whether the motor is dead: pitch then holds the airspeed alone.
    """
    if state[at.RUNNING] == 0.0:
        _begin(state, limits)
    landing = stage in (LAND, FLARING)
    time_s = max(limits[at.LAND_S] if landing else limits[at.TIME_S], 0.1)
    height = state[col.POSITION_Z]
    v = max(state[at.AIRSPEED], _SLOWEST)
    acceleration = (v - state[at.LAST_SPEED]) / PERIOD_S
    state[at.LAST_SPEED] = v
    share = PERIOD_S / (PERIOD_S + time_s)
    state[at.ACCELERATION_FILTER] += share * (acceleration - state[at.ACCELERATION_FILTER])

    pitch_min, pitch_max = limits[at.PITCH_MIN], limits[at.PITCH_MAX]
    throttle_max, throttle_min = limits[at.THROTTLE_MAX], limits[at.THROTTLE_MIN]
    if stage == CLIMB_OUT:
        pitch_min = least_pitch
        pitch_max = max(pitch_max, pitch_min)
        throttle_max = limits[at.TAKEOFF_THROTTLE]
        state[at.HEIGHT_IN] = state[at.HEIGHT_LIMITED] = state[at.HEIGHT_FILTER] = height
        state[at.HEIGHT_DEMAND] = target = height
        state[at.HEIGHT_OFFSET] = min(climb, limits[at.TECS_CLIMB]) * limits[at.DEMAND_S]
        state[at.UNDERSPEED] = state[at.BAD_DESCENT] = 0.0
        state[at.CLIMB_SCALE] = state[at.SINK_SCALE] = 1.0
    # After a climb-out the throttle comes back no faster than TECS_THR_ERATE.
    state[at.THROTTLE_FLOOR] -= limits[at.THROTTLE_EASE] * PERIOD_S
    if stage == CLIMB_OUT:
        state[at.THROTTLE_FLOOR] = throttle_max if limits[at.THROTTLE_EASE] > 0.0 else 0.0
    throttle_min = min(max(throttle_min, state[at.THROTTLE_FLOOR]), throttle_max - 0.01)
    if stage == FLARING:
        part = 0.0
        if not isnan(state[at.FLARE_FROM]):
            part = 1.0
            if state[at.FLARE_FROM] > limits[at.HOLD_OFF_HEIGHT]:
                part = _clip((state[at.FLARE_FROM] - height) / state[at.FLARE_FROM], 0.0, 1.0)
        pitch_min = max(pitch_min, (1.0 - part) * pitch_min + part * limits[at.LAND_PITCH])
        if limits[at.LAND_PITCH_MAX] > 0.0:
            pitch_max = limits[at.LAND_PITCH_MAX]
        pitch_max = max(pitch_max, pitch_min)
        throttle_min = 0.0
        state[at.THROTTLE_FLOOR] = 0.0
    else:
        state[at.FLARE_FROM] = nan

    speed_rate, slowest, fastest = _demand_speed(state, limits, stage, airspeed, v, time_s)
    if stage == FLARING:
        rate = _demand_flare(state, limits, climb)
    elif stage == CLIMB_OUT:
        rate = 0.0
        state[at.HEIGHT_DEMAND] = height
    else:
        rate = _demand_height(state, limits, stage, target, pitch_min, pitch_max)
    _notice_underspeed(state, slowest, v, stage)

    # Energies, and their rates as far as they are not steady.
    wanted = state[at.SPEED_DEMAND]
    kinetic, wanted_kinetic = 0.5 * v * v, 0.5 * wanted * wanted
    potential, wanted_potential = GRAVITY_M_S2 * height, GRAVITY_M_S2 * state[at.HEIGHT_DEMAND]
    wanted_kinetic_rate = v * (speed_rate - state[at.SPEED_RATE_FILTER])
    kinetic_rate = v * (acceleration - state[at.ACCELERATION_FILTER])
    potential_rate = GRAVITY_M_S2 * climb

    _pitch(
        state, limits, stage, portion, time_s, pitch_min, pitch_max, v, sinking,
        wanted_potential - potential, wanted_kinetic - kinetic, GRAVITY_M_S2 * rate, potential_rate,
        kinetic_rate,
    )  # fmt: skip

    # Throttle.
    most = limits[at.TECS_CLIMB] * state[at.CLIMB_SCALE] * GRAVITY_M_S2
    least = -limits[at.TECS_SINK_MIN] * GRAVITY_M_S2
    high = max(kinetic - 0.5 * slowest * slowest, 0.0)
    low = min(kinetic - 0.5 * fastest * fastest, 0.0)
    error = _clip(wanted_potential - potential, low, high) + wanted_kinetic - kinetic
    wanted_rate = (wanted_potential - potential) / time_s + wanted_kinetic_rate
    wanted_rate = _clip(wanted_rate, least, most)
    missing = wanted_rate - potential_rate - kinetic_rate
    share = 2.0 * PERIOD_S
    missing = share * missing + (1.0 - share) * state[at.ENERGY_RATE_ERROR]
    state[at.ENERGY_RATE_ERROR] = missing
    clip = 0.0
    if sinking:
        throttle = 0.0
    elif state[at.UNDERSPEED] > 0.0:
        throttle = 1.0
    else:
        span = throttle_max - throttle_min
        gain = span / (time_s * max(most - least, 0.1))
        # A turn needs more lift, and so more drag is to be overcome.
        cos2 = _clip(cos(state[at.BANK]) ** 2, 0.1, 1.0)
        forward = wanted_rate + limits[at.ROLL_TO_THROTTLE] * (1.0 / cos2 - 1.0)
        throttle = limits[at.TRIM_THROTTLE] + forward * gain * time_s
        throttle += (error + missing * limits[at.THROTTLE_DAMPING]) * gain
        half = 0.5 * (throttle_max - max(throttle_min, 0.0))
        upper = _clip(throttle_max - throttle + _SATURATION, -half, half)
        lower = _clip(throttle_min - throttle - _SATURATION, -half, half)
        integral = state[at.THROTTLE_INTEGRAL] + error * limits[at.INTEGRATOR] * PERIOD_S * gain
        state[at.THROTTLE_INTEGRAL] = upper if stage == CLIMB_OUT else _clip(integral, lower, upper)
        if limits[at.THROTTLE_SLEW] > 0.0:
            step = PERIOD_S * limits[at.THROTTLE_SLEW]
            last = state[at.THROTTLE_LAST]
            throttle = _clip(throttle, last - step, last + step)
        state[at.THROTTLE_LAST] = throttle
        throttle += state[at.THROTTLE_INTEGRAL]
        clip = 1.0 if throttle > throttle_max else (-1.0 if throttle < throttle_min else 0.0)
        # A climb-out takes all that there is (TKOFF_OPTIONS 0).
        throttle = throttle_max if stage == CLIMB_OUT else _clip(throttle, throttle_min, throttle_max)
    if throttle > throttle_min:
        state[at.THROTTLE_FLOOR] = min(state[at.THROTTLE_FLOOR], 0.0) if stage != CLIMB_OUT else throttle_max
    state[at.THROTTLE_CLIP] = clip
    state[at.THROTTLE_DEMAND] = throttle
    # Much too low, still losing energy at full throttle: the airspeed cannot be had.
    losing = potential_rate + kinetic_rate < 0.0
    falls = error > _BAD_DESCENT and losing and throttle >= 0.9 * throttle_max
    stays = state[at.BAD_DESCENT] > 0.0 and error > 0.0
    state[at.BAD_DESCENT] = 1.0 if state[at.UNDERSPEED] == 0.0 and not sinking and (falls or stays) else 0.0


@compiled
def _pitch(
    state: Floats,
    limits: Floats,
    stage: float,
    portion: float,
    time_s: float,
    pitch_min: float,
    pitch_max: float,
    v: float,
    sinking: bool,
    potential_error: float,
    kinetic_error: float,
    wanted_potential_rate: float,
    potential_rate: float,
    kinetic_rate: float,
) -> None:
    """Set the demanded pitch from the balance of potential and kinetic energy."""
    weight = _clip(limits[at.SPEED_WEIGHT], 0.0, 2.0)
    if state[at.UNDERSPEED] > 0.0 or stage == CLIMB_OUT or sinking:
        weight = 2.0
    elif stage in (LAND, FLARING):
        if limits[at.LAND_SPEED_WEIGHT] < 0.0:
            weight *= 1.0 - _clip(portion, 0.0, 1.0)
        else:
            weight = _clip(limits[at.LAND_SPEED_WEIGHT], 0.0, 2.0)
    of_height, of_speed = min(2.0 - weight, 1.0), min(weight, 1.0)
    error = potential_error * of_height - kinetic_error * of_speed
    wanted = wanted_potential_rate * of_height + error / time_s
    least, most = -limits[at.TECS_SINK_MAX] * GRAVITY_M_S2, limits[at.TECS_CLIMB] * GRAVITY_M_S2
    state[at.BALANCE_CLIP] = -1.0 if wanted < least else (1.0 if wanted > most else 0.0)
    wanted = _clip(wanted, least, most)
    missing = wanted - (potential_rate * of_height - kinetic_rate * of_speed)
    damping = limits[at.LAND_DAMPING] if stage == FLARING else limits[at.PITCH_DAMPING]
    total = wanted + missing * damping
    per_radian = v * GRAVITY_M_S2
    if stage == CLIMB_OUT:
        total += pitch_min * per_radian
    low = per_radian * (pitch_min - _PITCH_MARGIN) - total
    high = per_radian * (pitch_max + _PITCH_MARGIN) - total
    tenth = 0.1 * (high - low)
    delta = _clip(missing * limits[at.INTEGRATOR] * PERIOD_S, -tenth, tenth)
    free = (total + state[at.BALANCE_INTEGRAL] + delta + state[at.SPEED_INTEGRAL]) / per_radian
    if (free > pitch_max and delta > 0.0) or (free < pitch_min and delta < 0.0):
        keep = 1.0 - PERIOD_S / (PERIOD_S + time_s)
        state[at.BALANCE_INTEGRAL] *= keep
        state[at.SPEED_INTEGRAL] *= keep
    else:
        state[at.BALANCE_INTEGRAL] += delta
        state[at.SPEED_INTEGRAL] -= kinetic_error * of_speed * PERIOD_S / time_s
    state[at.BALANCE_INTEGRAL] = _clip(state[at.BALANCE_INTEGRAL], low, high)
    bound = 0.25 * (pitch_max - pitch_min) * per_radian
    state[at.SPEED_INTEGRAL] = _clip(state[at.SPEED_INTEGRAL], -bound, bound)
    free = (total + state[at.BALANCE_INTEGRAL] + state[at.SPEED_INTEGRAL]) / per_radian
    state[at.PITCH_FREE] = free
    change = PERIOD_S * limits[at.VERTICAL_ACCELERATION] / v
    last = state[at.PITCH_DEMAND]
    state[at.PITCH_DEMAND] = _clip(_clip(free, pitch_min, pitch_max), last - change, last + change)
