"""Columns of the legs, the memory and the law of a multirotor under ArduCopter."""

from __future__ import annotations

from enum import IntEnum

from sim_vehicle.motion.columns import record_type

Leg = IntEnum(
    "Leg",
    "X Y Z RADIUS SPEED HEADING "
    "NEAR "  # Distance to notify at.
    "KIND "  # `LegKind`.
    "PAUSE "
    "TURNING",  # Rate.
    start=0,
)
# Kinds of legs that are flown differently (`sim_vehicle.motion.legs.LegKind`).
TAKEOFF, HOME, LAND, STAY, ARC, SETPOINT = 1, 3, 5, 6, 8, 9

# What the autopilot remembers.
Guide = IntEnum(
    "Guide",
    "PX PY PZ VX VY VZ AX AY AZ "  # Desired position, velocity and acceleration.
    "BEGIN_X BEGIN_Y BEGIN_Z END_X END_Y END_Z "  # Begin and end of the leg.
    "PACE "  # Of the target.
    "LAG "  # Error along the track.
    "ALONG "  # Speed along it.
    # Velocity loop: integrator, filtered error and its filtered rate.
    "INTEGRAL_X INTEGRAL_Y ERROR_X ERROR_Y RATE_X RATE_Y "
    "ERROR_Z "  # Filtered error of the vertical speed.
    "THRUST_I "  # Integrator of the thrust.
    "THRUST "  # Over weight.
    "RESET "  # Whether the filters begin anew.
    # Horizontal acceleration: asked for, of the attitude target, of the attitude.
    "ASKED_X ASKED_Y TARGET_X TARGET_Y LEAN_X LEAN_Y "
    "MODE "
    "FAST "  # Whether the next leg is known.
    "LEVEL UP DOWN "  # Speeds in use.
    "BEGINS "  # What to begin.
    "UNTIL "  # Step until which it waits; infinity: it does not.
    "DONE "  # Whether the path is done; 2: the pause runs.
    "PACE_ARC "  # Speed along chords.
    "RISING "  # Vertical wind.
    "LIFT "  # Vertical acceleration by drag.
    "ARMING_STEPS",  # On the ground before the motors spool up.
    start=0,
)
NO_MODE, HOLDING, LEGS, CLIMBING, LANDING, LANDED, CHORDS, GUIDED = range(8)
NOTHING, CHAINED, SAME, ANEW = range(4)

# Constants of control and dynamics that parameters and the airframe decide.
Law = IntEnum(
    "Law",
    "DT DRAG DRAG_2 ERROR_FILTER RATE_FILTER POS_P VEL_P VEL_I VEL_D VEL_IMAX POS_Z_P VEL_Z_P "
    "ERROR_Z_FILTER ACC_Z_P ACC_Z_I ACC_Z_IMAX ACCEL ACCEL_Z CORNER WP_RADIUS PACE_FILTER JERK SNAP "
    "SHAPE_JERK SHAPE_JERK_Z MOST_LEAN TARGET_FILTER LEAN_FILTER SPEED_UP SPEED_DOWN LAND_FAST "
    "LAND_SLOW LAND_LOW SPOOL_STEPS DETECT_STEPS YAW_RATE YAW_ACCEL LOOKS_AHEAD STAND_BY",
    start=0,
)
LEG, GUIDE, LAW = record_type(Leg), record_type(Guide), record_type(Law)

LEAST_SPEED = 0.2
"""A lower horizontal speed is not taken (WPNAV_WP_SPEED_MIN)."""
LEAST_WAY = 0.01
"""A leg from where the vehicle stands is at least so long: an estimated position is never the exact one."""
SHAKE = 0.04
"""By how much the estimated speed shakes, m/s: it decides how the target waits for a vehicle at rest."""
SIDE = 0.7071067811865476
"""Guided to a position: the share of the acceleration that may go across where more goes along."""
