"""Short flights through every kernel, small enough to run uncompiled.

``NUMBA_DISABLE_JIT=1 python -m pytest -m kernel`` runs them as plain Python, for the coverage of the kernels.
"""

import numpy as np
import pytest
from short_flights import GUSTS, HOME, flying, item

from mission.model import Command, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import FlightPhase, ItemReached, LandedState, MissionComplete
from sim_vehicle.motion.batch import VehicleBatch
from sim_vehicle.motion.legs import KEEP, Circle, Heading, Leg, LegKind, Route
from sim_vehicle.motion.model import MotionEvent
from sim_vehicle.weather.atmosphere import Turbulence, WindShear
from sim_vehicle.weather.wind import Wind

pytestmark = pytest.mark.kernel
MULTIROTORS = pytest.mark.parametrize("autopilot", ["generic", "px4", "ardupilot"])


@pytest.mark.parametrize("wind", [None, Wind(1.0, -0.5, gust_m_s=0.5, seed=1)], ids=["calm", "gusts"])
@MULTIROTORS
def test_a_short_mission_is_flown_to_its_end(autopilot, wind):
    executor = MissionExecutor(with_autopilot(get_vehicle("quad"), autopilot), HOME, wind=wind)
    corner = [item(Command.NAV_WAYPOINT, 15.0, 0.0, 5.0), item(Command.NAV_WAYPOINT, 15.0, 15.0, 6.0, 1.0)]
    executor.mission.load(
        [item(Command.NAV_TAKEOFF, 0.0, 0.0, 5.0), *corner, item(Command.NAV_LAND, 5.0, 5.0, 0.0)]
    )
    executor.arm()
    executor.start()
    events = executor.advance(120.0)
    assert [event.seq for event in events if isinstance(event, ItemReached)] == [0, 1, 2, 3]
    x, y, z = executor.motion.position_m
    assert (x, y, z) == pytest.approx((5.0, 5.0, 0.0), abs=2.5)
    assert executor.flight.landed is LandedState.ON_GROUND


DRYDEN = Wind(2.0, 1.0, seed=5, turbulence=Turbulence(3.0, 15.0, 8.0), shear=WindShear("log"))


@MULTIROTORS
def test_turns_splines_delays_and_the_way_home(autopilot):
    items = [
        item(Command.NAV_TAKEOFF, 0.0, 0.0, 5.0),
        MissionItem(Command.DO_CHANGE_SPEED, param1=1.0, param2=3.0, param3=-1.0),
        item(Command.NAV_WAYPOINT, 8.0, 0.0, 5.0),
        item(Command.NAV_SPLINE_WAYPOINT, 12.0, 8.0, 7.0),
        item(Command.NAV_SPLINE_WAYPOINT, 2.0, 12.0, 5.0),
        MissionItem(Command.CONDITION_YAW, param1=90.0, param2=30.0, param3=1.0, param4=0.0),
        item(Command.NAV_WAYPOINT, 2.0, 9.0, 5.0, 1.0),
        item(Command.DO_SET_ROI_LOCATION, 30.0, 0.0, 0.0),
        item(Command.NAV_LOITER_TURNS, 4.0, 5.0, 5.0, 1.0),
        MissionItem(Command.DO_SET_ROI_NONE),
        item(Command.NAV_LOITER_TIME, 0.0, 6.0, 8.0, 1.0),
        MissionItem(Command.NAV_RETURN_TO_LAUNCH),
    ]
    executor = flying("quad", autopilot, items, DRYDEN)
    events = executor.advance(300.0)
    reached = [event.seq for event in events if isinstance(event, ItemReached)]
    assert reached == sorted(reached) and {0, 2, 3, 4, 6, 8, 10} <= set(reached)
    assert any(isinstance(event, MissionComplete) for event in events)
    assert executor.motion.position_m == pytest.approx((0.0, 0.0, 0.0), abs=1.5)


@MULTIROTORS
def test_orders_under_way(autopilot):
    executor = flying("quad", autopilot)
    x, y, z = executor.motion.position_m
    assert z == pytest.approx(6.0, abs=0.5)
    executor.steer((2.0, 1.0, 0.0))
    executor.advance(executor.time_s + 4.0)
    x, y, z = executor.motion.snapshot().velocity_m_s
    assert (x, y, z) == pytest.approx((2.0, 1.0, 0.0), abs=0.3)
    executor.steer((0.0, 0.0, 0.5), heading=Heading.turning(0.5))
    executor.advance(executor.time_s + 4.0)
    assert executor.motion.snapshot().velocity_m_s[2] == pytest.approx(0.5, abs=0.1)
    assert executor.motion.snapshot().yaw_rate_rad_s == pytest.approx(0.5, abs=0.1)
    executor.goto(10.0, 10.0, 9.0)
    executor.advance(executor.time_s + 2.0)
    executor.flight.look_at((0.0, 30.0))
    executor.goto(-5.0, 10.0, 4.0)
    executor.advance(executor.time_s + 25.0)
    assert executor.motion.position_m == pytest.approx((-5.0, 10.0, 4.0), abs=1.0)
    executor.flight.look_at(None)
    executor.orbit(0.0, 10.0, 5.0, 5.0, 2.0)
    executor.advance(executor.time_s + 15.0)
    x, y, _ = executor.motion.position_m
    assert np.hypot(x, y - 10.0) == pytest.approx(5.0, abs=1.0)
    executor.flight.hold()
    executor.advance(executor.time_s + 5.0)
    assert np.hypot(*executor.motion.snapshot().velocity_m_s[:2]) < 0.2
    executor.land()
    executor.advance(executor.time_s + 40.0)
    assert executor.flight.landed is LandedState.ON_GROUND


@MULTIROTORS
@pytest.mark.parametrize("order", ["fall", "drain"])
def test_without_motors_and_without_a_battery_it_comes_down(autopilot, order):
    executor = flying("quad", autopilot, wind=GUSTS)
    executor.steer((3.0, 0.0, 0.0))
    executor.advance(executor.time_s + 2.0)
    if order == "fall":
        executor.flight.fall()
    else:
        executor.flight.drain_battery(0.0)
    executor.advance(executor.time_s + 0.5)
    assert executor.flight.phase is (FlightPhase.FALLING if order == "fall" else FlightPhase.DEPLETED)
    executor.advance(executor.time_s + 30.0)
    assert executor.flight.landed is LandedState.ON_GROUND
    assert executor.motion.position_m[2] == 0.0


@pytest.mark.parametrize(
    ("name", "autopilot"),
    [
        ("quad", "generic"),
        ("quad", "px4"),
        ("quad", "ardupilot"),
        ("fixed-wing", "px4"),
        ("fixed-wing", "ardupilot"),
        ("rover", "px4"),
        ("rover", "ardupilot"),
    ],
)
def test_a_batch_moves_as_its_vehicles_one_by_one(name, autopilot):
    spec = with_autopilot(get_vehicle(name), autopilot)
    singles, many = (
        [flight_procedures(spec).motion(spec, wind, 0.3) for wind in (None, GUSTS, DRYDEN)] for _ in range(2)
    )

    def fly(group, far_m):
        for k, vehicle in enumerate(group):
            legs = [
                Leg((0.0, 0.0, 8.0), 5.0, heading=KEEP, kind=LegKind.TAKEOFF),
                Leg((far_m, 10.0 * k, 8.0), 4.0, radius_m=1.5, near_m=4.0, pause_s=0.5),
            ]
            if name == "fixed-wing":
                legs.append(Leg((60.0, 60.0, 20.0), 14.0, kind=LegKind.LOITER, circle=Circle(50.0, 1.0)))
            vehicle.fly(Route.through(legs))

    for group in (singles, many):
        for vehicle in group:
            vehicle.track, vehicle.track_every = np.zeros((20, 3)), 50
        fly(group, 20.0)
    batch = VehicleBatch(many)
    stops = np.array([True, False, True])
    for steps in ([1, 1, 1], [0, 150, 80], [400, 0, 250], [300, 400, 500]):
        events = batch.advance(np.array(steps), stop_each=stops)
        for vehicle, number, stop, event in zip(singles, steps, stops.tolist(), events, strict=True):
            assert (vehicle.advance(number, stop_each=stop) if number else MotionEvent.RAN) == event
        for one, other in zip(singles, many, strict=True):
            for row in ("state", "counters", "arrivals", "guide", "heads", "curves"):
                np.testing.assert_array_equal(getattr(one, row, 0), getattr(other, row, 0), err_msg=row)
            assert one.snapshot() == other.snapshot()
            assert one.track_points == other.track_points
            np.testing.assert_array_equal(one.track[: one.track_points], other.track[: one.track_points])
        if steps[1] == 0:
            for group in (singles, many):
                fly(group[::2], -30.0)
    np.testing.assert_array_equal(batch.state, np.array([vehicle.state for vehicle in singles]))
