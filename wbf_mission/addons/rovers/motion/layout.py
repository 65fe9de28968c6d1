"""Columns of a ground vehicle's state and legs, and the limits that parameters decide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum

from sim_vehicle.motion.columns import State, record_type

# The state beyond the shared numbers.
Wheels = IntEnum(
    "Wheels",
    "SPEED "  # Ahead.
    "THROTTLE "  # 0 to 1.
    "PIVOTING "  # Whether it turns on the spot.
    "BEGIN_X BEGIN_Y "  # Beginning of the leg.
    "PAUSE_END "  # Step at which a pause ends; infinity: none runs.
    "YAW_ASKED RATE_ASKED SPEED_ASKED "
    "SPEED_INTEGRAL "  # Of its error.
    # Of PX4's simulated rover.
    "SIDEWAYS "  # Speed to the right.
    "RATE_INTEGRAL STEER_ASKED "
    "STEER PUSH",  # Steering and throttle after the simulator's lag.
    start=len(State),
)
# One leg.
Leg = IntEnum(
    "Leg",
    "X Y KIND "
    "RADIUS "  # Acceptance radius.
    "SPEED "
    "NEAR "  # Distance to notify at.
    "END_SPEED "  # Speed at its end.
    "PAUSE "
    "HEADING "  # Heading to keep.
    "Z",  # The ground: 0.
    start=0,
)
THROUGH, STOP, AT_ONCE, VELOCITY, BRAKE = 0.0, 1.0, 2.0, 3.0, 4.0


@dataclass(frozen=True, slots=True)
class RoverLimits:
    """Limits of driving that an autopilot's parameters set; SI units, radians."""

    speed_max: float
    acceleration: float
    deceleration: float
    # Tightest turn, greatest rate of turning and lateral acceleration.
    turn_radius: float
    turn_rate: float
    lateral: float
    steering_s: float
    """Time constant of the steering."""
    # Look-ahead of the pure pursuit: seconds, and metres.
    ahead_gain: float
    ahead_min: float
    ahead_max: float
    # Heading errors at which turning on the spot begins and ends, and its rate; a beginning of 0 is never.
    pivot_begin: float
    pivot_end: float
    pivot_rate: float
    acceptance: float
    """Radius of waypoints."""
    # Corner radius = gain x tightest-turn radius, capped at corner_max; 0 disables it.
    corner_gain: float
    corner_max: float
    passes: bool
    """Whether a waypoint that was driven past counts."""
    # Rate of turning over the error of the heading, and its greatest change; 0: the bend is that of pure
    # pursuit.
    yaw_p: float = 0.0
    yaw_acceleration: float = 0.0
    jerk: float = 0.0
    """Of slowing down; 0 is none."""
    # A corner of 180 degrees takes such a share of the greatest speed, down to the least; a negative share:
    # the speed is that which the lateral acceleration allows.
    corner_slows: float = -1.0
    corner_least: float = 0.0
    corner_most: float = 0.0
    simulated: Mapping[str, float] = field(default_factory=dict)
    """The vehicle, by columns of `Simulated`; without, it has the speed and turns as it is asked to."""


# PX4's simulated rover, and the loops that steer and drive it.
Simulated = IntEnum(
    "Simulated",
    "THROTTLE_SPEED SPEED_P SPEED_I "  # Throttle over speed, m/s and s/m.
    "WHEEL_BASE STEER_MAX "  # Metres; greatest angle of the wheels.
    "STEER_STEP "  # Greatest change of the steering in a step, as a share of full steering.
    "RATE_FF RATE_P RATE_I "  # Angle of the wheels over the rate of turning: of the feed-forward, s, and 1.
    "FORCE FRICTION "  # Per mass: of full throttle and of rolling, m/s^2.
    # Cornering stiffness over mass and over the moment of inertia, damping over that.
    "GRIP TURN_GRIP TURN_DAMPING "
    "ACTUATOR_SHARE "  # Share of a change of its outputs that it follows in a step.
    "DRAG "  # Per mass, over the square of the speed along each axis of the Earth, 1/m.
    "NORTH_1 NORTH_2 NORTH_3 EAST_1 EAST_2 EAST_3",  # Of the axes of the Earth.
    start=0,
)
# The energy that ends the drive, the step, the vehicle's limits, and PX4's simulated rover.
OF_ROVER = [each.name for each in fields(RoverLimits) if each.name != "simulated"]
ENERGY_LIMIT = 0
LIMITS = record_type(["energy_limit", "step_s", *OF_ROVER], Simulated)
STATE, LEG = record_type(State, Wheels), record_type(Leg)

STOPPED = 0.05
"""Below it the vehicle counts as standing, m/s."""
