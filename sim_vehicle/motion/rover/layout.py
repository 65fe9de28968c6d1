"""Columns of a ground vehicle's state, of its legs and of its limits."""

from __future__ import annotations

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

Limits = IntEnum(
    "Limits",
    "STEP_S SPEED_MAX ACCELERATION DECELERATION TURN_RADIUS TURN_RATE LATERAL STEERING_S AHEAD_GAIN "
    "AHEAD_MIN AHEAD_MAX PIVOT_BEGIN PIVOT_END PIVOT_RATE PASSES ENERGY_LIMIT "
    "YAW_P "  # Rate of turning over the error of the heading; 0: pure pursuit gives the bend itself.
    "YAW_ACCELERATION "
    "JERK "  # 0: speeds before a corner or a stop are those of the deceleration alone.
    "THROTTLE_SPEED "  # What full throttle is thought to give.
    "SPEED_P SPEED_I WHEEL_BASE STEER_MAX "
    "STEER_STEP "  # Greatest change of the steering in a step, as a share of full steering.
    "RATE_FF RATE_P RATE_I "
    "FORCE "  # Per mass, of full throttle; 0: the vehicle has the speed that is asked for.
    "FRICTION "  # Per mass.
    "GRIP "  # Cornering stiffness over mass.
    "TURN_GRIP "  # Cornering stiffness over the moment of inertia.
    "TURN_DAMPING "  # Over the moment of inertia.
    "ACTUATOR_SHARE "  # How much of a change of its outputs it takes in a step.
    "DRAG "  # Per mass, over the square of the speed along each axis of the Earth.
    "NORTH_1 NORTH_2 NORTH_3 EAST_1 EAST_2 EAST_3",  # Of the axes of the Earth.
    start=0,
)
STATE, LEG, LIMITS = record_type(State, Wheels), record_type(Leg), record_type(Limits)

STOPPED = 0.05
"""Below it the vehicle counts as standing, m/s."""
