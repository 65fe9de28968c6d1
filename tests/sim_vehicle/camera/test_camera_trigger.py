"""Shots from telemetry: spacing, times, and telemetry as bad as radios make it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geo import LocalFrame
from sim_vehicle.camera.trigger import CameraTrigger, Fix

FRAME = LocalFrame(28.05, -82.15)


def fix(time_s, path, frame=FRAME, altitude_m=10.0):
    x_m, y_m, east_m_s, north_m_s = path(time_s)
    e7 = [round(degrees * 1e7) for degrees in frame.to_wgs84(x_m, y_m)]
    height_mm = round(altitude_m * 1000)
    velocity = round(north_m_s, 2), round(east_m_s, 2)
    return Fix(round(time_s * 1000), *e7, 30_000 + height_mm, height_mm, *velocity, 9000)


def line(speed_m_s, heading_deg=60.0):
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    return lambda t: (speed_m_s * t * c, speed_m_s * t * s, speed_m_s * c, speed_m_s * s)


def circle(radius_m, speed_m_s):
    w = speed_m_s / radius_m
    return lambda t: (
        radius_m * math.sin(w * t),
        radius_m * (1 - math.cos(w * t)),
        speed_m_s * math.cos(w * t),
        speed_m_s * math.sin(w * t),
    )


def fly(trigger, path, times_s, frame=FRAME):
    return [shot for t in times_s for shot in trigger.add(fix(float(t), path, frame))]


def metres(shots, frame=FRAME):
    e7 = np.array([(shot.latitude_e7, shot.longitude_e7) for shot in shots], float) / 1e7
    return np.column_stack(frame.from_wgs84(e7[:, 0].copy(), e7[:, 1].copy()))


def started(path, distance_m, frame=FRAME):
    trigger = CameraTrigger()
    trigger.add(fix(0.0, path, frame))
    trigger.every_distance(distance_m)
    return trigger


@given(
    st.floats(0.4, 20.0),
    st.floats(0.2, 30.0),
    st.floats(0.0, 360.0),
    st.sampled_from([0.02, 0.1, 0.2, 0.25, 1.0]),
    st.sampled_from([FRAME, LocalFrame(-60.0, 179.9999), LocalFrame(0.0, 0.0)]),
)
@settings(max_examples=60, deadline=None)
def test_shots_of_a_straight_flight(speed, distance, heading, period, frame):
    path = line(speed, heading)
    trigger = started(path, distance, frame)
    duration = 20.0
    shots = fly(trigger, path, np.arange(period, duration, period), frame)
    flown = speed * round((duration - 1e-9) // period) * period
    assert len(shots) == pytest.approx(flown / distance, abs=1.02 + 0.1 / distance + 0.002 * flown / distance)
    if not shots:
        return
    expected = distance * np.arange(1, len(shots) + 1)
    xy = metres(shots, frame)
    along = xy @ [math.cos(math.radians(heading)), math.sin(math.radians(heading))]
    np.testing.assert_allclose(along, expected, atol=0.05 + 0.002 * expected.max())
    assert np.abs(xy @ [-math.sin(math.radians(heading)), math.cos(math.radians(heading))]).max() < 0.02
    times = np.array([shot.time_us for shot in shots]) / 1e6
    np.testing.assert_allclose(times * speed, along, atol=0.06 + 0.01 * speed + (0.1 if speed < 1.0 else 0.0))
    assert (np.diff(times) > 0).all()
    assert all(abs(shot.longitude_e7) <= 1_800_000_000 for shot in shots)


@pytest.mark.parametrize("period", [0.1, 0.25, 0.5, 1.0])
def test_a_turn_is_followed_at_any_telemetry_rate(period):
    path = circle(12.0, 5.0)
    shots = fly(started(path, 0.3048), path, np.arange(period, 30.0 + period / 2, period))
    xy = metres(shots)
    from_centre = np.hypot(xy[:, 0], xy[:, 1] - 12.0)
    assert np.abs(from_centre - 12.0).max() < 0.04
    assert len(shots) == pytest.approx(30.0 * 5.0 / 0.3048, rel=0.005)
    step = np.hypot(*np.diff(xy, axis=0).T)
    assert step == pytest.approx(np.full(len(step), 0.3048), abs=0.04)


def test_velocities_that_do_not_fit_are_not_believed():
    trigger = CameraTrigger()
    trigger.add(fix(0.0, lambda t: (0.0, 0.0, 30.0, 0.0)))
    trigger.every_distance(0.1)
    shots = trigger.add(fix(1.0, lambda t: (1.0, 0.0, -30.0, 0.0)))
    assert len(shots) in (9, 10)
    assert np.abs(metres(shots)[:, 1]).max() < 0.02


def test_hovering_does_not_fire_but_creeping_does():
    rng = np.random.default_rng(2)
    trigger = started(lambda t: (0.0, 0.0, 0.0, 0.0), 0.3)
    shaking = lambda t: (*rng.uniform(-0.03, 0.03, 2), 0.0, 0.0)  # noqa: E731
    assert fly(trigger, shaking, np.arange(0.1, 300.0, 0.1)) == []
    creeping = line(0.05)
    shots = fly(started(creeping, 0.3), creeping, np.arange(0.1, 60.01, 0.1))
    assert len(shots) in (9, 10)


def test_intervals_are_kept_to_the_microsecond():
    path = line(5.0)
    trigger = CameraTrigger()
    trigger.add(fix(2.0, path))
    trigger.every_interval(330_000, 0, start_us=2_000_000)
    shots = fly(trigger, path, np.arange(2.1, 10.05, 0.1))
    assert [shot.time_us for shot in shots] == list(range(2_000_000, 10_000_001, 330_000))
    xy = metres(shots)
    assert np.hypot(*xy.T) == pytest.approx(np.array([shot.time_us for shot in shots]) * 5e-6, abs=0.03)


def test_altitude_goes_along():
    path = line(5.0)
    trigger = CameraTrigger()
    trigger.add(fix(0.0, path, altitude_m=10.0))
    trigger.every_interval(50_000, 0, start_us=50_000)
    shots = trigger.add(fix(0.1, path, altitude_m=11.0))
    assert [shot.altitude_mm for shot in shots] == [40_500, 41_000]
    assert [shot.relative_altitude_mm for shot in shots] == [10_500, 11_000]


def test_nothing_is_fired_in_a_gap():
    path = line(5.0)
    trigger = started(path, 1.0)
    before = fly(trigger, path, np.arange(0.1, 2.01, 0.1))
    after = fly(trigger, path, np.arange(6.0, 8.01, 0.1))
    assert max(shot.time_us for shot in before) <= 2_000_000
    assert min(shot.time_us for shot in after) == pytest.approx(6_200_000, abs=20_000)
    trigger.every_interval(500_000, 0, start_us=8_000_000)
    shots = fly(trigger, path, [8.1, 12.3, 12.4, 12.5, 12.6])
    assert [shot.time_us for shot in shots] == [8_000_000, 12_500_000]


def test_jumps_are_gaps():
    trigger = started(line(5.0), 0.1)
    far = fix(0.1, lambda t: (50_000.0, 0.0, 0.0, 0.0))
    assert trigger.add(far) == []
    over_the_pole = Fix(200, 899_999_999, 0, 0, 0, 0.0, 0.0, 0)
    assert trigger.add(over_the_pole) == []
    assert len(trigger.add(over_the_pole._replace(time_ms=300, latitude_e7=899_999_000))) < 300


def test_a_restarted_autopilot_stops_the_trigger():
    path = line(8.0)
    trigger = started(path, 0.5)
    assert fly(trigger, path, np.arange(0.1, 20.0, 0.1))
    assert fly(trigger, path, np.arange(0.5, 3.0, 0.1)) == []
    assert not trigger.active
    trigger.every_distance(0.5)
    assert fly(trigger, path, np.arange(3.0, 5.0, 0.1))


def test_external_triggers_fire_where_the_vehicle_was():
    path = line(5.0)
    trigger = CameraTrigger()
    trigger.add(fix(1.0, path))
    for time_us in (1_150_000, 1_120_000, 1_010_000):
        trigger.at(time_us)
    shots = fly(trigger, path, [1.1, 1.2])
    assert [shot.time_us for shot in shots] == [1_010_000, 1_120_000, 1_150_000]
    assert np.hypot(*metres(shots).T) == pytest.approx([5.05, 5.6, 5.75], abs=0.02)
    trigger.at(500_000)
    assert [shot.time_us for shot in fly(trigger, path, [1.3])] == [1_200_000]
    for k in range(1000):
        trigger.at(10**9 + k)
    assert len(trigger._external) == 64


FIXES = st.lists(
    st.builds(
        Fix,
        st.integers(0, 2**32 - 1) | st.integers(0, 5000),
        st.integers(-900_000_000, 900_000_000) | st.integers(280_500_000, 280_501_000),
        st.integers(-1_800_000_000, 1_800_000_000) | st.integers(-821_501_000, -821_500_000),
        st.integers(-(2**31), 2**31 - 1),
        st.integers(-(2**31), 2**31 - 1),
        st.floats(-327, 327),
        st.floats(-327, 327),
        st.integers(0, 65535),
    ),
    max_size=30,
)


@given(FIXES, st.sampled_from(["distance", "interval"]), st.integers(0, 2**40))
@settings(max_examples=100, deadline=None)
def test_any_telemetry(fixes, mode, trigger_us):
    trigger = CameraTrigger()
    if mode == "distance":
        trigger.every_distance(0.05)
    else:
        trigger.every_interval(10_000, 0, start_us=0)
    trigger.at(trigger_us)
    for report in fixes:
        shots = trigger.add(report)
        assert len(shots) < 10_000
        assert all(abs(shot.latitude_e7) <= 900_100_000 for shot in shots)
        assert all(abs(shot.longitude_e7) <= 1_800_000_000 for shot in shots)
        assert shots == sorted(shots)
