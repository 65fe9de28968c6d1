"""Mission items flown: times of day, speeds up and down, regions of interest, yaw, splines, home, pauses."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mission_items import HOME, RTL, at, do, takeoff, wp
from short_flights import started

from geo.frame import LocalFrame
from mission.model import Mission
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import item_positions
from sim_vehicle.execution.state import (
    Disarmed,
    FlightPhase,
    HomeMoved,
    ItemReached,
    LandedState,
    MissionComplete,
)
from sim_vehicle.prediction.predict import predict_flight

QUAD = get_vehicle("quad")


def begun(items, spec, prepare):
    vehicle = MissionExecutor(spec, HOME)
    vehicle.mission.load(items)
    if prepare:
        prepare(vehicle)
    vehicle.arm()
    vehicle.start()
    return vehicle


def flown(items, spec=QUAD, step_s=0.1, limit_s=1500.0, prepare=None):
    """Fly a mission; return events and the states on the way."""
    vehicle, through = begun(items, spec, prepare), begun(items, spec, prepare)
    events, states = [], []
    while vehicle.flight.armed and vehicle.time_s < limit_s:
        events += vehicle.advance(vehicle.time_s + step_s)
        states.append(vehicle.state())
    if not vehicle.flight.armed:
        assert through.fly_through(limit_s) == events
    return events, states


def times(events):
    return {event.seq: event.time_s for event in events if isinstance(event, ItemReached)}


def on_item(states, seq):
    return [s for s in states if s.current_seq == seq and s.landed is LandedState.IN_AIR]


def test_a_delay_ends_at_its_time_of_day():
    items = [takeoff(), wp(20, 0), do(93, -1, 12, 1, 30), wp(40, 0), RTL]
    events, _ = flown(items)
    assert times(events)[2] == pytest.approx(90.0, abs=0.05)
    events, _ = flown(items, prepare=lambda v: setattr(v.mission, "epoch_unix_s", 1_780_315_140.0))
    assert times(events)[2] == pytest.approx(150.0, abs=0.05)
    early = predict_flight(Mission(tuple(items)), QUAD, frame=HOME, epoch_unix_s=1_780_315_140.0)
    assert early.duration_s == pytest.approx(150.0 + 28.0, abs=8.0)
    events, _ = flown([takeoff(), do(93, -1, -1, -1, 45), RTL])
    assert times(events)[1] == pytest.approx(45.0, abs=0.05)
    events, _ = flown([do(93, -1, -1, 1, -1), takeoff(), RTL])
    assert times(events)[0] == pytest.approx(60.0, abs=0.05)
    events, _ = flown([takeoff(), do(93, -1, -1, -1, -1), RTL])
    assert times(events)[1] < times(events)[0] + 5.0


def test_vertical_speeds_of_items():
    up, down, own = do(178, 2, 1.0), do(178, 3, 0.5), do(178, 2, -2)
    items = [takeoff(), up, wp(0, 5, 30), down, wp(0, 0, 20), own, wp(0, 5, 40), RTL]
    events, states = flown(items)
    climbing = [s.velocity_m_s[2] for s in on_item(states, 2)]
    assert max(climbing[-30:]) <= 1.0 + 1e-6
    assert sorted(climbing)[len(climbing) // 2] > 0.7
    assert min(s.velocity_m_s[2] for s in on_item(states, 4)) >= -0.5 - 1e-6
    assert max(s.velocity_m_s[2] for s in on_item(states, 6)) > 2.5
    assert isinstance(events[-1], Disarmed)


def test_the_speed_goes_back_to_the_vehicles_own():
    slow, own, kept = do(178, 0, 3.0), do(178, 1, -2), do(178, 1, -1)
    items = [takeoff(), slow, wp(80, 0), own, wp(200, 0), kept, wp(300, 0), RTL]
    _, states = flown(items)
    fastest = {seq: max(s.velocity_m_s[0] for s in on_item(states, seq)) for seq in (2, 4, 6)}
    assert fastest[2] == pytest.approx(3.0, abs=0.01)
    assert (fastest[4], fastest[6]) == pytest.approx((QUAD.cruise_speed_m_s,) * 2, abs=0.01)


def test_the_nose_follows_the_region_of_interest():
    items = [takeoff(), wp(0, 20), at(195, 50, 60, 0), wp(100, 20), do(197), wp(100, 90), RTL]
    _, states = flown(items)
    for state in on_item(states, 3)[40:-5]:
        x, y, _ = state.position_m
        error = math.remainder(state.yaw_rad - math.atan2(50 - x, 60 - y), 2 * math.pi)
        assert abs(error) < 0.3
    assert math.remainder(on_item(states, 5)[-1].yaw_rad, 2 * math.pi) == pytest.approx(0.0, abs=0.05)


def test_yaw_holds_to_the_next_place():
    items = [takeoff(), do(115, 90, 0, 1, 0), wp(0, 60), wp(0, 120), do(115, 45, 0, -1, 1), wp(0, 200), RTL]
    _, states = flown(items)
    assert on_item(states, 2)[-1].yaw_rad == pytest.approx(math.pi / 2, abs=1e-3)
    assert math.remainder(on_item(states, 3)[-1].yaw_rad, 2 * math.pi) == pytest.approx(0.0, abs=1e-3)
    assert math.remainder(on_item(states, 5)[-1].yaw_rad, 2 * math.pi) == pytest.approx(
        -math.pi / 4, abs=0.02
    )


def test_a_spline_is_smooth_and_passes_its_places():
    items = [takeoff(), wp(40, 0), at(82, 80, 30), at(82, 120, -30), wp(160, 0), RTL]
    events, states = flown(items, step_s=0.02)
    assert {0, 1, 2, 3, 4, 5} <= set(times(events))
    for seq, (x, y) in ((2, (80, 30)), (3, (120, -30))):
        near = min(math.hypot(s.position_m[0] - x, s.position_m[1] - y) for s in states)
        assert near < QUAD.acceptance_radius_m
        speed = min(math.hypot(*s.velocity_m_s[:2]) for s in on_item(states, seq)[50:])
        assert speed > 1.2, "it does not stop on the way"
    tracks = [math.atan2(*s.velocity_m_s[:2]) for s in on_item(states, 2) + on_item(states, 3)]
    turns = [abs(math.remainder(b - a, 2 * math.pi)) for a, b in pairwise(tracks)]
    assert max(turns) < math.radians(4.0)
    held, _ = flown([takeoff(), wp(40, 0), at(82, 80, 30, 10, 5.0), wp(120, 0), RTL])
    assert times(held)[2] > times(events)[2] + 2.0


def test_home_moves_and_is_returned_to():
    items = [takeoff(), wp(60, 0), at(179, 90, 20, 0), wp(60, 60), RTL]
    events, states = flown(items)
    (moved,) = (event for event in events if isinstance(event, HomeMoved))
    assert (moved.x_m, moved.y_m) == pytest.approx((90, 20), abs=0.02)
    assert states[-1].position_m[:2] == pytest.approx((90, 20), abs=0.1)
    events, states = flown([takeoff(), wp(60, 0, hold_s=1), do(179, 1), wp(0, 60), RTL])
    assert states[-1].position_m[:2] == pytest.approx((60, 0), abs=0.5)


def test_terrain_is_as_high_as_the_start_whatever_home_is():
    above_terrain = replace(wp(60, 60, 20.0), frame=10)
    for home in (at(179, 0, 0, 0.0), at(179, 0, 0, 5.0)):
        _, states = flown([takeoff(), home, above_terrain, RTL])
        assert max(state.position_m[2] for state in states) == pytest.approx(20.0, abs=0.2)
    frame = LocalFrame(HOME.latitude_deg, HOME.longitude_deg)
    heights = [height for _, _, height in item_positions([above_terrain, wp(60, 60, 20.0)], frame, 5.0)]
    assert heights == [20.0, 25.0], "above the terrain at the start, above a home that is 5 m higher"


def test_a_prediction_is_the_flight_with_all_of_it():
    items = [
        takeoff(),
        do(178, 2, 1.5),
        wp(20, 0, 25),
        at(195, 60, 60, 0),
        at(82, 60, 10),
        at(82, 90, -10),
        do(115, 30, 0, 1, 1),
        do(197),
        wp(120, 0),
        do(93, -1, 12, 3, 0),
        at(18, 100, 40, 10, 1.0, 0.0, -8.0),
        do(177, 10, 1),
        RTL,
    ]
    events, states = flown(items)
    forecast = predict_flight(Mission(tuple(items)), QUAD, frame=HOME)
    (complete,) = (event for event in events if isinstance(event, MissionComplete))
    assert forecast.feasible
    assert forecast.duration_s == pytest.approx(complete.time_s, abs=1e-6)
    assert forecast.path_length_m == pytest.approx(states[-1].path_length_m, rel=1e-9)


SQUARE = [
    takeoff(),
    wp(40, 0, hold_s=3.0),
    do(93, 4.0, -1, -1, -1),
    at(19, 40, 40, 12, 5.0),
    at(18, 0, 40, 10, 1.0, 0.0, 8.0),
    RTL,
]


@settings(max_examples=25, deadline=None)
@given(st.floats(0.1, 110.0), st.sampled_from(["resume", "jump", "start"]), st.integers(0, 5))
def test_a_pause_at_any_moment_loses_nothing(when_s, how, seq):
    vehicle = started(SQUARE, QUAD, HOME)
    events = vehicle.advance(when_s)
    if not vehicle.flight.armed or vehicle.flight.landed is LandedState.ON_GROUND:
        return
    if how != "jump":
        vehicle.flight.hold()
        assert vehicle.flight.phase is FlightPhase.HOLD
        events += vehicle.advance(when_s + 12.0)
        assert math.hypot(*vehicle.state().velocity_m_s) < 0.1
        assert vehicle.flight.landed in (LandedState.IN_AIR, LandedState.TAKEOFF)
    if how != "resume":
        vehicle.mission.set_current(seq)
    current = vehicle.mission.current_seq
    if how != "jump":
        vehicle.start()
    if vehicle.flight.phase is FlightPhase.MISSION:
        events = vehicle.advance(2000.0)
        assert [e.seq for e in events if isinstance(e, ItemReached)] == list(range(current, 6))
        assert isinstance(events[-1], Disarmed)


@settings(max_examples=20, deadline=None)
@given(st.floats(1.0, 60.0), st.integers(0, 3))
@example(6.6, 3)
@example(34.7, 3)
@example(35.0, 3)
@example(35.2, 3)
def test_a_mission_changed_in_flight_goes_on(when_s, current):
    vehicle = started(SQUARE, QUAD, HOME)
    vehicle.advance(when_s)
    vehicle.mission.load([takeoff(), wp(10, 0), wp(10, 10), RTL], current=current)
    assert vehicle.mission.current_seq == current
    vehicle.start()
    events = vehicle.advance(1000.0)
    assert [e.seq for e in events if isinstance(e, ItemReached)] == list(range(current, 4))


@pytest.mark.parametrize("current", [1, 2])
def test_a_mission_changed_in_the_take_off_goes_on_at_its_item(current):
    vehicle = started(SQUARE, QUAD, HOME)
    vehicle.advance(1.0)
    assert vehicle.flight.landed is LandedState.TAKEOFF
    assert not vehicle.mission.change([takeoff(), wp(10, 0), wp(10, 10), RTL], current)
    reached = [e.seq for e in vehicle.advance(1000.0) if isinstance(e, ItemReached)]
    assert reached == [0, *range(current, 4)]
