"""Where on the ground a turned camera looks."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from geo.frame import angles_of, quaternion_of
from sensors.camera.leaf_camera import NOWHERE_M, ground_offset

ANGLES = st.floats(-math.pi, math.pi)


@given(ANGLES, st.floats(-1.57, 1.57), ANGLES)
def test_a_quaternion_gives_its_angles_back(roll, pitch, yaw):
    again = angles_of(quaternion_of(roll, pitch, yaw))
    for angle, told in zip((roll, pitch, yaw), again, strict=True):
        assert math.remainder(angle - told, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-5)


@given(ANGLES, st.floats(0.01, 1.5), st.floats(0.1, 500.0), ANGLES)
@example(0.0, math.pi / 4.0, 30.0, math.pi / 2.0)
def test_the_image_lies_ahead_by_height_times_tangent(roll, off_nadir, height, heading):
    offset = ground_offset(quaternion_of(roll, off_nadir - math.pi / 2.0, heading), height)
    reach = height * math.tan(off_nadir)
    assert offset == pytest.approx((reach * math.sin(heading), reach * math.cos(heading)), rel=1e-6, abs=1e-6)


@given(ANGLES, st.floats(0.0, math.pi / 2.0), st.floats(0.0, 500.0), ANGLES)
def test_nothing_of_the_ground_is_seen_from_the_horizon_on(roll, pitch, height, heading):
    quaternion = quaternion_of(roll, pitch + 1e-9, heading)
    assert ground_offset(quaternion, height) == (NOWHERE_M, NOWHERE_M)


@pytest.mark.parametrize("hostile", [(0.0,) * 4, (math.nan,) * 4, (math.inf, 0.0, 0.0, 0.0), (1e38,) * 4])
def test_what_is_no_rotation_means_straight_down(hostile):
    assert ground_offset(hostile, 30.0) == (0.0, 0.0)


def test_straight_down_is_exactly_below_and_far_away_is_not_seen():
    assert ground_offset(quaternion_of(0.0, -math.pi / 2.0, 1.0), 1000.0) == (0.0, 0.0)
    assert ground_offset(quaternion_of(0.0, -0.001, 0.0), 20.0) == (NOWHERE_M, NOWHERE_M)
    assert ground_offset(quaternion_of(0.0, -0.5, 0.0), -0.1) == (0.0, 0.0)
