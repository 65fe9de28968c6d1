import math
import re

import pytest
from mission_items import HOME, RTL, at, do, takeoff, wp

from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import check_mission
from sim_vehicle.execution.state import (
    CameraCommand,
    CannotFly,
    CurrentChanged,
    Disarmed,
    FlightPhase,
    ItemReached,
    Landed,
    LandedState,
    MissionComplete,
    TargetReached,
)
from sim_vehicle.motion.legs import ALONG, Heading, LegKind

QUAD = get_vehicle("quad")
IDEAL = get_vehicle("ideal")


SQUARE = [takeoff(), wp(40, 0), wp(40, 40), wp(0, 40), RTL]


def executor(items=(), spec=QUAD, wind=None):
    vehicle = MissionExecutor(spec, HOME, wind=wind)
    if items:
        vehicle.mission.load(items)
    vehicle.arm()
    return vehicle


def fly(vehicle, limit_s=3000.0, step_s=0.1):
    events, time_s = [], vehicle.time_s
    while vehicle.flight.armed and time_s < limit_s:
        time_s += step_s
        events += vehicle.advance(time_s)
    return events


def mission(items, **options):
    vehicle = executor(items, **options)
    vehicle.start()
    return fly(vehicle), vehicle


def reached(events):
    return [event.seq for event in events if isinstance(event, ItemReached)]


def only(events, kind):
    return [event for event in events if isinstance(event, kind)]


@pytest.mark.parametrize("spec", [QUAD, IDEAL], ids=lambda spec: spec.name)
def test_a_mission_from_the_ground_to_the_ground(spec):
    events, vehicle = mission(SQUARE, spec=spec)
    assert reached(events) == [0, 1, 2, 3, 4]
    assert [event.seq for event in only(events, CurrentChanged)] == [1, 2, 3, 4]
    assert [type(event) for event in events[-4:]] == [Landed, ItemReached, MissionComplete, Disarmed]
    assert [event.time_s for event in events] == sorted(event.time_s for event in events)
    state = vehicle.state()
    assert not state.armed
    assert state.landed is LandedState.ON_GROUND
    assert state.phase is FlightPhase.GROUND
    assert math.hypot(*state.position_m) < 0.1
    assert 175.0 < state.path_length_m < 200.0
    assert state.velocity_m_s == (0.0, 0.0, 0.0)


def test_camera_items_come_when_their_waypoint_is_passed():
    orders = [do(206, 2.0, 0.0, 1.0), do(206, 0.0), do(2000, 0, 1, 0), do(2001)]
    events, _ = mission([takeoff(), wp(20, 0), orders[0], wp(40, 0), *orders[1:], RTL])
    cameras = only(events, CameraCommand)
    told = [(event.seq, event.item.command) for event in cameras]
    assert told == [(2, 206), (4, 206), (5, 2000), (6, 2001)]
    times = {event.seq: event.time_s for event in only(events, ItemReached)}
    assert cameras[0].time_s == times[1]
    assert cameras[1].time_s == times[3]


def test_conditions_delay_the_items_after_them_not_the_flight():
    items = [takeoff(), wp(10, 0), do(112, 4.0), do(206, 3.0), do(114, 20.0), do(2000, 0, 1), wp(100, 0), RTL]
    vehicle = executor(items)
    vehicle.start()
    places = {}
    events = []
    while vehicle.flight.armed:
        for event in vehicle.advance(vehicle.time_s + 0.02):
            events.append(event)
            if isinstance(event, CameraCommand):
                places[event.seq] = vehicle.state().position_m[0]
    times = {event.seq: event.time_s for event in only(events, ItemReached)}
    cameras = {event.seq: event.time_s for event in only(events, CameraCommand)}
    assert cameras[3] == pytest.approx(times[1] + 4.0, abs=0.03)
    assert places[5] == pytest.approx(80.0, abs=0.5)
    assert times[6] - times[1] < 20.0
    vehicle = executor(items)
    vehicle.start()
    assert vehicle.fly_through(1e4) == events


def test_circles():
    items = [takeoff(), at(18, 50, 0, 10, 2.0, 0.0, 10.0), RTL]
    vehicle = executor(items)
    vehicle.start()
    around, last = 0.0, None
    while vehicle.flight.armed and vehicle.mission.current_seq <= 1:
        vehicle.advance(vehicle.time_s + 0.1)
        x, y, _ = vehicle.state().position_m
        distance = math.hypot(x - 50.0, y)
        if distance < 11.5 and vehicle.mission.current_seq == 1:
            assert distance > 8.5
            angle = math.atan2(y, x - 50.0)
            if last is not None:
                around += (angle - last + math.pi) % (2 * math.pi) - math.pi
            last = angle
    assert around == pytest.approx(-4.0 * math.pi, abs=0.6)


def test_direct_targets():
    vehicle = executor()
    vehicle.takeoff(12.0)
    assert vehicle.state().landed is LandedState.TAKEOFF
    events = vehicle.advance(15.0)
    assert [type(event) for event in events] == [TargetReached]
    assert vehicle.flight.phase is FlightPhase.HOLD
    vehicle.goto(30.0, -20.0, 20.0, heading=Heading.fixed(1.0), speed_m_s=4.0)
    assert isinstance(vehicle.advance(50.0)[0], TargetReached)
    state = vehicle.state()
    assert state.position_m == pytest.approx((30.0, -20.0, 20.0), abs=0.02)
    assert state.yaw_rad == pytest.approx(1.0, abs=1e-3)
    vehicle.set_speed(8.0)
    vehicle.return_home()
    assert vehicle.flight.phase is FlightPhase.RETURN
    events = fly(vehicle)
    assert [type(event) for event in events] == [Landed, Disarmed]
    assert math.hypot(*vehicle.state().position_m) < 0.05


def test_a_velocity_is_flown_and_one_downwards_ends_on_the_ground():
    vehicle = executor()
    vehicle.steer((0.0, 0.0, 2.0))
    vehicle.advance(20.0)
    vehicle.steer((3.0, 4.0, 0.0), heading=ALONG)
    assert vehicle.flight.phase is FlightPhase.STEERED
    assert vehicle.advance(60.0) == []
    state = vehicle.state()
    assert state.velocity_m_s == pytest.approx((3.0, 4.0, 0.0), abs=1e-4)
    assert state.yaw_rad == pytest.approx(math.atan2(3, 4), abs=1e-4)
    vehicle.steer((0.0, 0.0, -2.0))
    assert [type(event) for event in vehicle.advance(180.0)] == [Landed, Disarmed]


@pytest.mark.parametrize(
    "order",
    [
        lambda v: v.start(),
        lambda v: v.takeoff(10.0),
        lambda v: v.goto(1.0, 1.0, 10.0),
        lambda v: v.land(),
        lambda v: v.return_home(),
    ],
)
def test_a_disarmed_vehicle_takes_no_orders(order):
    vehicle = MissionExecutor(QUAD, HOME)
    vehicle.mission.load(SQUARE)
    with pytest.raises(VehicleError, match="not armed"):
        order(vehicle)


def test_orders_that_make_no_sense():
    vehicle = executor()
    with pytest.raises(VehicleError, match="none is loaded"):
        vehicle.start()
    for altitude in (0.0, -1.0, math.nan, 1e6):
        with pytest.raises(VehicleError, match="altitude"):
            vehicle.takeoff(altitude)
    for order in (vehicle.land, lambda: vehicle.steer((1.0, 0.0, 0.0))):
        with pytest.raises(VehicleError, match="from the ground"):
            order()
    for speed in (0.0, -1.0, math.nan, 99.0):
        with pytest.raises(VehicleError, match="speed"):
            vehicle.set_speed(speed)
    vehicle.takeoff(5.0)
    vehicle.advance(2.0)
    for x in (math.nan, 1e6, math.inf):
        with pytest.raises(VehicleError, match="from the start"):
            vehicle.goto(x, 0.0, 10.0)
    with pytest.raises(VehicleError, match="in flight"):
        vehicle.disarm()
    vehicle.disarm(force=True)
    assert vehicle.advance(2.5)[0] == Landed(2.0)
    assert vehicle.state().landed is LandedState.ON_GROUND
    with pytest.raises(VehicleError, match="the kind and the time step cannot change"):
        vehicle.update_spec(IDEAL)


def test_a_mission_without_takeoff_ends_at_once_and_disarms():
    events, _ = mission([wp(10, 0), RTL])
    assert [type(event) for event in events] == [CannotFly, Disarmed]
    assert (events[0].seq, "take-off" in events[0].reason) == (0, True)


def test_a_loop_without_a_place_is_refused_in_flight_too():
    items = [takeoff(), do(178, 1, 5), do(177, 1, -1)]
    assert "never lead to a position" in str(check_mission(items, HOME, QUAD)[0])
    vehicle = executor(items)
    vehicle.start()
    events = vehicle.advance(20.0)
    assert "never lead" in only(events, CannotFly)[0].reason


BAD = [
    ([], "empty"),
    ([takeoff(), at(84, 0, 0)], r"item 2 \(command 84\): the vehicle does not know"),
    ([takeoff(), do(4501)], "command 4501"),
    ([takeoff(), MissionItem(16, 4, 0, 0, 0, 0, 28.05, -82.15, 10.0)], "frame 4"),
    ([takeoff(), MissionItem(16, 2, 0, 0, 0, 0, 0, 0, 10.0)], "frame 2"),
    ([takeoff(-5.0)], "altitude -5.0"),
    ([takeoff(), wp(0, 0, 9000.0)], "altitude 9000"),
    ([takeoff(), wp(0, 100_000.0)], "from the start"),
    ([takeoff(), MissionItem.waypoint(0.0, 0.0, 10.0)], "from the start"),
    ([wp(0, 0)], "no take-off"),
    ([do(178, 1, 5)], "no position"),
    ([takeoff(), do(177, 9, 1)], "jumps to item 10"),
    ([takeoff(), do(177, -1, 1)], "jumps to item 0"),
    ([takeoff(), wp(0, 0, hold_s=-1.0)], "time -1"),
    ([takeoff(), wp(0, 0, acceptance_radius_m=-1.0)], "radius -1"),
    ([takeoff(), do(93, -1, 25, 0, 0)], "time of day 25:0:0"),
    ([takeoff(), at(18, 0, 0, 10, 1e6)], "turns"),
    ([takeoff(), at(18, 0, 0, 10, 1.0, 0.0, 0.01)], "radius 0.01"),
    ([takeoff(), do(114, -3.0)], "distance -3"),
]


@pytest.mark.parametrize(("items", "problem"), BAD)
def test_what_cannot_be_flown_is_known_before(items, problem):
    problems = check_mission(items, HOME, QUAD)
    assert problems
    assert re.search(problem, str(problems[0]))


def test_what_can_be_flown_has_no_problems():
    orders = [do(201), do(205), do(1000), do(115, 90.0)]
    items = [takeoff(), do(178, 1, 5), wp(5, 5), *orders, at(31, 5, 5, 20), RTL]
    assert check_mission(items, HOME, QUAD) == []
    events, _ = mission(items)
    assert reached(events) == list(range(9))


@pytest.mark.parametrize(("speed", "brakes"), [(0.1, False), (1.5, True), (8.0, True)])
def test_a_return_begins_with_braking_unless_the_vehicle_stands(speed, brakes):
    vehicle = executor([takeoff(), wp(100, 0), RTL])
    vehicle.start()
    while vehicle.motion.position_m[0] < 2.0:
        vehicle.advance(vehicle.time_s + 0.1)
    vehicle.set_speed(speed)
    vehicle.advance(vehicle.time_s + 8.0)
    here, rest = vehicle.motion.position_m, vehicle.motion.stopping_point()
    distance = math.dist(here[:2], rest[:2])
    assert (distance > 0.25) is brakes
    vehicle.return_home()
    assert (vehicle.flight.plan.legs[0].kind is LegKind.STAY) is brakes
    if speed == 1.5:
        assert distance < 1.8
        top = here[2]
        while math.hypot(*vehicle.state().velocity_m_s[:2]) > 0.3:
            vehicle.advance(vehicle.time_s + 0.1)
            assert vehicle.motion.position_m[2] < top + 0.3, "it climbs when it has come to rest"
