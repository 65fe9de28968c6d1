"""The gimbal without MAVLink: limits, rates, frames."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicle.autopilot.parameters import Setting
from wbf_mission.addons.gimbal.extra import RATE_RAD_S, Gimbal, GimbalMode

NADIR = (0.0, -math.pi / 2.0, 0.0)
ANYTHING = st.floats(-50.0, 50.0)


def gimbal_with(**values):
    parameters = SimpleNamespace(kept=lambda name, default: values.get(name, default))
    return Gimbal(parameters, Setting("MNT1_TYPE", 1.0))


def state(time_s, yaw_rad=0.0, position_m=(0.0, 0.0, 30.0)):
    return SimpleNamespace(time_s=time_s, yaw_rad=yaw_rad, position_m=position_m)


def advance(gimbal, seconds, start_s=0.0, yaw_rad=0.0, position_m=(0.0, 0.0, 30.0)):
    for step in range(1, round(20 * seconds) + 1):
        now_s = start_s + step / 20.0
        gimbal.advance(state(now_s, yaw_rad, position_m), 1e6 * now_s, (0.0, 0.0, 0.0))
    return start_s + seconds


def degrees(gimbal):
    return [round(math.degrees(angle), 3) for angle in gimbal.angles_rad]


@given(
    st.tuples(ANYTHING, ANYTHING, ANYTHING),
    st.booleans(),
    st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(-7.0, 7.0)), min_size=1, max_size=8),
)
def test_no_axis_leaves_its_limits_or_outruns_its_rate(angles, earth, steps):
    gimbal = gimbal_with()
    gimbal.turn_to(angles, earth=earth)
    now_s = 0.0
    for passed_s, yaw in steps:
        before, now_s = gimbal.angles_rad, now_s + passed_s
        gimbal.advance(state(now_s, yaw % (2.0 * math.pi)), 1e6 * now_s, (0.0, 0.0, 0.0))
        for old, new, (low, high) in zip(before, gimbal.angles_rad, gimbal.limits_rad, strict=True):
            assert low - 1e-9 <= new <= high + 1e-9
            assert abs(new - old) <= RATE_RAD_S * passed_s + 1e-9


@given(st.floats(-1.5, 0.3), st.floats(-3.1, 3.1), st.integers(1, 40))
def test_where_it_turns_to_does_not_depend_on_how_often_it_is_looked_at(pitch, yaw, looks):
    ends = []
    for number in (1, looks):
        gimbal = gimbal_with()
        gimbal.turn_to((0.0, pitch, yaw), earth=False)
        for step in range(1, number + 1):
            gimbal.advance(state(0.8 * step / number), 1e6 * step, (0.0, 0.0, 0.0))
        ends.append(gimbal.angles_rad)
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_a_locked_yaw_stays_and_a_following_one_turns_with_the_vehicle():
    for earth, expected in ((True, 20.0 - 90.0), (False, 20.0)):
        gimbal = gimbal_with()
        gimbal.turn_to((0.0, math.radians(-30.0), math.radians(20.0)), earth=earth)
        now_s = advance(gimbal, 3.0)
        advance(gimbal, 3.0, now_s, yaw_rad=math.radians(90.0))
        assert degrees(gimbal) == [0.0, -30.0, expected]
        assert gimbal.locks_yaw is earth
    assert math.degrees(gimbal.attitude_at(6e6).heading_rad) == pytest.approx(110.0)


def test_angles_beyond_the_limits_end_there_as_arducopters_do():
    gimbal = gimbal_with(MNT1_PITCH_MAX=45.0)
    for yaw, reached in ((200.0, -160.0), (-190.0, -180.0)):
        gimbal.turn_to((0.0, math.radians(-120.0), math.radians(yaw)), earth=False)
        advance(gimbal, 8.0, gimbal._time_s)
        assert degrees(gimbal) == [0.0, -90.0, reached]


def test_rates_turn_until_a_limit():
    gimbal = gimbal_with()
    gimbal.turn_at((0.0, math.radians(10.0), math.radians(5.0)), earth=False)
    now_s = advance(gimbal, 2.0)
    assert degrees(gimbal) == [0.0, -70.0, 10.0]
    now_s = advance(gimbal, 20.0, now_s)
    assert degrees(gimbal)[1] == 20.0
    gimbal.turn_at((0.0, 0.0, 0.0), earth=True)
    now_s = advance(gimbal, 0.1, now_s)
    yaw = degrees(gimbal)[2]
    advance(gimbal, 3.0, now_s, yaw_rad=math.radians(40.0))
    assert degrees(gimbal)[2] == pytest.approx(yaw - 40.0, abs=0.01)


def test_it_keeps_pointing_at_a_position_as_the_vehicle_moves():
    gimbal = gimbal_with()
    gimbal.point_at((30.0, 0.0, 0.0))
    now_s = advance(gimbal, 4.0)
    assert degrees(gimbal) == [0.0, -45.0, 90.0]
    now_s = advance(gimbal, 4.0, now_s, position_m=(30.0, -30.0, 30.0), yaw_rad=math.radians(350.0))
    assert degrees(gimbal) == [0.0, -45.0, 10.0]
    gimbal.point_at(None)
    assert gimbal.mode is GimbalMode.NEUTRAL
    advance(gimbal, 4.0, now_s)
    assert gimbal.angles_rad == NADIR


def test_modes_have_their_attitudes_and_unknown_ones_are_refused():
    gimbal = gimbal_with(MNT1_RETRACT_Y=10.0)
    now_s = 0.0
    for mode, pitch in ((0, 10.0), (1, -90.0), (3, -35.0)):
        assert gimbal.set_mode(mode)
        now_s = advance(gimbal, 4.0, now_s)
        assert degrees(gimbal) == [0.0, pitch, 0.0]
    gimbal.set_mode(6)
    advance(gimbal, 4.0, now_s, position_m=(0.0, -10.0, 10.0))
    assert degrees(gimbal) == [0.0, -45.0, 0.0]
    assert not any(map(gimbal.set_mode, (5, 7, -1, 77)))


def test_the_past_is_told_between_its_moments():
    gimbal = gimbal_with()
    advance(gimbal, 1.0)
    gimbal.turn_to((0.0, 0.0, 0.0), earth=False)
    gimbal.advance(state(1.5), 1.5e6, (0.0, 0.0, 0.0))
    gimbal.advance(state(2.0), 2.0e6, (0.0, 0.0, 0.0))
    assert math.degrees(gimbal.attitude_at(1.75e6).pitch_rad) == pytest.approx(-45.0)
    assert math.degrees(gimbal.attitude_at(9e6).pitch_rad) == pytest.approx(-30.0)
    assert gimbal.attitude_at(1.2e6) is None
