"""Columns of a fixed wing's state, of its legs and of its limits, for all compiled code that reads them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum

from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import State, record_type

# The state beyond the shared numbers.
Wing = IntEnum(
    "Wing",
    "BANK "
    "AIRSPEED "  # True airspeed.
    "CLIMB "  # Through the air.
    "THROTTLE "  # 0 to 1.
    "PITCH "
    "COMMAND "  # Bank that is commanded.
    "BEGIN_X BEGIN_Y BEGIN_Z "  # Beginning of the leg.
    "COURSE "  # On the ground.
    "TURNED "  # About the centre.
    "BEARING "  # From the centre; NaN: not circling yet.
    "PAUSE_END "  # Step at which a pause ends.
    "DOING "  # ON_GROUND, FLYING, FLARE or ROLLING.
    "GUIDANCE "  # Last angle of the guidance.
    "GUIDANCE_INTEGRAL "
    # Position that is circled after the end of a route, and the radius.
    "CENTRE_X CENTRE_Y CENTRE_Z CENTRE_RADIUS "
    "DIRECT "  # Whether it flies straight to the waypoint, without a line to keep.
    "ROLL_RATE "
    "SINCE "  # Seconds with the motor armed on the ground, since the lift-off, or in the flare.
    "BANK_DEMAND PITCH_DEMAND THROTTLE_DEMAND "
    "TARGET "  # Height that is asked for; at first that where the leg began.
    "SLOPE "  # Height to gain along the leg; 0: at once.
    "STAGE "  # Of a landing: LINING_UP, APPROACH or PREFLARE.
    "LEVEL_OFF "  # Height below that of the take-off at which the nose begins to come down; 0: not yet.
    # Total energy control.
    "RUNNING "  # Whether it has begun.
    "LAST_SPEED SPEED_DEMAND SPEED_RATE_FILTER ACCELERATION_FILTER SPEED_MAX HEIGHT_IN HEIGHT_LIMITED "
    "HEIGHT_FILTER HEIGHT_OFFSET HEIGHT_DEMAND CLIMB_SCALE SINK_SCALE ENERGY_RATE_ERROR "
    "THROTTLE_INTEGRAL THROTTLE_LAST "
    "THROTTLE_FLOOR "  # Comes down slowly after a climb-out.
    "BALANCE_INTEGRAL SPEED_INTEGRAL "
    "PITCH_FREE "  # Pitch before its limits.
    "THROTTLE_CLIP "  # -1, 0 or 1.
    "BALANCE_CLIP UNDERSPEED UNDERSPEED_S BAD_DESCENT "
    "PATH_RATE "  # How fast the path turns upward.
    "SLIP "  # Rate of the turn that the side force has followed.
    "NOSE_UP "  # How far the nose is held too high while the integral of the pitch control lags.
    "TRIMMED "  # Lift coefficient, as in LIFT_SLOPE, that the elevator was trimmed for; 0: not yet.
    "FLARE_FROM "  # Height at which the flare began; NaN: not begun.
    "FLARE_RATE "  # Climb rate then.
    "FLARE_FOLLOWED FLARE_IDEAL "
    "LAST_KIND "  # Of the leg before.
    # PX4's total energy control: the height that is followed and its rate, and the filtered energy rate
    # over the weight.
    "REFERENCE REFERENCE_RATE TOTAL_RATE "
    "WIND_UP",
    start=len(State),
)
ON_GROUND, FLYING, FLARE, ROLLING = 0.0, 1.0, 2.0, 3.0
LINING_UP, APPROACH, PREFLARE = 0.0, 1.0, 2.0
# Slower than this it stands.
STOPPED_M_S = 0.1
# Nothing is divided by speeds (m/s) and lengths (m) below this.
SHORT = 0.5

# One leg.
Leg = IntEnum(
    "Leg",
    "X Y Z KIND "
    "RADIUS "  # Acceptance radius; 0: the autopilot's.
    "AIRSPEED "
    "NEAR "  # Distance to notify at.
    "CIRCLE_RADIUS "  # Positive: clockwise.
    "TURNS "
    "EXIT_X EXIT_Y "  # Where to leave the circle to; NaN: anywhere.
    "PAUSE "
    "PITCH "  # Least pitch of a take-off.
    "HEIGHT_TOLERANCE "
    "TURN_ANGLE "  # Angle to the next leg.
    "SLOPE "  # Of a circular landing.
    "AT_ONCE "  # Whether it is a return: it climbs at once, however far the way is.
    "ON_CIRCLE",  # Whether the height is left for the circle.
    start=0,
)
LINE, CIRCLE, TAKEOFF, LANDING, CIRCULAR_LANDING, FALL = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0


@dataclass(frozen=True, slots=True)
class FixedWingLimits:
    """Limits of a fixed wing's flight that an autopilot's parameters set; SI units, radians."""

    law: float
    """Guidance: `wbf_mission.addons.wings.motion.guidance.NPFG` or `L1`."""
    airspeed_min: float
    airspeed_trim: float
    airspeed_max: float
    bank_limit: float
    # Time constant and greatest rate of the roll, greatest rate of its set-point.
    roll_s: float
    roll_rate_max: float
    roll_slew: float
    climb_max: float
    """At full throttle and trim airspeed."""
    # Rates at which heights are changed, and the greatest sink rate.
    climb_rate: float
    sink_rate: float
    sink_max: float
    # Time constants of height and airspeed.
    height_s: float
    speed_s: float
    vertical_acceleration: float
    # Of the guidance.
    period: float
    damping: float
    integral: float
    switch_share: float
    """NPFG holds a line from before it, and counts a circle as reached, at this share of its track error
    bound."""
    # Of waypoints; an infinite tolerance of the height is none.
    acceptance: float
    height_acceptance: float
    landing_height_acceptance: float
    """Before a landing."""
    ground_min: float
    """The airspeed is raised to make this ground speed."""
    takeoff_airspeed: float
    """Of the climb-out."""
    # Airspeed at which the ground is left, and acceleration up to there; 0 rolls by its own thrust.
    rotation: float
    launch: float
    # Greatest bank below a height.
    level_height: float
    level_bank: float
    landing_airspeed: float
    # The flare begins at a height or a time above the ground; sink rate in it.
    flare_height: float
    flare_s: float
    flare_sink: float
    landing_slope: float
    """Sink over path length on a circle down to the ground."""
    loiter_radius: float
    """Of circles without a radius; positive is clockwise."""
    # Rise of the throttle in a take-off roll: its time and end; time from lift-off to the full climb.
    ramp_s: float = 0.0
    ramp_throttle: float = 1.0
    rotation_s: float = 0.0
    height_ahead: float = 1.0
    """Share of the rate of a demanded height that is followed without lag."""
    # PX4's throttle: what it takes level flight to need, the integrator gives the rest; the sink rate without
    # throttle; integral (1/s) and damping over what is missing of the energy rate, the time constant of the
    # rate that is measured, and what one more load factor adds to it (m^2/s^3).
    level_throttle: float = 0.0
    sink_min: float = 0.0
    total_integrator: float = 0.0
    total_damping: float = 0.0
    total_s: float = 0.0
    total_for_load: float = 0.0

    def tightest_m(self, airspeed_m_s: float) -> float:
        """Return the radius of a level turn at the bank limit."""
        return airspeed_m_s * airspeed_m_s / (GRAVITY_M_S2 * math.tan(self.bank_limit))


# Limits beyond these.
Limits = IntEnum(
    "Limits",
    # Those of the airframe.
    "STEP_S WING_SPAN BRAKING GROUND_DRAG "
    "THRUST "  # At full throttle over the mass, m/s^2.
    "PARASITIC "  # Drag over the mass and the square of the airspeed.
    "INDUCED "  # Induced drag over the mass, times the square of the airspeed over that of the load.
    "LIFT_LEVEL "  # Lift over the mass and the square of the airspeed at zero angle of attack.
    "LIFT_SLOPE "  # The same per radian.
    "TURN_SHARE "
    "TRIM_CHANGE "  # Elevator, as an angle, over a change of the lift coefficient as in LIFT_SLOPE.
    "ENERGY_LIMIT THROTTLE_LIMIT "
    # Those of ArduPlane: control of energy, pitch, landing and take-off; SI units, radians, throttle 0 to 1.
    "TIME_S INTEGRATOR PITCH_DAMPING THROTTLE_DAMPING ROLL_TO_THROTTLE SPEED_WEIGHT DEMAND_S "
    "TECS_CLIMB TECS_SINK_MIN TECS_SINK_MAX TRIM_THROTTLE THROTTLE_MIN THROTTLE_MAX THROTTLE_SLEW "
    "PITCH_MIN PITCH_MAX PITCH_S PITCH_UP_RATE PITCH_DOWN_RATE PITCH_FEED_FORWARD PITCH_GAIN "
    "PITCH_INTEGRATOR SCALING_SPEED "
    "SLOPE_MIN "  # Smaller changes of height are made at once.
    "LAND_S LAND_DAMPING LAND_SPEED_WEIGHT LAND_PITCH LAND_PITCH_MAX HOLD_OFF_HEIGHT FLARE_AIM "
    "PREFLARE_HEIGHT PREFLARE_S PREFLARE_AIRSPEED HEAD_WIND_SHARE LEVEL_OFF_S TAKEOFF_THROTTLE "
    "TAKEOFF_DELAY THROTTLE_EASE",
    start=len(fields(FixedWingLimits)),
)
STATE, LEG = record_type(State, Wing), record_type(Leg)
LIMITS = record_type([field.name for field in fields(FixedWingLimits)], Limits)
