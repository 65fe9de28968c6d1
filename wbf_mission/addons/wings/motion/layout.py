"""Columns of a fixed wing's state, legs and limits, shared by all compiled code."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum

from sim_vehicle.autopilot.procedures import FixedWingBounds
from sim_vehicle.motion.columns import State, record_type

# State beyond the columns shared by all vehicles.
Wing = IntEnum(
    "Wing",
    "BANK "
    "AIRSPEED "  # True airspeed.
    "CLIMB "  # Vertical air velocity.
    "THROTTLE "  # 0 to 1.
    "PITCH "
    "COMMAND "  # Commanded bank.
    "BEGIN_X BEGIN_Y BEGIN_Z "  # Start of the leg.
    "COURSE "  # Course on the ground.
    "TURNED "  # Angle flown around the centre.
    "BEARING "  # Bearing from the centre; NaN until the circle is reached.
    "PAUSE_END "  # Step at which a pause ends.
    "DOING "  # ON_GROUND, FLYING, FLARE or ROLLING.
    "GUIDANCE "  # Last angle of the L1 guidance.
    "GUIDANCE_INTEGRAL "
    # Centre and radius of the circle after the end of a route.
    "CENTRE_X CENTRE_Y CENTRE_Z CENTRE_RADIUS "
    "DIRECT "  # Whether the vehicle flies straight to the waypoint, without a line to follow.
    "ROLL_RATE "
    "SINCE "  # Seconds since arming on the ground, lift-off, or the start of the flare.
    "BANK_DEMAND PITCH_DEMAND THROTTLE_DEMAND "
    "TARGET "  # Demanded height; at first the height at the start of the leg.
    "SLOPE "  # Height to gain along the leg; 0: the height is changed at once.
    "STAGE "  # Stage of a landing: LINING_UP, APPROACH or PREFLARE.
    "LEVEL_OFF "  # Height left to climb when the nose began to come down; 0 before that.
    # Total energy control.
    "RUNNING "  # Whether the controller is running.
    "LAST_SPEED SPEED_DEMAND SPEED_RATE_FILTER ACCELERATION_FILTER SPEED_MAX HEIGHT_IN HEIGHT_LIMITED "
    "HEIGHT_FILTER HEIGHT_OFFSET HEIGHT_DEMAND CLIMB_SCALE SINK_SCALE ENERGY_RATE_ERROR "
    "THROTTLE_INTEGRAL THROTTLE_LAST "
    "THROTTLE_FLOOR "  # Minimum throttle, which falls slowly after a climb-out.
    "BALANCE_INTEGRAL SPEED_INTEGRAL "
    "PITCH_FREE "  # Pitch before its limits.
    "THROTTLE_CLIP "  # 1 beyond the upper limit, -1 below the lower limit, else 0.
    "BALANCE_CLIP UNDERSPEED UNDERSPEED_S BAD_DESCENT "
    "PATH_RATE "  # Rate at which the path bends upward.
    "SLIP "  # Turn rate that the lagging side force has reached.
    "NOSE_UP "  # Pitch error while the integral of pitch control lags.
    "TRIMMED "  # Lift coefficient (unit of LIFT_LEVEL) for which the elevator is trimmed; 0: none yet.
    "FLARE_FROM "  # Height at the start of the flare; NaN before.
    "FLARE_RATE "  # Climb rate at the start of the flare.
    "FLARE_FOLLOWED FLARE_IDEAL "
    "LAST_KIND "  # Kind of the previous leg.
    # PX4's total energy control: height followed, rate of this height, filtered energy rate over weight.
    "REFERENCE REFERENCE_RATE TOTAL_RATE "
    "WIND_UP",
    start=len(State),
)
ON_GROUND, FLYING, FLARE, ROLLING = 0.0, 1.0, 2.0, 3.0
LINING_UP, APPROACH, PREFLARE = 0.0, 1.0, 2.0
# Speed below which the vehicle counts as standing.
STOPPED_M_S = 0.1
# Lower limit of speeds (m/s) and lengths (m) in divisions.
SHORT = 0.5
# Guidance laws of PX4 and of ArduPlane.
NPFG, L1 = 0.0, 1.0
# Period of ArduPlane's guidance and energy control.
PERIOD_S = 0.1

# Columns of a leg.
Leg = IntEnum(
    "Leg",
    "X Y Z KIND "
    "RADIUS "  # Acceptance radius; 0: the autopilot's default.
    "AIRSPEED "
    "NEAR "  # Distance at which arrival is notified.
    "CIRCLE_RADIUS "  # Positive for clockwise.
    "TURNS "
    "EXIT_X EXIT_Y "  # Point towards which the vehicle leaves the circle; NaN: anywhere.
    "PAUSE "
    "PITCH "  # Minimum pitch of a take-off.
    "HEIGHT_TOLERANCE "
    "TURN_ANGLE "  # Angle to the next leg.
    "SLOPE "  # Slope of a circular landing.
    "AT_ONCE "  # Whether the leg is a return, which climbs at once over any distance.
    "ON_CIRCLE",  # Whether the height is changed while circling.
    start=0,
)
LINE, CIRCLE, TAKEOFF, LANDING, CIRCULAR_LANDING, FALL = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedWingLimits(FixedWingBounds):
    """Flight limits of a fixed wing set by an autopilot's parameters; SI units, radians."""

    law: float
    """Guidance law: `NPFG` or `L1`."""
    airspeed_max: float
    # Time constant and maximum rate of the roll, and maximum rate of its setpoint.
    roll_s: float
    roll_rate_max: float
    roll_slew: float
    climb_max: float
    """Climb rate at full throttle and trim airspeed."""
    # Default climb and sink rates, and maximum sink rate.
    climb_rate: float
    sink_rate: float
    sink_max: float
    # Time constants of height and airspeed control.
    height_s: float
    speed_s: float
    vertical_acceleration: float
    # Guidance parameters.
    period: float
    damping: float
    integral: float = 0.0
    switch_share: float = 0.0
    """Distance at which NPFG joins a line before the line's start, or reaches a circle, as a fraction of the
    track error bound."""
    # Distance and height tolerances of waypoints; an infinite height tolerance disables the check.
    acceptance: float
    height_acceptance: float = math.inf
    landing_height_acceptance: float = math.inf
    """Height tolerance of the waypoint before a landing."""
    ground_min: float
    """Minimum ground speed; the airspeed is raised to reach it."""
    takeoff_airspeed: float
    """Airspeed of the climb-out."""
    # Airspeed of lift-off, and acceleration until lift-off (0: a ground roll by the vehicle's thrust).
    rotation: float
    launch: float
    # Height below which `level_bank` limits the bank.
    level_height: float = 0.0
    level_bank: float
    landing_airspeed: float
    # Height, or time before touchdown, at which the flare starts, and sink rate of the flare.
    flare_height: float
    flare_s: float
    flare_sink: float
    # Throttle ramp of a take-off roll: its duration and final throttle; time from lift-off to full climb.
    ramp_s: float = 0.0
    ramp_throttle: float = 1.0
    rotation_s: float = 0.0
    height_ahead: float = 1.0
    """Fraction of the demanded height's rate that is followed without lag."""
    # PX4's throttle control: throttle of level flight, to which the integrator adds; sink rate without
    # throttle; integral (1/s) and damping gain of the energy rate error; time constant of the measured rate;
    # and increase of the demanded rate per load factor (m^2/s^3).
    level_throttle: float = 0.0
    sink_min: float = 0.0
    total_integrator: float = 0.0
    total_damping: float = 0.0
    total_s: float = 0.0
    total_for_load: float = 0.0
    control: Mapping[str, float] = field(default_factory=dict)
    """Values of ArduPlane's energy control, landing and take-off, by column of `Limits`; empty for PX4."""


OF_WING = [each.name for each in fields(FixedWingLimits) if each.name != "control"]
# Limits beyond those of `FixedWingLimits`.
Limits = IntEnum(
    "Limits",
    # Limits of the airframe.
    "STEP_S WING_SPAN BRAKING GROUND_DRAG "
    "THRUST "  # Thrust at full throttle divided by mass, m/s^2.
    "PARASITIC "  # Drag divided by mass and squared airspeed.
    "INDUCED "  # Induced drag divided by mass, times squared airspeed, per squared load.
    "LIFT_LEVEL "  # Lift divided by mass and squared airspeed, at zero angle of attack.
    "LIFT_SLOPE "  # Increase of LIFT_LEVEL per radian of angle of attack.
    "TURN_SHARE "
    "TRIM_CHANGE "  # Elevator angle per change of lift coefficient (unit of LIFT_LEVEL).
    "ENERGY_LIMIT THROTTLE_LIMIT "
    # Limits of ArduPlane: energy control, pitch, landing and take-off; SI units, radians, throttle 0 to 1.
    "TIME_S INTEGRATOR PITCH_DAMPING THROTTLE_DAMPING ROLL_TO_THROTTLE SPEED_WEIGHT DEMAND_S "
    "TECS_CLIMB TECS_SINK_MIN TECS_SINK_MAX TRIM_THROTTLE THROTTLE_MIN THROTTLE_MAX THROTTLE_SLEW "
    "PITCH_MIN PITCH_MAX PITCH_S PITCH_UP_RATE PITCH_DOWN_RATE PITCH_FEED_FORWARD PITCH_GAIN "
    "PITCH_INTEGRATOR SCALING_SPEED "
    "SLOPE_MIN "  # Smaller height changes are made at once, not along a slope.
    "LAND_S LAND_DAMPING LAND_SPEED_WEIGHT LAND_PITCH LAND_PITCH_MAX HOLD_OFF_HEIGHT FLARE_AIM "
    "PREFLARE_HEIGHT PREFLARE_S PREFLARE_AIRSPEED HEAD_WIND_SHARE LEVEL_OFF_S TAKEOFF_THROTTLE "
    "TAKEOFF_DELAY THROTTLE_EASE",
    start=len(OF_WING),
)
STATE, LEG = record_type(State, Wing), record_type(Leg)
LIMITS = record_type(OF_WING, Limits)
