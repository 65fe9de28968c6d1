"""Columns of the memory and the law of a ground vehicle under ArduPilot's Rover.

Its path is that of `sim_vehicle.motion.arducopter`, as both autopilots use the same S-curves; what only Rover
has comes behind.
"""

from __future__ import annotations

from enum import IntEnum

from sim_vehicle.motion.arducopter.layout import Guide, Law
from sim_vehicle.motion.records import record_type

Drive = IntEnum(
    "Drive",
    [
        "SPEED_ASKED",  # Desired speed and rate of turning after their limits.
        "TURN_ASKED",
        "STEER_ERROR",  # Filtered errors and integrators.
        "STEER_I",
        "DRIVE_ERROR",
        "DRIVE_I",
        "PIVOTS",  # Whether it turns on the spot; 2: it has turned and pauses.
        "PIVOTS_NEXT",  # Whether it will at the next waypoint.
        "STANDS",  # Whether it was told to stop and has.
    ],
    start=len(Guide),
)
DriveGains = IntEnum(
    "DriveGains",
    [
        "NEAR",  # A stop is reached within it.
        "SPEED_ACCEL",  # Accelerations of the speed that is asked for.
        "DECEL",
        "LATERAL",  # Greatest lateral acceleration.
        "TURN_SPEED",  # Speed that it keeps in turns, unless it slows down.
        "STEER_ACCEL",
        "STEER_RATE",
        "STEER_FF",
        "STEER_P",
        "STEER_I_GAIN",
        "STEER_IMAX",
        "STEER_FILTER",
        "SCALE_BASE",  # Speed above which the steering is scaled down.
        "TIGHTEST",  # Radius at full steering; 0: it steers by its tracks.
        "STEER_LAG",  # Share of the lag of tracks in a step.
        "ANGLE_P",
        "PIVOT_ANGLE",  # 0: never.
        "PIVOT_RATE",
        "PIVOT_DELAY",
        "DRIVE_BASE",  # Throttle over speed.
        "DRIVE_P",
        "DRIVE_I_GAIN",
        "DRIVE_IMAX",
        "DRIVE_FILTER",
        "STOP_SPEED",
        "TOP_SPEED",  # At full throttle.
        "DRIVE_LAG",  # Share of the drive's lag in a step.
    ],
    start=len(Law),
)
GUIDE, LAW = record_type(Guide, Drive), record_type(Law, DriveGains)
