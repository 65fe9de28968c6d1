import math
import re
from dataclasses import replace

import pytest
from mission_items import HOME, RTL, at, do, takeoff, wp

from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import check_mission
from sim_vehicle.execution.state import (
    BatteryDepleted,
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
from sim_vehicle.motion.legs import Heading, LegKind
from sim_vehicle.weather.wind import Wind

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


def test_advance_keeps_to_the_time():
    vehicle = executor(SQUARE)
    vehicle.start()
    for until in (0.0, 0.013, 0.5, 0.519, 7.0):
        vehicle.advance(until)
        assert until - 0.02 < vehicle.time_s <= until + 1e-9
    assert vehicle.advance(3.0) == []
    assert vehicle.time_s == pytest.approx(7.0)


def test_holds_and_delays_take_their_time():
    items = [
        takeoff(),
        wp(30, 0, hold_s=5.0),
        do(93, 3.0, -1, -1, -1),
        at(19, 0, 30, 10, 4.0),
        wp(0, 0),
        do(21),
    ]
    items[-1] = MissionItem(21, 3, 0, 0, 0, None, 0.0, 0.0, 0.0)
    vehicle = executor(items)
    vehicle.start()
    times, pauses = {}, 0.0
    while vehicle.flight.armed:
        for event in vehicle.advance(vehicle.time_s + 0.02):
            if isinstance(event, ItemReached):
                times[event.seq] = event.time_s
        state = vehicle.state()
        if state.landed is LandedState.IN_AIR and math.hypot(*state.velocity_m_s) < 0.05:
            pauses += 0.02
    assert list(times) == [0, 1, 2, 3, 4, 5]
    assert times[2] - times[1] == pytest.approx(3.0, abs=0.5)
    assert pauses == pytest.approx(12.0, abs=3.0)
    x, y, _ = vehicle.state().position_m
    assert math.hypot(x, y) < 0.5


def test_camera_items_come_when_their_waypoint_is_passed():
    items = [
        takeoff(),
        wp(20, 0),
        do(206, 2.0, 0.0, 1.0),
        wp(40, 0),
        do(206, 0.0),
        do(2000, 0, 1, 0),
        do(2001),
        RTL,
    ]
    events, _ = mission(items)
    cameras = only(events, CameraCommand)
    assert [(event.seq, event.item.command) for event in cameras] == [
        (2, 206),
        (4, 206),
        (5, 2000),
        (6, 2001),
    ]
    times = {event.seq: event.time_s for event in only(events, ItemReached)}
    assert cameras[0].time_s == times[1]
    assert cameras[1].time_s == times[3]


def test_speed_changes_hold_until_the_next():
    def top_speed(items):
        vehicle = executor(items)
        vehicle.start()
        speeds = {}
        while vehicle.flight.armed:
            vehicle.advance(vehicle.time_s + 0.1)
            state = vehicle.state()
            speed = math.hypot(*state.velocity_m_s[:2])
            speeds[state.current_seq] = max(speed, speeds.get(state.current_seq, 0.0))
        return speeds

    speeds = top_speed(
        [takeoff(), do(178, 1, 3.0), wp(60, 0), do(178, 1, 99.0), wp(300, 0), do(178, 1, 2.0), wp(300, 9)]
    )
    assert speeds[2] == pytest.approx(3.0, abs=1e-3)
    assert speeds[4] == pytest.approx(QUAD.top_speed_m_s, abs=1e-3)
    assert speeds[6] < 3.0


def test_jumps_are_taken_as_often_as_they_say():
    events, _ = mission([takeoff(), wp(10, 0), wp(10, 10), do(177, 1, 2), RTL])
    assert reached(events) == [0, 1, 2, 3, 1, 2, 3, 1, 2, 3, 4]


def test_a_jump_for_ever_ends_with_the_battery():
    small = replace(QUAD, battery=replace(QUAD.battery, capacity_wh=3.0))
    events, vehicle = mission([takeoff(), wp(10, 0), wp(10, 10), do(177, 1, -1), RTL], spec=small)
    assert len(only(events, BatteryDepleted)) == 1
    assert [type(event) for event in events[-2:]] == [Landed, Disarmed]
    assert not only(events, MissionComplete)
    assert vehicle.state().battery.depleted
    assert vehicle.state().position_m[2] == 0.0
    with pytest.raises(VehicleError, match="battery is empty"):
        vehicle.arm()


def test_a_very_long_loop_is_planned_in_pieces():
    items = [takeoff(), do(178, 1, 8), wp(0, 3), wp(3, 3), wp(3, 0), wp(0, 0), do(177, 2, 1500), RTL]
    items = [replace(item, param2=0.5) if item.command == 16 else item for item in items]
    endless = replace(QUAD, battery=replace(QUAD.battery, capacity_wh=1e6))
    vehicle = executor(items, spec=endless)
    vehicle.start()
    events = vehicle.fly_through(1e6)
    assert reached(events).count(2) == 1501
    assert isinstance(events[-1], Disarmed)


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


def test_a_condition_that_is_never_met_holds_nothing_back():
    items = [takeoff(), wp(10, 0), do(112, 1000.0), do(206, 3.0), wp(30, 0), RTL]
    events, _ = mission(items)
    times = {event.seq: event.time_s for event in only(events, ItemReached)}
    assert only(events, CameraCommand)[0].time_s == times[4]


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


def test_absolute_altitudes_count_from_the_ground_at_home():
    items = [takeoff(), MissionItem(16, 0, 0, 0, 0, None, *HOME.to_wgs84(20.0, 0.0), 55.0), wp(20, 20, 25.0)]
    vehicle = executor(items)
    vehicle.start()
    vehicle.advance(60.0)
    assert vehicle.state().position_m == pytest.approx((20.0, 20.0, 25.0), abs=0.02)
    assert vehicle.flight.phase is FlightPhase.HOLD


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


def test_returning_climbs_first():
    vehicle = executor()
    vehicle.takeoff(5.0)
    vehicle.advance(10.0)
    vehicle.goto(80.0, 0.0, 5.0)
    vehicle.advance(40.0)
    vehicle.return_home()
    highest = {}
    while vehicle.flight.armed:
        vehicle.advance(vehicle.time_s + 0.1)
        x, _, z = vehicle.state().position_m
        highest[round(x / 10)] = max(z, highest.get(round(x / 10), 0.0))
    assert highest[4] == pytest.approx(QUAD.return_altitude_m, abs=0.5)


def test_landing_is_slow_near_the_ground():
    vehicle = executor()
    vehicle.takeoff(20.0)
    vehicle.advance(20.0)
    vehicle.land()
    phases = set()
    while vehicle.flight.armed:
        vehicle.advance(vehicle.time_s + 0.02)
        state = vehicle.state()
        phases.add(state.landed)
        if 0.0 < state.position_m[2] < 4.0:
            assert state.velocity_m_s[2] > -QUAD.landing_speed_m_s - 0.3
    assert phases == {LandedState.IN_AIR, LandedState.LANDING, LandedState.ON_GROUND} - (
        set() if LandedState.IN_AIR in phases else {LandedState.IN_AIR}
    )


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
    with pytest.raises(VehicleError, match="from the ground"):
        vehicle.land()
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


def test_a_storm_ends_the_mission():
    vehicle = executor(SQUARE, wind=Wind(-25.0, 0.0))
    vehicle.start()
    events = vehicle.advance(200.0)
    (event,) = only(events, CannotFly)
    assert event.seq == 1 and "wind" in event.reason
    assert vehicle.flight.phase is FlightPhase.HOLD
    vehicle.land()
    assert isinstance(fly(vehicle)[-1], Disarmed)


def test_a_loop_without_a_place_is_refused_in_flight_too():
    items = [takeoff(), do(178, 1, 5), do(177, 1, -1)]
    assert "never lead to a position" in str(check_mission(items, HOME, QUAD)[0])
    vehicle = executor(items)
    vehicle.start()
    events = vehicle.advance(20.0)
    assert "never lead" in only(events, CannotFly)[0].reason


def test_the_attitude_shows_the_acceleration():
    vehicle = executor()
    vehicle.takeoff(10.0)
    vehicle.advance(12.0)
    vehicle.goto(0.0, 200.0, 10.0, heading=Heading.fixed(0.0))
    vehicle.advance(13.0)
    state = vehicle.state()
    assert state.acceleration_m_s2[1] > 2.0
    assert -0.4 < state.pitch_rad < -0.2
    assert abs(state.roll_rad) < 0.02
    vehicle.goto(0.0, 200.0, 10.0, heading=Heading.fixed(-math.pi / 2))
    vehicle.advance(20.0)
    assert state.battery.voltage_v > 15.0
    assert vehicle.state().roll_rad > 0.01


BAD = [
    ([], "empty"),
    ([takeoff(), at(84, 0, 0)], r"item 2 \(command 84\): the vehicle does not know"),
    ([takeoff(), do(4501)], "command 4501"),
    ([takeoff(), MissionItem(16, 10, 0, 0, 0, 0, 28.05, -82.15, 10.0)], "frame 10"),
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
    items = [
        takeoff(),
        do(178, 1, 5),
        wp(5, 5),
        do(201),
        do(205),
        do(1000),
        do(115, 90.0),
        at(31, 5, 5, 20),
        RTL,
    ]
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


def test_a_return_is_flown_at_the_cruise_speed_when_the_mission_was_slower():
    vehicle = executor([takeoff(30), do(178, 1, 0.8, -1), wp(60, 0, 30), RTL])
    vehicle.start()
    while vehicle.motion.position_m[0] < 50.0:
        vehicle.advance(vehicle.time_s + 0.5)
    assert math.hypot(*vehicle.state().velocity_m_s[:2]) == pytest.approx(0.8, abs=0.1)
    vehicle.return_home()
    fastest = 0.0
    while vehicle.flight.armed:
        vehicle.advance(vehicle.time_s + 0.2)
        fastest = max(fastest, math.hypot(*vehicle.state().velocity_m_s[:2]))
    assert fastest == pytest.approx(QUAD.cruise_speed_m_s, rel=0.1)


def test_a_return_is_as_fast_as_a_mission_that_is_faster_than_cruise():
    fast = min(1.5 * QUAD.cruise_speed_m_s, QUAD.top_speed_m_s)
    assert fast > QUAD.cruise_speed_m_s
    vehicle = executor([takeoff(30), do(178, 1, fast, -1), wp(200, 0, 30), RTL])
    vehicle.start()
    while vehicle.motion.position_m[0] < 150.0:
        vehicle.advance(vehicle.time_s + 0.5)
    vehicle.return_home()
    assert max(leg.speed_m_s or 0.0 for leg in vehicle.flight.plan.legs[1:]) == fast
