import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission_items import item
from motion_limits import check_steps

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import check_mission
from sim_vehicle.execution.state import Disarmed, ItemReached, LandedState, MissionComplete
from sim_vehicle.motion.legs import Leg, Route
from sim_vehicle.motion.model import MotionEvent
from sim_vehicle.prediction.predict import predict_flight
from sim_vehicle.weather.wind import Wind
from wbf_mission.addons.rovers.motion.layout import STOPPED, Wheels
from wbf_mission.addons.rovers.motion.model import Rover

HOME = LocalFrame(28.05, -82.15)
SKID = {"px4": {"CA_AIRFRAME": 6.0}, "ardupilot": {"SERVO1_FUNCTION": 73.0}}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def rover(autopilot="px4", *, endless=True, **parameters):
    spec = with_autopilot(get_vehicle("rover"), autopilot, parameters)
    return replace(spec, battery=None) if endless else spec


SPECS = {name: rover(name) for name in ("px4", "ardupilot")}
SKIDS = {name: rover(name, **SKID[name]) for name in ("px4", "ardupilot")}


def motion_of(spec, wind=None):
    return Rover(spec, flight_procedures(spec).limits, wind, 0.0)


def drive(spec, rows, limit=200_000, wind=None):
    motion = motion_of(spec, wind)
    motion.fly(Route.through(rows))
    states = [motion.state.copy()]
    while motion.step < limit:
        event = motion.advance(1)
        states.append(motion.state.copy())
        if event is MotionEvent.STALLED or motion.arrivals[-1] >= 0:
            return motion, np.array(states), event
    pytest.fail("never arrived")


def row(x, y, speed=1.5, radius=0.5):
    return Leg((x, y, 0.0), speed, radius_m=radius)


RETURN = MissionItem(20, 2)


@BOTH
def test_turns_keep_the_turning_radius(autopilot):
    spec = SPECS[autopilot]
    motion, states, event = drive(spec, [row(10.0, 0.0), row(0.0, -10.0), row(-10.0, -10.0), row(0.0, 20.0)])
    assert event is MotionEvent.REACHED
    law = motion.law
    moving = states[states[:, Wheels.SPEED] > 0.3]
    radius = moving[:, Wheels.SPEED] / np.maximum(np.abs(moving[:, 10]), 1e-9)
    # The steering lags while the speed changes.
    assert radius.min() >= 0.9 * law.turn_radius
    lateral = moving[:, Wheels.SPEED] * np.abs(moving[:, 10])
    assert lateral.max() <= 1.05 * law.lateral
    change = np.diff(states[:, Wheels.SPEED]) / spec.step_s
    assert change.max() <= law.acceleration + 1e-9
    assert change.min() >= -law.deceleration - 1e-9
    assert np.all(states[:, 2] == 0.0)


@BOTH
def test_a_skid_steered_rover_turns_on_the_spot(autopilot):
    spec = SKIDS[autopilot]
    motion, states, _ = drive(spec, [row(0.0, 20.0), row(20.0, 20.0)])
    pivot = states[states[:, Wheels.PIVOTING] > 0.0]
    standing = pivot[np.abs(pivot[:, 10]) > 0.3]
    assert len(standing)
    assert standing[:, Wheels.SPEED].max() < STOPPED + 1e-9
    assert np.abs(standing[:, 10]).max() <= motion.law.pivot_rate + 1e-9
    # It leaves the corner along the new row.
    second = states[int(motion.arrivals[0]) + 250 :]
    assert np.abs(second[:, 1] - 20.0).max() < 0.6


@BOTH
def test_a_row_is_followed(autopilot):
    _, states, _ = drive(SPECS[autopilot], [row(0.0, 5.0), row(60.0, 5.0)], wind=Wind(0.0, 8.0))
    settled = states[(states[:, 0] > 20.0) & (states[:, 0] < 58.0)]
    assert np.abs(settled[:, 1] - 5.0).max() < 0.05
    assert settled[:-200, Wheels.SPEED] == pytest.approx(1.5, abs=0.05)
    assert states[-1, Wheels.SPEED] < 0.05


@BOTH
def test_heights_mean_nothing_and_take_off_items_are_passed_over(autopilot):
    spec = SPECS[autopilot]
    low = (item(16, 0.0, 20.0), item(16, 20.0, 20.0, -5.0), RETURN)
    high = (item(22, 0.0, 0.0, 30.0), item(16, 0.0, 20.0, 800.0), item(16, 20.0, 20.0, 30.0), RETURN)
    assert check_mission(low, HOME, spec) == check_mission(high, HOME, spec) == []
    point = GeoPoint(28.05, -82.15)
    one, two = (predict_flight(Mission(items, point), spec) for items in (low, high))
    assert one.feasible
    assert two.feasible
    assert one.duration_s == pytest.approx(two.duration_s, abs=0.1)
    assert np.all(two.track_m[:, 2] == 0.0)


@BOTH
def test_a_mission_with_hold_speed_and_return(autopilot):
    spec = SPECS[autopilot]
    items = (
        item(16, 0.0, 30.0, 0.0, 10.0),
        MissionItem(178, 2, 1.0, 0.5, -1.0),
        item(16, 30.0, 30.0),
        item(19, 30.0, 0.0, 0.0, 5.0),
        RETURN,
    )
    executor = MissionExecutor(spec, HOME)
    executor.mission.load(items)
    executor.arm()
    executor.start()
    assert executor.flight.landed is LandedState.IN_AIR
    events, fastest = [], 0.0
    while executor.flight.armed and executor.time_s < 1000.0:
        events += executor.advance(executor.time_s + 0.1)
        if executor.mission.current_seq == 2:
            fastest = max(fastest, executor.state().airspeed_m_s if executor.time_s > 60.0 else 0.0)
    times = {event.seq: event.time_s for event in events if isinstance(event, ItemReached)}
    assert times[0] > 10.0 + 30.0 / 1.5
    assert times[2] - times[1] > 30.0 / 0.5 - 5.0
    assert fastest <= 0.51
    assert any(isinstance(event, MissionComplete) for event in events)
    # Rover stays armed when it is home.
    assert isinstance(events[-1], MissionComplete if autopilot == "ardupilot" else Disarmed)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert math.hypot(*executor.motion.position_m[:2]) < 1.0


PLACE = st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
CLOSE = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@st.composite
def missions(draw):
    items = []
    for place in draw(st.lists(st.one_of(PLACE, CLOSE), min_size=1, max_size=8)):
        kind = draw(st.sampled_from([16, 16, 16, 18, 19, 22]))
        first = {16: draw(st.sampled_from([0.0, 0.0, 3.0])), 18: 1.0, 19: 3.0, 22: 0.0}[kind]
        items.append(item(kind, *place, draw(st.floats(-5.0, 50.0)), first, 0.2, 5.0))
    items.append(draw(st.sampled_from([RETURN, item(21, 1.0, 1.0), item(16, 0.0, 0.0)])))
    return tuple(items)


VEHICLES = st.sampled_from([*SPECS.values(), *SKIDS.values()])


@settings(max_examples=60, deadline=None)
@given(missions(), VEHICLES)
def test_every_mission_ends(items, spec):
    prediction = predict_flight(Mission(items, GeoPoint(28.05, -82.15)), spec)
    assert prediction.feasible, prediction.reason
    assert prediction.duration_s < 3000.0


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(PLACE, st.floats(0.2, 3.0)), min_size=1, max_size=6), VEHICLES, st.integers(2, 300))
def test_the_drive_does_not_depend_on_how_it_is_stepped(legs, spec, chunk):
    rows = [row(*place, speed) for place, speed in legs]
    wind = Wind(2.0, 1.0, gust_m_s=1.0)
    check_steps(lambda: motion_of(spec, wind), rows, chunk, 4000)
