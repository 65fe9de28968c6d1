"""What stands where in the arrays of a multirotor under ArduCopter."""

from __future__ import annotations

# Columns of a route.
LEG = 10
RX, RY, RZ, RADIUS, SPEED, HEADING, DISTANCE, KIND, PAUSE, TURNING = range(LEG)
# Kinds of legs that have a law of their own (`sim_vehicle.motion.legs.LegKind`).
TAKEOFF, HOME, LAND, STAY, ARC = 1, 3, 5, 6, 8

# The guide: desired position 0-2, velocity 3-5 and acceleration 6-8; begin 9-11 and end 12-14 of the leg
GUIDE = 45
PX, VX, AX, BEGIN, END = 0, 3, 6, 9, 12
# pace of the target 15, error along the track 16 and speed along it 17
PACE, LAG, ALONG = 15, 16, 17
# velocity loop: integrator 18-19, filtered error 20-21, its filtered rate 22-23; vertical: filtered error 24,
# integrator of the thrust 25, thrust over weight 26; whether the filters begin anew 27
INTEGRAL, ERROR, RATE, ERROR_Z, THRUST_I, THRUST, RESET = 18, 20, 22, 24, 25, 26, 27
# acceleration that is asked for 28-29, that of the attitude target 30-31, and that of the attitude 32-33
ASKED, TARGET, LEAN = 28, 30, 32
# mode 34, whether the next leg is known 35, speed in use 36-38 (level, up, down), what to begin 39
MODE, FAST, LEVEL, UP, DOWN, BEGINS = 34, 35, 36, 37, 38, 39
# step until which it waits 40 (infinity: it does not), whether the way is done 41 (2: the pause runs), speed
# along chords 42, vertical wind 43, vertical acceleration by drag 44
UNTIL, DONE, PACE_ARC, RISING, LIFT = 40, 41, 42, 43, 44

NO_MODE, HOLDING, LEGS, CLIMBING, LANDING, LANDED, CHORDS = range(7)
NOTHING, CHAINED, SAME, ANEW = range(4)

# The law: what parameters and the airframe decide.
LAW = 40
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
    CAPACITY,
    STAND_BY,
) = range(LAW)

LEAST_SPEED = 0.2
"""A lower horizontal speed is not taken (WPNAV_WP_SPEED_MIN)."""
LEAST_WAY = 0.01
"""A leg from where the vehicle stands is at least so long: an estimated position is never the exact one."""
SHAKE = 0.04
"""By how much the estimated speed shakes, m/s: it decides how the target waits for a vehicle at rest."""
