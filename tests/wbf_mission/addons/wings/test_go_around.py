"""A landing of ArduPlane that is broken off, and begun anew."""

import math
from dataclasses import replace

import pytest
from mission_items import item

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import CannotFly, ItemReached, LandedState, LandingRestarted

HOME = LocalFrame(28.05, -82.15)
SPEC = replace(with_autopilot(get_vehicle("fixed-wing"), "ardupilot"), battery=None)
LAND_START = MissionItem(189, 2)


TAKEOFF = item(22, 0.0, 150.0, 40.0, 10.0)
# From the south to home.
APPROACH = item(16, 0.0, -700.0, 40.0)


def started(*items):
    executor = MissionExecutor(SPEC, HOME)
    executor.mission.load((TAKEOFF, *items))
    executor.arm()
    executor.start()
    return executor


def landing(*items, below_m=15.0):
    """Return an executor that has flown a mission to its landing, below a height."""
    executor = started(*items)
    while (
        executor.mission.items[executor.mission.current_seq].command != 21
        or executor.motion.position_m[2] > below_m
    ):
        executor.advance(executor.time_s + 0.1)
        assert executor.time_s < 900.0
    return executor


def climbed(executor):
    """Fly until the landing is begun anew; return the events, and the positions on the way."""
    land, begun_s, events, way = executor.mission.current_seq, executor.time_s, [], []
    while executor.mission.current_seq == land:
        events += executor.advance(executor.time_s + 0.1)
        way.append(executor.motion.position_m)
        assert executor.time_s < begun_s + 60.0
    return events, way


@pytest.mark.parametrize(
    ("start", "own_m", "ordered_m", "top_m", "again"),
    [
        # To the height of the take-off, and to where the landing starts.
        ((LAND_START,), 0.0, None, TAKEOFF.z, 2),
        # To the height of the landing item or the one that is ordered, and to the waypoint before.
        ((), 45.0, None, 45.0, 2),
        ((), 45.0, 60.0, 60.0, 2),
    ],
)
def test_it_climbs_straight_ahead_and_lands_after_all(start, own_m, ordered_m, top_m, again):
    executor = landing(item(16, 300.0, 300.0, 50.0), *start, APPROACH, item(21, 0.0, 0.0, 0.0, own_m))
    land = executor.mission.current_seq
    assert executor.mission.go_around(ordered_m) == top_m
    events, way = climbed(executor)
    (x, y, _), (end_x, end_y, top) = way[0], way[-1]
    assert math.degrees(math.atan2(end_x - x, end_y - y)) == pytest.approx(0.0, abs=5.0)
    assert min(z for _, _, z in way) > 8.0
    assert top == pytest.approx(top_m, abs=1.0)
    assert [event.seq for event in events if isinstance(event, LandingRestarted)] == [again]
    assert not any(isinstance(event, ItemReached) and event.seq == land for event in events)
    executor.advance(executor.time_s + 400.0)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert math.hypot(*executor.motion.position_m[:2]) < 120.0


def test_it_goes_around_from_the_flare():
    executor = landing(APPROACH, item(21, 0.0, 0.0), below_m=1.5)
    assert executor.flight.landed is LandedState.LANDING
    executor.mission.go_around()
    assert executor.flight.landed is LandedState.IN_AIR
    _, way = climbed(executor)
    assert way[-1][2] == pytest.approx(TAKEOFF.z, abs=1.0)


def test_it_goes_to_the_nearest_start_of_a_landing():
    far = LAND_START, item(16, 3000.0, 0.0, 40.0)
    executor = landing(*far, LAND_START, APPROACH, item(21, 0.0, 0.0))
    executor.mission.go_around()
    events, _ = climbed(executor)
    assert [event.seq for event in events if isinstance(event, LandingRestarted)] == [3]


def test_a_landing_without_a_way_to_it_cannot_be_begun_anew():
    executor = landing(item(21, 0.0, 0.0), below_m=30.0)
    executor.mission.go_around()
    events = executor.advance(executor.time_s + 60.0)
    assert [event.reason for event in events if isinstance(event, CannotFly)] == [
        "unable to restart the landing sequence"
    ]


def test_only_a_landing_can_be_broken_off():
    executor = started(item(16, 0.0, 900.0, 50.0))
    executor.advance(20.0)
    with pytest.raises(VehicleError, match="not flying a landing"):
        executor.mission.go_around()
