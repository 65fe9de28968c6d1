"""The compiled motion of one fixed wing: coordinated turns, energy, guidance along the legs of a route.

The model is described in docs/fixed-wing-and-rover.md. Lengths in metres, angles in radians, east-north-up
about home, headings clockwise from north, banks and accelerations to the right positive. One vehicle is a row
of `STATE` numbers and a row of `COUNTERS` integers, as in `sim_vehicle.motion.multirotor.kernel`, whose
first 19 numbers and whose counters it has.
"""

from __future__ import annotations

from math import atan2, cos, inf, isnan, pi, sqrt

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import fixed_wing_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.fixed_wing import arduplane
from sim_vehicle.motion.fixed_wing.air import blow, drop, fly, pitch_up
from sim_vehicle.motion.fixed_wing.forces import energy_rate
from sim_vehicle.motion.fixed_wing.ground import brake_rate, roll_on_ground, take_off
from sim_vehicle.motion.fixed_wing.guidance import NPFG, Floats
from sim_vehicle.motion.fixed_wing.layout import (
    AIRSPEED,
    AIRSPEED_TRIM,
    BANK,
    BANK_DEMAND,
    BEARING,
    BEGIN,
    CENTRE,
    CENTRE_RADIUS,
    CIRCLE,
    CIRCULAR_LANDING,
    CLIMB,
    CLIMB_MAX,
    COURSE,
    DIRECT,
    DOING,
    ENERGY_LIMIT,
    FALL,
    FLARE,
    FLYING,
    GUIDANCE,
    LANDING,
    LAST_KIND,
    LAW,
    LEG_CIRCLE_RADIUS,
    LEG_KIND,
    LEG_NEAR,
    LEG_PAUSE,
    LEG_TURNS,
    LEG_X,
    LEG_Y,
    LEG_Z,
    LINE,
    LOITER_RADIUS,
    ON_GROUND,
    PAUSE_END,
    PITCH_DEMAND,
    ROLLING,
    RUNNING,
    SINCE,
    SLOPE,
    STEP_S,
    STOPPED_M_S,
    TAKEOFF,
    TARGET,
    THROTTLE,
    THROTTLE_DEMAND,
    THROTTLE_LIMIT,
    TURNED,
    WIND_UP,
)
from sim_vehicle.motion.fixed_wing.px4 import px4_control
from sim_vehicle.motion.fixed_wing.steering import circled, circles, leg_airspeed, passed, steer
from sim_vehicle.motion.multirotor.kernel import Integers
from sim_vehicle.motion.rows import copy
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

__all__ = ["advance"]

# A leg is given up when it takes longer than this and three times what it takes at a slow speed.
PATIENCE_S = 120.0
SLOW_SHARE = 0.15


@compiled
def _patience_steps(state: Floats, row: Floats, limits: Floats) -> float:
    """Return the number of steps that a leg may take."""
    east, north = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
    way = sqrt(east * east + north * north)
    trim = limits[AIRSPEED_TRIM]
    seconds = (
        PATIENCE_S
        + way / (SLOW_SHARE * trim)
        + abs(row[LEG_Z] - state[col.POSITION_Z]) / 0.2
        + 2.0 * row[LEG_PAUSE]
    )
    seconds += (row[LEG_TURNS] + 2.0) * 2.0 * pi * abs(row[LEG_CIRCLE_RADIUS]) / (0.2 * trim)
    return float(seconds / limits[STEP_S])


@compiled
def _enter(state: Floats, route: Floats, leg: int, step: int, limits: Floats) -> None:
    """Begin a leg."""
    row = route[leg]
    state[col.GIVE_UP_STEP] = step + _patience_steps(state, row, limits)
    state[TURNED], state[BEARING], state[PAUSE_END] = 0.0, float("nan"), inf
    state[GUIDANCE] = 0.0
    before = route[leg - 1, LEG_KIND] if leg > 0 else FALL
    # ArduPlane keeps the line from the centre of a circle; after a take-off it keeps none.
    if before == LINE or (before == CIRCLE and limits[LAW] != NPFG):
        copy(state, BEGIN, route[leg - 1], LEG_X, 3)
        state[DIRECT] = 0.0
    elif leg > 0 or isnan(state[BEGIN]):
        copy(state, BEGIN, state, col.POSITION, 3)
        state[DIRECT] = 1.0
    else:
        state[DIRECT] = 0.0
    if limits[LAW] == NPFG:
        # After a take-off PX4 climbs at once (``calculateFirstOrderHoldAltitude``).
        state[SLOPE] = 0.0 if state[LAST_KIND] == TAKEOFF else row[LEG_Z] - state[BEGIN + 2]
        state[TARGET] = state[col.POSITION_Z]
    else:
        arduplane.begin_slope(state, row, limits)
    state[LAST_KIND] = row[LEG_KIND]
    landing = row[LEG_KIND] in (LANDING, CIRCULAR_LANDING)
    if state[DOING] == FLARE or (state[DOING] == ROLLING and not landing):
        state[DOING] = FLYING if state[DOING] == FLARE else ON_GROUND
    if state[DOING] == ON_GROUND:
        state[RUNNING] = 0.0
        east, north = row[LEG_X] - state[col.POSITION_X], row[LEG_Y] - state[col.POSITION_Y]
        if row[LEG_KIND] == TAKEOFF and east * east + north * north > 25.0:
            state[col.HEADING] = atan2(east, north) % (2.0 * pi)
        state[COURSE] = state[col.HEADING]
        state[SINCE] = state[THROTTLE] = 0.0
    elif row[LEG_KIND] == TAKEOFF:
        state[COURSE] = atan2(state[col.VELOCITY_X], state[col.VELOCITY_Y])


@compiled
def _arduplane_control(
    state: Floats, row: Floats, arrived: bool, limits: Floats, wx: float, wy: float
) -> None:
    """Set what ArduPlane demands: bank, pitch and throttle."""
    lateral, be, bn = steer(state, row, arrived, limits, wx, wy)
    takeoff = row[LEG_KIND] == TAKEOFF and not arrived
    arduplane.command_bank(state, limits, lateral, takeoff, state[DOING] == FLARE)
    airspeed = leg_airspeed(row, arrived, limits, be, bn, wx, wy)
    arduplane.command_energy(state, row, limits, arrived, circles(state, row, arrived), airspeed, wx, wy)


@compiled
def _tick(
    state: Floats, row: Floats, arrived: bool, limits: Floats, step: int, wx: float, wy: float, rising: float
) -> bool:
    """Move one step and tell whether the leg is done."""
    kind = row[LEG_KIND]
    doing = state[DOING]
    if kind == FALL:
        drop(state, limits, wx, wy)
        return bool(state[col.POSITION_Z] <= 0.0)
    if doing == ROLLING:
        state[THROTTLE] = 0.0
        roll_on_ground(state, limits, -brake_rate(state, limits), wx, wy)
        return bool(
            state[col.VELOCITY_X] * state[col.VELOCITY_X] + state[col.VELOCITY_Y] * state[col.VELOCITY_Y]
            < STOPPED_M_S * STOPPED_M_S
        )
    if doing == ON_GROUND:
        take_off(state, limits, wx, wy)
        return False
    # ArduPlane's guidance and control of energy have their own, slower clock.
    if limits[LAW] == NPFG:
        bank, climb, rate = px4_control(state, row, arrived, limits, wx, wy)
    else:
        if step % col.GRID == 0 or state[RUNNING] == 0.0:
            _arduplane_control(state, row, arrived, limits, wx, wy)
        bank = state[BANK_DEMAND]
        state[THROTTLE] = min(state[THROTTLE_DEMAND], limits[THROTTLE_LIMIT])
        rate = energy_rate(limits, state[THROTTLE], state[AIRSPEED], 1.0 / cos(state[BANK]))
        climb = pitch_up(state, limits, state[PITCH_DEMAND])
    fly(state, limits, bank, climb, rate, wx, wy, rising)
    landing = kind in (LANDING, CIRCULAR_LANDING)
    if state[col.POSITION_Z] <= 0.0:
        state[col.POSITION_Z] = 0.0
        if landing:
            state[DOING] = ROLLING
            state[COURSE] = atan2(state[col.VELOCITY_X], state[col.VELOCITY_Y])
            state[col.VELOCITY_Z] = state[CLIMB] = 0.0
            return False
        state[col.VELOCITY_Z] = max(state[col.VELOCITY_Z], 0.0)
        state[CLIMB] = max(state[CLIMB], 0.0)
    if landing or arrived or (limits[LAW] != NPFG and step % col.GRID != 0):
        return False
    if kind == TAKEOFF:
        return bool(state[col.POSITION_Z] >= row[LEG_Z])
    if kind == CIRCLE:
        return circled(state, row, limits, step)
    return passed(state, row, limits)


@compiled
def advance(
    state: Floats,
    counters: Integers,
    route: Floats,
    limits: Floats,
    power: Floats,
    wind: Floats,
    first_wind: int,
    max_steps: int,
    stop_each: bool,
    arrivals: Integers,
    track: Floats,
    track_every: int,
) -> int:
    """Fly up to ``max_steps`` steps along the route; return early, with the event, when something happens.

    As `sim_vehicle.motion.multirotor.kernel.advance`. After the last leg the vehicle circles: on, where that
    was a circle, otherwise about the end of the leg.

    Parameters
    ----------
    state, counters : float64[STATE], int64[6]
        Changed in place.
    route : float64[n, LEG]
    limits, power : float64[LIMITS], float64[9]
    wind : float64[m, 9]
    """
    event = col.RAN
    for _ in range(max_steps):
        step, leg = counters[col.STEP], counters[col.LEG_INDEX]
        row = route[leg]
        if state[col.GIVE_UP_STEP] == inf:
            _enter(state, route, leg, step, limits)
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            wx, wy, up = wind_at(wind[index], state[col.POSITION_Z])
            if wx != state[col.WIND_EAST] or wy != state[col.WIND_NORTH] or up != state[WIND_UP]:
                blow(state, wx, wy, up)
                state[col.WIND_EAST], state[col.WIND_NORTH], state[WIND_UP] = wx, wy, up
            if state[DOING] == FLYING or state[DOING] == FLARE:
                load = 1.0 / cos(state[BANK])
                v = state[AIRSPEED]
                rate = energy_rate(limits, state[THROTTLE], v, load)
                state[col.POWER] = fixed_wing_power(power, v if state[THROTTLE] > 1e-3 else 0.0, rate, load)
            elif state[DOING] == ON_GROUND:
                state[col.POWER] = fixed_wing_power(power, limits[AIRSPEED_TRIM], limits[CLIMB_MAX], 1.0)
            else:
                state[col.POWER] = fixed_wing_power(power, 0.0, 0.0, 1.0)
            mark_track(
                counters,
                step,
                track,
                track_every,
                state[col.POSITION_X],
                state[col.POSITION_Y],
                state[col.POSITION_Z],
            )
            if counters[col.ARRIVED] == 0 and step > state[col.GIVE_UP_STEP]:
                event = col.STALLED
                break
        done = _tick(
            state,
            row,
            counters[col.ARRIVED] != 0,
            limits,
            step,
            state[col.WIND_EAST],
            state[col.WIND_NORTH],
            state[WIND_UP],
        )
        state[col.ENERGY_USED] += state[col.POWER] * limits[STEP_S]
        counters[col.STEP] = step + 1
        if counters[col.ARRIVED] == 0:
            if done:
                event = complete_leg(counters, arrivals, step + 1, stop_each)
                if counters[col.ARRIVED] == 0:
                    state[col.GIVE_UP_STEP] = inf
                else:
                    _settle(state, row, limits)
            elif counters[col.NEAR_TOLD] == 0 and row[LEG_NEAR] > 0.0:
                rx, ry, rz = (
                    row[LEG_X] - state[col.POSITION_X],
                    row[LEG_Y] - state[col.POSITION_Y],
                    row[LEG_Z] - state[col.POSITION_Z],
                )
                if rx * rx + ry * ry + rz * rz < row[LEG_NEAR] * row[LEG_NEAR]:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state[col.ENERGY_USED] >= limits[ENERGY_LIMIT]:
            event = col.ENERGY
        if event != col.RAN:
            break
    return event


@compiled
def _settle(state: Floats, row: Floats, limits: Floats) -> None:
    """Choose the circle that is flown after the end of a route."""
    copy(state, CENTRE, row, 0, 3)
    state[CENTRE_RADIUS] = row[LEG_CIRCLE_RADIUS] if row[LEG_KIND] == CIRCLE else limits[LOITER_RADIUS]
    if row[LEG_KIND] == TAKEOFF:
        state[CENTRE], state[CENTRE + 1] = state[col.POSITION_X], state[col.POSITION_Y]
