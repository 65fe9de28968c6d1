"""Whether a vehicle kept within its limits, and moves equally however it is stepped."""

import numpy as np

from sim_vehicle.motion.legs import Route
from sim_vehicle.motion.model import MotionEvent


def check_limits(states, spec):
    """Compare the states float64[n, STATE] of each step with what the vehicle can do."""
    velocity, acceleration = states[:, 3:6], states[:, 6:9]
    jerk = np.diff(acceleration, axis=0) / spec.step_s
    slack = 1.0 + 1e-9
    assert np.hypot(*velocity[:, :2].T).max() <= spec.speed_limit_m_s * slack
    assert velocity[:, 2].max() <= spec.climb_speed_m_s * slack
    assert velocity[:, 2].min() >= -spec.descent_speed_m_s * slack
    assert np.hypot(*acceleration[:, :2].T).max() <= spec.acceleration_m_s2 * slack
    assert np.abs(acceleration[:, 2]).max() <= spec.vertical_acceleration_m_s2 * slack
    assert np.hypot(*jerk[:, :2].T).max() <= spec.jerk_m_s3 * (1.0 + 1e-6)
    assert np.abs(jerk[:, 2]).max() <= spec.vertical_jerk_m_s3 * (1.0 + 1e-6)
    assert np.abs(states[:, 10]).max() <= spec.yaw_rate_rad_s * slack
    assert np.abs(np.diff(states[:, 10])).max() <= spec.yaw_acceleration_rad_s2 * spec.step_s * (1.0 + 1e-6)


def check_steps(make, legs, chunk, most):
    """Fly legs in single steps, in chunks and at once, `most` steps long; the ends must be equal."""

    def end(steps, stop_each):
        motion, event = make(), MotionEvent.RAN
        motion.fly(Route.through(legs))
        while motion.step < most and event is not MotionEvent.STALLED:
            event = motion.advance(min(steps, most - motion.step), stop_each=stop_each)
        return motion.state.tobytes(), motion.counters.tobytes(), motion.arrivals.tobytes()

    one = end(1, True)
    assert end(chunk, True) == one
    assert end(most, False) == one
