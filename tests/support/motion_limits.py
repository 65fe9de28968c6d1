"""Whether a multirotor kept within its limits."""

import numpy as np


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
