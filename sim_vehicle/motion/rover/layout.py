"""Columns of a ground vehicle's state and legs, and the limits that parameters decide."""

from __future__ import annotations

from dataclasses import dataclass, fields
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
    "STEER PUSH",  # What the simulator has made of the steering and of the throttle.
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
class SihRover:
    """The rover of PX4's simulator, and the loops that steer and drive it.

    Parameters
    ----------
    throttle_speed, speed_p, speed_i : float
        Throttle over speed, m/s and s/m.
    wheel_base, steer_max, steer_speed : float
        Metres; greatest angle of the wheels, rad, and its greatest change, rad/s.
    rate_ff, rate_p, rate_i : float
        Angle of the wheels over the rate of turning: of the feed-forward, s, and 1.
    force, friction : float
        Per mass: of full throttle and of rolling, m/s^2.
    grip, turn_grip, turn_damping : float
        Cornering stiffness over mass and over the moment of inertia, damping over that.
    actuator_s : float
        Time constant of its outputs.
    drag : float
        Per mass, over the square of the speed along each axis of the Earth, 1/m.
    north, east : tuple of 3 floats
        Those directions in the axes of the Earth.
    """

    throttle_speed: float
    speed_p: float
    speed_i: float
    wheel_base: float
    steer_max: float
    steer_speed: float
    rate_ff: float
    rate_p: float
    rate_i: float
    force: float
    friction: float
    grip: float
    turn_grip: float
    turn_damping: float
    actuator_s: float
    drag: float
    north: tuple[float, float, float]
    east: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RoverLimits:
    """What an autopilot's parameters decide about driving; SI units, radians.

    Parameters
    ----------
    turn_radius, turn_rate, lateral : float
        Tightest turn, greatest rate of turning and lateral acceleration.
    steering_s : float
        Time constant of the steering.
    ahead_gain, ahead_min, ahead_max : float
        Look-ahead of the pure pursuit: seconds, and metres.
    pivot_begin, pivot_end, pivot_rate : float
        Heading errors at which turning on the spot begins and ends, and its rate; a beginning of 0 is never.
    acceptance : float
        Radius of waypoints.
    corner_gain, corner_max : float
        The acceptance radius of a corner is this much of what the tightest turn needs, at most so much; 0 is
        none.
    passes : bool
        Whether a waypoint that was driven past counts.
    yaw_p, yaw_acceleration : float
        Rate of turning over the error of the heading, and its greatest change; 0: the bend is that of pure
        pursuit.
    jerk : float
        Of slowing down; 0 is none.
    corner_slows, corner_least, corner_most : float
        A corner of 180 degrees takes such a share of the greatest speed, down to the least; a negative share:
        the speed is that which the lateral acceleration allows.
    simulated : SihRover, optional
        The vehicle; without one it has the speed that is asked for and turns as it is asked to.
    """

    speed_max: float
    acceleration: float
    deceleration: float
    turn_radius: float
    turn_rate: float
    lateral: float
    steering_s: float
    ahead_gain: float
    ahead_min: float
    ahead_max: float
    pivot_begin: float
    pivot_end: float
    pivot_rate: float
    acceptance: float
    corner_gain: float
    corner_max: float
    passes: bool
    yaw_p: float = 0.0
    yaw_acceleration: float = 0.0
    jerk: float = 0.0
    corner_slows: float = -1.0
    corner_least: float = 0.0
    corner_most: float = 0.0
    simulated: SihRover | None = None


# Limits: the step and the energy that ends the drive, the vehicle's, and those of PX4's simulated rover.
OF_ROVER = [each.name for each in fields(RoverLimits) if each.name != "simulated"]
OF_SIMULATED = [each.name for each in fields(SihRover) if each.name not in ("north", "east")]
ENERGY_LIMIT = 0
LIMITS = record_type(
    ["energy_limit", "step_s", *OF_ROVER, *OF_SIMULATED],
    ["steer_step"],  # Greatest change of the steering in a step, as a share of full steering.
    ["actuator_share"],  # How much of a change of its outputs it takes in a step.
    ["north_1", "north_2", "north_3", "east_1", "east_2", "east_3"],  # Of the axes of the Earth.
)
STATE, LEG = record_type(State, Wheels), record_type(Leg)

STOPPED = 0.05
"""Below it the vehicle counts as standing, m/s."""
