"""What parameters decide about the flight of a fixed wing, as values and as the row of the kernel."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.power_spec import GRAVITY_M_S2, FixedWingAirframe, FixedWingPowerSpec
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.energy.power import DRAG, INDUCED_DRAG, power_coefficients
from sim_vehicle.motion.columns import record_of
from sim_vehicle.motion.fixed_wing.air import drag
from sim_vehicle.motion.fixed_wing.layout import LIMITS, Limits

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["ArduPlaneControl", "FixedWingLimits", "limits_row"]

# Whose drag is flown when nothing is known of the power: a foam mapper of 1.8 m span.
TYPICAL = FixedWingPowerSpec(mass_kg=1.9, wing_area_m2=0.42, wing_span_m=1.8, parasitic_drag=0.035)
# Deceleration on grass.
_BRAKE_M_S2 = 3.0
# ArduPlane counts the full throw of a control surface as 45 degrees.
_ELEVATOR_RAD = 0.25 * math.pi


@dataclass(frozen=True, slots=True)
class ArduPlaneControl:
    """Gains of ArduPlane's control of energy, landing and take-off; SI units, radians, throttle 0 to 1.

    Parameters
    ----------
    time_s, integrator, pitch_damping, throttle_damping, roll_to_throttle, speed_weight, demand_s : float
        TECS_TIME_CONST, TECS_INTEG_GAIN, TECS_PTCH_DAMP, TECS_THR_DAMP, TECS_RLL2THR, TECS_SPDWEIGHT,
        TECS_HDEM_TCONST.
    climb_max, sink_min, sink_max : float
        TECS_CLMB_MAX, TECS_SINK_MIN, TECS_SINK_MAX.
    trim_throttle, throttle_min, throttle_max, throttle_slew : float
        TRIM_THROTTLE, THR_MIN, THR_MAX; THR_SLEWRATE per second.
    pitch_min, pitch_max, pitch_s, pitch_up_rate, pitch_down_rate : float
        PTCH_LIM_MIN_DEG and PTCH_LIM_MAX_DEG within those of TECS; PTCH2SRV_TCONST, _RMAX_UP, _RMAX_DN.
    pitch_feed_forward, pitch_gain, pitch_integrator, scaling_speed : float
        PTCH_RATE_FF, PTCH_RATE_P, PTCH_RATE_I, SCALING_SPEED.
    slope_min : float
        ALT_SLOPE_MIN: smaller changes of height are made at once.
    land_s, land_damping, land_speed_weight, land_pitch, land_pitch_max, hold_off_height : float
        TECS_LAND_TCONST, TECS_LAND_DAMP, TECS_LAND_SPDWGT, LAND_PITCH_DEG, TECS_LAND_PMAX, TECS_FLARE_HGT.
    flare_aim, preflare_height, preflare_s, preflare_airspeed, head_wind_share : float
        LAND_FLARE_AIM, LAND_PF_ALT, LAND_PF_SEC, LAND_PF_ARSPD, LAND_WIND_COMP.
    level_off_s, takeoff_throttle, takeoff_delay_s, throttle_ease : float
        TKOFF_PLIM_SEC, TKOFF_THR_MAX, TKOFF_THR_DELAY; TECS_THR_ERATE per second.
    """

    time_s: float
    integrator: float
    pitch_damping: float
    throttle_damping: float
    roll_to_throttle: float
    speed_weight: float
    demand_s: float
    climb_max: float
    sink_min: float
    sink_max: float
    trim_throttle: float
    throttle_min: float
    throttle_max: float
    throttle_slew: float
    pitch_min: float
    pitch_max: float
    pitch_s: float
    pitch_up_rate: float
    pitch_down_rate: float
    pitch_feed_forward: float
    pitch_gain: float
    pitch_integrator: float
    scaling_speed: float
    slope_min: float
    land_s: float
    land_damping: float
    land_speed_weight: float
    land_pitch: float
    land_pitch_max: float
    hold_off_height: float
    flare_aim: float
    preflare_height: float
    preflare_s: float
    preflare_airspeed: float
    head_wind_share: float
    level_off_s: float
    takeoff_throttle: float
    takeoff_delay_s: float
    throttle_ease: float


@dataclass(frozen=True, slots=True)
class FixedWingLimits:
    """What an autopilot's parameters decide about the flight of a fixed wing; SI units, radians.

    Parameters
    ----------
    law : {0.0, 1.0}
        Guidance: `sim_vehicle.motion.fixed_wing.guidance.NPFG` or `L1`.
    bank_limit, roll_s, roll_rate, roll_slew : float
        Greatest bank, time constant and greatest rate of the roll, greatest rate of its set-point.
    climb_max, climb_rate : float
        Climb at full throttle and trim airspeed, and the rate at which heights are changed.
    sink_rate, sink_max : float
        Sink rate at which heights are changed, and greatest.
    height_s, speed_s : float
        Time constants of height and airspeed.
    period, damping, integral : float
        Of the guidance.
    switch_share : float
        NPFG holds a line from before it, and counts a circle as reached, at this share of its track error
        bound.
    acceptance, height_acceptance, landing_height_acceptance : float
        Of waypoints; an infinite tolerance of the height is none. The last one is that before a landing.
    ground_min : float
        The airspeed is raised to make this ground speed.
    takeoff_airspeed, rotation_airspeed, launch_acceleration : float
        Airspeed of the climb-out, airspeed at which the ground is left, and acceleration up to there; 0 rolls
        by its own thrust.
    level_height, level_bank : float
        Below this height the bank is limited to so much.
    landing_airspeed, flare_height, flare_s, flare_sink : float
        Approach speed; the flare begins at a height or a time above the ground; sink rate in it.
    landing_slope : float
        Sink over path length on a circle down to the ground.
    loiter_radius : float
        Of circles without a radius; positive is clockwise.
    ramp_s, ramp_throttle, rotation_s : float
        How long the throttle of a take-off roll rises, up to what, and from lift-off to the full climb.
    height_ahead : float
        Share of the rate of a demanded height that is followed without lag.
    level_throttle, sink_min : float
        What PX4 takes level flight to need, and the sink rate without throttle.
    total_integrator, total_damping, total_s, total_for_load : float
        PX4's throttle over what is missing of the energy rate: integral (1/s) and damping, the time constant
        of the rate that is measured, and what one more load factor adds to it (m^2/s^3).
    """

    law: float
    airspeed_min: float
    airspeed_trim: float
    airspeed_max: float
    bank_limit: float
    roll_s: float
    roll_rate: float
    roll_slew: float
    climb_max: float
    climb_rate: float
    sink_rate: float
    sink_max: float
    height_s: float
    speed_s: float
    vertical_acceleration: float
    period: float
    damping: float
    integral: float
    switch_share: float
    acceptance: float
    height_acceptance: float
    landing_height_acceptance: float
    ground_min: float
    takeoff_airspeed: float
    rotation_airspeed: float
    launch_acceleration: float
    level_height: float
    level_bank: float
    landing_airspeed: float
    flare_height: float
    flare_s: float
    flare_sink: float
    landing_slope: float
    loiter_radius: float
    ramp_s: float = 0.0
    ramp_throttle: float = 1.0
    rotation_s: float = 0.0
    height_ahead: float = 1.0
    level_throttle: float = 0.0
    sink_min: float = 0.0
    total_integrator: float = 0.0
    total_damping: float = 0.0
    total_s: float = 0.0
    total_for_load: float = 0.0

    def tightest_m(self, airspeed_m_s: float) -> float:
        """Return the radius of a level turn at the bank limit."""
        return airspeed_m_s * airspeed_m_s / (GRAVITY_M_S2 * math.tan(self.bank_limit))


def limits_row(
    spec: VehicleSpec, limits: FixedWingLimits, control: ArduPlaneControl | None
) -> NDArray[np.float64]:
    """Return the limits of a vehicle in the order of the kernel, float64[LIMITS].

    Parameters
    ----------
    control : ArduPlaneControl or None
        None for other autopilots.
    """
    power = spec.power if isinstance(spec.power, FixedWingPowerSpec) else TYPICAL
    frame = FixedWingAirframe() if spec.airframe is None else spec.airframe
    coefficients = power_coefficients(power)
    mass = power.mass_kg
    # rho S / (2 m): times a coefficient and V^2 it is an acceleration.
    per_coefficient = coefficients[DRAG] / (mass * power.parasitic_drag)
    row = np.zeros(len(Limits))
    row[: Limits.STEP_S] = astuple(limits)
    row[Limits.STEP_S] = spec.step_s
    row[Limits.WING_SPAN] = power.wing_span_m
    row[Limits.GROUND_DRAG] = frame.ground_drag_1_s or 0.0
    row[Limits.BRAKING] = 0.0 if frame.ground_drag_1_s else _BRAKE_M_S2
    row[Limits.PARASITIC] = coefficients[DRAG] / mass
    row[Limits.INDUCED] = coefficients[INDUCED_DRAG] / mass
    row[Limits.LIFT_LEVEL] = per_coefficient * frame.lift_level
    row[Limits.LIFT_SLOPE] = per_coefficient * frame.lift_slope
    row[Limits.TURN_SHARE] = frame.turn_share
    row[Limits.TRIM_CHANGE] = _ELEVATOR_RAD * frame.elevator_per_lift / per_coefficient
    trim = limits.airspeed_trim
    climbing = drag(record_of(row, LIMITS), trim, 1.0) + GRAVITY_M_S2 * limits.climb_max / trim
    row[Limits.THRUST] = climbing if frame.thrust_n is None else frame.thrust_n / mass
    row[Limits.ENERGY_LIMIT] = math.inf if spec.battery is None else spec.battery.capacity_wh * WH_J
    row[Limits.THROTTLE_LIMIT] = 1.0
    if control is not None:
        row[Limits.TIME_S :] = astuple(control)
    return row
