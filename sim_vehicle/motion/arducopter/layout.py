"""What stands where in the arrays of a multirotor under ArduCopter."""

from __future__ import annotations

# Columns of a route.
LEG = 10
RX, RY, RZ, RADIUS, SPEED, HEADING, DISTANCE, KIND, PAUSE, TURNING = range(LEG)
# Kinds of legs that are flown differently (`sim_vehicle.motion.legs.LegKind`).
TAKEOFF, HOME, LAND, STAY, ARC, SETPOINT = 1, 3, 5, 6, 8, 9

# The guide: desired position, velocity and acceleration, begin and end of the leg, three numbers each
GUIDE = 46
PX, VX, AX, BEGIN, END = 0, 3, 6, 9, 12
# pace of the target, error along the track and speed along it
PACE, LAG, ALONG = 15, 16, 17
# velocity loop: integrator, filtered error and its filtered rate, two numbers each; vertical: filtered error,
# integrator of the thrust, thrust over weight; whether the filters begin anew
INTEGRAL, ERROR, RATE, ERROR_Z, THRUST_I, THRUST, RESET = 18, 20, 22, 24, 25, 26, 27
# horizontal acceleration that is asked for, that of the attitude target, and that of the attitude
ASKED, TARGET, LEAN = 28, 30, 32
# mode, whether the next leg is known, speed in use (level, up, down), what to begin
MODE, FAST, LEVEL, UP, DOWN, BEGINS = 34, 35, 36, 37, 38, 39
# step until which it waits (infinity: it does not), whether the path is done (2: the pause runs), speed along
# chords, vertical wind, vertical acceleration by drag, steps on the ground before the motors spool up
UNTIL, DONE, PACE_ARC, RISING, LIFT, ARMING_STEPS = 40, 41, 42, 43, 44, 45

NO_MODE, HOLDING, LEGS, CLIMBING, LANDING, LANDED, CHORDS, GUIDED = range(8)
NOTHING, CHAINED, SAME, ANEW = range(4)

# The law: constants of control and dynamics that parameters and the airframe decide.
LAW = 39
(
    DT,
    DRAG,
    DRAG_2,
    ERROR_FILTER,
    RATE_FILTER,
    POS_P,
    VEL_P,
    VEL_I,
    VEL_D,
    VEL_IMAX,
    POS_Z_P,
    VEL_Z_P,
    ERROR_Z_FILTER,
    ACC_Z_P,
    ACC_Z_I,
    ACC_Z_IMAX,
    ACCEL,
    ACCEL_Z,
    CORNER,
    WP_RADIUS,
    PACE_FILTER,
    JERK,
    SNAP,
    SHAPE_JERK,
    SHAPE_JERK_Z,
    MOST_LEAN,
    TARGET_FILTER,
    LEAN_FILTER,
    SPEED_UP,
    SPEED_DOWN,
    LAND_FAST,
    LAND_SLOW,
    LAND_LOW,
    SPOOL_STEPS,
    DETECT_STEPS,
    YAW_RATE,
    YAW_ACCEL,
    LOOKS_AHEAD,
    STAND_BY,
) = range(LAW)

LEAST_SPEED = 0.2
"""A lower horizontal speed is not taken (WPNAV_WP_SPEED_MIN)."""
LEAST_WAY = 0.01
"""A leg from where the vehicle stands is at least so long: an estimated position is never the exact one."""
SHAKE = 0.04
"""By how much the estimated speed shakes, m/s: it decides how the target waits for a vehicle at rest."""
SIDE = 0.7071067811865476
"""Guided to a position: the share of the acceleration that may go across where more goes along."""
