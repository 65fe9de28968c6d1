"""Columns of a ground vehicle's state and legs, and the limits set by parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum

from sim_vehicle.motion.columns import State, record_type

# State beyond the columns shared by all vehicles.
Wheels = IntEnum(
    "Wheels",
    "SPEED "  # Forward speed.
    "THROTTLE "  # 0 to 1.
    "PIVOTING "  # Whether the vehicle turns on the spot.
    "BEGIN_X BEGIN_Y "  # Start of the leg.
    "PAUSE_END "  # Step at which a pause ends; infinity if none is running.
    "YAW_ASKED RATE_ASKED SPEED_ASKED "
    "SPEED_INTEGRAL "  # Integral of the speed error.
    # Columns of PX4's simulated rover.
    "SIDEWAYS "  # Speed to the right.
    "RATE_INTEGRAL STEER_ASKED "
    "STEER PUSH",  # Steering and throttle after the simulator's lag.
    start=len(State),
)
# Columns of a leg.
Leg = IntEnum(
    "Leg",
    "X Y KIND "
    "RADIUS "  # Acceptance radius.
    "SPEED "
    "NEAR "  # Distance at which arrival is notified.
    "END_SPEED "  # Speed at the end.
    "PAUSE "
    "HEADING "  # Heading to keep.
    "Z",  # The ground: 0.
    start=0,
)
THROUGH, STOP, AT_ONCE, VELOCITY, BRAKE = 0.0, 1.0, 2.0, 3.0, 4.0


@dataclass(frozen=True, slots=True)
class RoverLimits:
    """Driving limits set by an autopilot's parameters; SI units, radians."""

    speed_max: float
    acceleration: float
    deceleration: float
    # Minimum turn radius, maximum turn rate and lateral acceleration.
    turn_radius: float
    turn_rate: float
    lateral: float
    steering_s: float
    """Time constant of the steering."""
    # Look-ahead of pure pursuit: gain in seconds, limits in metres.
    ahead_gain: float
    ahead_min: float
    ahead_max: float
    # Heading errors at which a turn on the spot starts (0: never) and ends; turn rate on the spot.
    pivot_begin: float
    pivot_end: float
    pivot_rate: float
    acceptance: float
    """Acceptance radius of waypoints."""
    # Corner radius = gain x tightest-turn radius, capped at corner_max; 0 disables it.
    corner_gain: float
    corner_max: float
    passes: bool
    """Whether a waypoint counts as reached when passed."""
    # Turn rate per heading error (0: curvature by pure pursuit), and maximum change of the turn rate.
    yaw_p: float = 0.0
    yaw_acceleration: float = 0.0
    jerk: float = 0.0
    """Maximum jerk of braking; 0 means no limit."""
    # Fraction of the maximum speed lost in a corner of 180 degrees, and speed limits in corners. If the
    # fraction is negative, the lateral acceleration sets the speed.
    corner_slows: float = -1.0
    corner_least: float = 0.0
    corner_most: float = 0.0
    simulated: Mapping[str, float] = field(default_factory=dict)
    """Values of PX4's simulated rover, by column of `Simulated`; empty for a rover without forces."""


# PX4's simulated rover, and its steering and speed controllers.
Simulated = IntEnum(
    "Simulated",
    "THROTTLE_SPEED SPEED_P SPEED_I "  # Controller of the speed by the throttle: m/s and s/m.
    "WHEEL_BASE STEER_MAX "  # Wheel base in metres; maximum wheel angle.
    "STEER_STEP "  # Maximum change of steering per step, as a fraction of full steering.
    # Gains of the wheel angle over turn rate: feed-forward, s; proportional, s; integral, 1.
    "RATE_FF RATE_P RATE_I "
    "FORCE FRICTION "  # Per mass: force of full throttle, and rolling friction, m/s^2.
    # Cornering stiffness per mass and per moment of inertia; yaw damping per moment of inertia.
    "GRIP TURN_GRIP TURN_DAMPING "
    "ACTUATOR_SHARE "  # Fraction of an output's change that the actuator follows per step.
    "DRAG "  # Drag per mass and squared speed along each axis of the Earth, 1/m.
    "NORTH_1 NORTH_2 NORTH_3 EAST_1 EAST_2 EAST_3",  # The vectors north and east, in the axes of the Earth.
    start=0,
)
# Columns: energy at which the drive ends, time step, limits, and values of PX4's simulated rover.
OF_ROVER = [each.name for each in fields(RoverLimits) if each.name != "simulated"]
LIMITS = record_type(["energy_limit", "step_s", *OF_ROVER], Simulated)
STATE, LEG = record_type(State, Wheels), record_type(Leg)

STOPPED = 0.05
"""Speed below which the vehicle counts as standing (m/s)."""
