"""What stands where in the arrays of a ground vehicle under ArduPilot's Rover.

Its path is that of `sim_vehicle.motion.arducopter`, as both autopilots use the same S-curves; what only Rover
has comes behind.
"""

from __future__ import annotations

from sim_vehicle.motion.arducopter import layout as copter

# Desired speed and rate of turning after their limits; filtered errors and integrators of the steering and
# the throttle; whether it turns on the spot (2: it has turned and pauses), whether it will at the next
# waypoint, and whether it was told to stop and has.
(
    SPEED_ASKED,
    TURN_ASKED,
    STEER_ERROR,
    STEER_I,
    DRIVE_ERROR,
    DRIVE_I,
    PIVOTS,
    PIVOTS_NEXT,
    STANDS,
) = range(copter.GUIDE, copter.GUIDE + 9)
GUIDE = copter.GUIDE + 9

(
    NEAR,  # A stop is reached within it.
    SPEED_UP,  # Accelerations of the speed that is asked for.
    DECEL,
    LATERAL,  # Greatest lateral acceleration.
    TURN_SPEED,  # Speed that it keeps in turns, unless it slows down.
    STEER_ACCEL,
    STEER_RATE,
    STEER_FF,
    STEER_P,
    STEER_I_GAIN,
    STEER_IMAX,
    STEER_FILTER,
    SCALE_BASE,  # Speed above which the steering is scaled down.
    TIGHTEST,  # Radius at full steering; 0: it steers by its tracks.
    STEER_LAG,  # Share of the lag of tracks in a step.
    ANGLE_P,
    PIVOT_ANGLE,  # 0: never.
    PIVOT_RATE,
    PIVOT_DELAY,
    DRIVE_BASE,  # Throttle over speed.
    DRIVE_P,
    DRIVE_I_GAIN,
    DRIVE_IMAX,
    DRIVE_FILTER,
    STOP_SPEED,
    TOP_SPEED,  # At full throttle.
    DRIVE_LAG,  # Share of the drive's lag in a step.
) = range(copter.LAW, copter.LAW + 27)
LAW = copter.LAW + 27
