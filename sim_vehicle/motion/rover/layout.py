"""What stands where in the arrays of a ground vehicle.

State and counters begin as those of `sim_vehicle.motion.multirotor.kernel`.
"""

from __future__ import annotations

# The state beyond the shared numbers: speed ahead, throttle (0 to 1), whether it turns on the spot,
# beginning of the leg (two numbers), step at which a pause ends (infinity: none runs), heading and rate of
# turning that are asked for, speed that is asked for and the integrator of its error. Of PX4's simulated
# rover also the speed to the right, the integrator of the rate of turning, the steering that is asked for
# and what the simulator has made of that and of the throttle.
SPEED, THROTTLE, PIVOTING, BEGIN, PAUSE_END = 19, 20, 21, 22, 24
YAW_ASKED, RATE_ASKED, SPEED_ASKED, SPEED_INTEGRAL = 25, 26, 27, 28
SIDEWAYS, RATE_INTEGRAL, STEER_ASKED, STEER, PUSH = 29, 30, 31, 32, 33
STATE = 34

# One leg.
(
    LEG_X,
    LEG_Y,
    LEG_KIND,
    LEG_RADIUS,  # Acceptance radius.
    LEG_SPEED,
    LEG_NEAR,  # Distance to notify at.
    LEG_END_SPEED,  # Speed at its end.
    LEG_PAUSE,
    LEG_HEADING,  # Heading to keep.
) = range(9)
LEG = 9
THROUGH, STOP, AT_ONCE, VELOCITY, BRAKE = 0.0, 1.0, 2.0, 3.0, 4.0

# limits
(
    STEP_S,
    SPEED_MAX,
    ACCELERATION,
    DECELERATION,
    TURN_RADIUS,
    TURN_RATE,
    LATERAL,
    STEERING_S,
    AHEAD_GAIN,
    AHEAD_MIN,
    AHEAD_MAX,
    PIVOT_BEGIN,
    PIVOT_END,
    PIVOT_RATE,
    PASSES,
    ENERGY_LIMIT,
    YAW_P,  # Rate of turning over the error of the heading; 0: pure pursuit gives the bend itself.
    YAW_ACCELERATION,
    JERK,  # 0: speeds before a corner or a stop are those of the deceleration alone.
    THROTTLE_SPEED,  # What full throttle is thought to give.
    SPEED_P,
    SPEED_I,
    WHEEL_BASE,
    STEER_MAX,
    STEER_STEP,  # Greatest change of the steering in a step, as a share of full steering.
    RATE_FF,
    RATE_P,
    RATE_I,
    FORCE,  # Per mass, of full throttle; 0: the vehicle has the speed that is asked for.
    FRICTION,  # Per mass.
    GRIP,  # Cornering stiffness over mass.
    TURN_GRIP,  # Cornering stiffness over the moment of inertia.
    TURN_DAMPING,  # Over the moment of inertia.
    ACTUATOR_SHARE,  # How much of a change of its outputs it takes in a step.
    DRAG,  # Per mass, over the square of the speed along each axis of the Earth.
    NORTH,  # Of the axes of the Earth, three numbers each.
) = range(36)
EAST = NORTH + 3
LIMITS = EAST + 3

STOPPED = 0.05
"""Below it the vehicle counts as standing, m/s."""
