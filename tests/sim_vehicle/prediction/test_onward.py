import math

import numpy as np
import pytest
from short_flights import started

from geo.frame import LocalFrame
from mission.model import MissionItem
from mission.planners.cornering import Cornering
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import FlightPhase, MissionComplete
from sim_vehicle.prediction.flight import climbs_by_itself
from sim_vehicle.prediction.onward import RETURN_HOME, InFlight, OnwardPredictor
from sim_vehicle.weather.wind import Wind

FARM = LocalFrame(28.05, -82.15, rotation_deg=25.0)
HOME_M = (20.0, -15.0)
HOME = LocalFrame(*FARM.to_wgs84(*HOME_M))
HEIGHT_M, SPEED_M_S, RADIUS_M = 12.0, 5.0, 1.5


def rows(number, width=70.0, spacing=6.0):
    points = []
    for k in range(number):
        ends = [(10.0, 10.0 + k * spacing), (10.0 + width, 10.0 + k * spacing)]
        points += ends if k % 2 == 0 else ends[::-1]
    return np.array(points)


def flown(spec, points, ending, wind, speed=SPEED_M_S, radius=RADIUS_M, takeoff=(0.0, 0.0)):
    """Fly a whole mission; return its states in flight (time, energy, motion, target) and its end."""
    up = HOME.to_wgs84(*takeoff)
    items = [
        MissionItem(22, 3, 10.0, 0, 0, None, *up, HEIGHT_M),
        MissionItem(178, param1=1.0, param2=speed, param3=-1.0),
        *(
            MissionItem.waypoint(*FARM.to_wgs84(x, y), HEIGHT_M, acceptance_radius_m=radius)
            for x, y in points.tolist()
        ),
        *ending,
    ]
    executor = started(items, spec, HOME, wind=wind, takes_off=climbs_by_itself(spec))
    states = []
    while True:
        for event in executor.advance(executor.time_s + 1.0):
            if isinstance(event, MissionComplete):
                return states, event.time_s, executor.motion.energy_j / WH_J
        target = executor.mission.current_seq - 2
        if executor.flight.phase is FlightPhase.MISSION and 0 <= target < len(points):
            used = executor.motion.energy_j / WH_J
            states.append((executor.time_s, used, executor.motion.snapshot(), target))


def seen(motion):
    """Return a motion state as telemetry tells it, in the farm frame."""
    angle = math.radians(FARM.rotation_deg)
    east, north, up = motion.velocity_m_s
    along = east * math.cos(angle) + north * math.sin(angle)
    aside = north * math.cos(angle) - east * math.sin(angle)
    x, y = FARM.from_wgs84(*HOME.to_wgs84(*motion.position_m[:2]))
    return InFlight((x, y), motion.position_m[2], (along, aside), up, motion.heading_rad)


def check_rests(predictor, points, flight, every, *, seconds_share, energy_share):
    """Compare prices on the way with what the rest of the flight took, by shares of the whole flight."""
    states, end_s, used_wh = flight
    for time_s, before_wh, motion, target in states[every]:
        seconds, watt_hours = predictor.rest(seen(motion), [points[target:]])
        assert seconds[0] == pytest.approx(end_s - time_s, abs=seconds_share * end_s)
        assert watt_hours[0] == pytest.approx(used_wh - before_wh, abs=energy_share * used_wh)


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "wind"),
    [
        ("quad", "px4", Wind(3.0, -2.0)),
        ("quad", "ardupilot", Wind(3.0, -2.0)),
        ("quad", "generic", None),
        ("mapping-quad", "px4", None),
        ("rover", "px4", None),
    ],
)
def test_the_rest_of_a_mission_costs_what_the_whole_flight_says(vehicle, autopilot, wind):
    spec = with_autopilot(get_vehicle(vehicle), autopilot)
    speed = min(SPEED_M_S, spec.top_speed_m_s)
    points = rows(6)
    flight = flown(spec, points, RETURN_HOME, wind, speed)
    predictor = OnwardPredictor(
        spec,
        FARM,
        HOME_M,
        altitude_m=HEIGHT_M,
        speed_m_s=speed,
        waypoints=Cornering(RADIUS_M).waypoints,
        wind=wind,
    )
    assert len(flight[0]) > 50
    check_rests(predictor, points, flight, slice(5, None, 17), seconds_share=0.0125, energy_share=0.0125)


def test_a_fixed_wing_is_priced_with_its_own_landing():
    spec = with_autopilot(get_vehicle("fixed-wing"), "px4")
    east, north = HOME.to_wgs84(-330.0, 60.0)
    ending = (
        MissionItem(189, 2),
        MissionItem(31, 3, 1.0, 60.0, 0.0, 1.0, east, north, 25.0),
        MissionItem(21, 3, 0, 0, 0, 0, *HOME.to_wgs84(0.0, 0.0), 0.0),
    )
    points = rows(4, 500.0, 90.0)
    flight = flown(spec, points, ending, None, 15.0, 20.0, takeoff=(150.0, 0.0))
    predictor = OnwardPredictor(
        spec,
        FARM,
        HOME_M,
        altitude_m=HEIGHT_M,
        speed_m_s=15.0,
        waypoints=Cornering(20.0).waypoints,
        ending=ending,
    )
    check_rests(predictor, points, flight, slice(20, None, 40), seconds_share=0.02, energy_share=0.03)


def test_a_path_is_priced_by_the_waypoints_that_fly_it():
    spec = with_autopilot(get_vehicle("quad"), "px4")
    here, path = InFlight((0.0, 0.0), HEIGHT_M, (3.0, 0.0)), rows(4)

    def priced(cornering, points):
        predictor = OnwardPredictor(spec, FARM, HOME_M, altitude_m=HEIGHT_M, waypoints=cornering.waypoints)
        return predictor.rest(here, [points])[0][0]

    led = Cornering(2.0, overshoots=True)
    sent = led.waypoints(path, (0.0, 0.0))
    assert priced(led, path) == priced(Cornering(2.0), sent.points_m)
    assert priced(Cornering(0.5), path) > priced(Cornering(1.5), path), "a small radius costs time"


def test_paths_priced_together_cost_what_they_cost_alone_and_in_any_order():
    spec = with_autopilot(get_vehicle("quad"), "px4")

    def predictor():
        return OnwardPredictor(spec, FARM, HOME_M, altitude_m=HEIGHT_M, wind=Wind(2.0, 1.0))

    here = InFlight((0.0, 0.0), HEIGHT_M, (3.0, 0.0))
    points = rows(4)
    paths = [points, points[::-1], points[:3], np.empty((0, 2)), points[:3]]
    together = np.array(predictor().rest(here, paths))
    alone = np.array([predictor().rest(here, [path]) for path in paths])[:, :, 0].T
    assert np.array_equal(together, alone)
    one = predictor()
    one.rest(here, paths[:2])
    assert np.array_equal(np.array(one.rest(here, paths[::-1])), together[:, ::-1])
    assert together[0, 3] < together[0, 2] < together[0, 0]


def test_the_ideal_robot_pays_a_step_for_each_cell():
    spec = get_vehicle("ideal")
    predictor = OnwardPredictor(spec, FARM, HOME_M, altitude_m=1.0, ending=())
    seconds, watt_hours = predictor.rest(
        InFlight(HOME_M, 1.0), [[(HOME_M[0] + 10.0 * spec.cell_m, HOME_M[1])]]
    )
    assert seconds.tolist() == [10.0 * spec.step_s]
    assert watt_hours.tolist() == [0.0]


def test_a_wind_that_is_too_strong_makes_a_path_infinitely_dear():
    spec = with_autopilot(get_vehicle("quad"), "generic")
    predictor = OnwardPredictor(spec, FARM, HOME_M, altitude_m=HEIGHT_M, wind=Wind(40.0, 0.0))
    seconds, watt_hours = predictor.rest(InFlight((0.0, 0.0), HEIGHT_M), [[(-50.0, 0.0)]])
    assert seconds.tolist() == watt_hours.tolist() == [math.inf]


def test_numbers_that_are_not_finite_are_refused():
    spec = with_autopilot(get_vehicle("quad"), "px4")
    with pytest.raises(VehicleError, match="altitude nan"):
        OnwardPredictor(spec, FARM, HOME_M, altitude_m=math.nan)
    predictor = OnwardPredictor(spec, FARM, HOME_M, altitude_m=HEIGHT_M)
    with pytest.raises(VehicleError, match="velocity must be finite"):
        predictor.rest(InFlight((0.0, 0.0), HEIGHT_M, (math.nan, 0.0)), [])
    with pytest.raises(VehicleError, match="point that is not finite"):
        predictor.rest(InFlight((0.0, 0.0), HEIGHT_M), [[(math.inf, 0.0)]])
    seconds, watt_hours = predictor.rest(InFlight((0.0, 0.0), HEIGHT_M), [])
    assert len(seconds) == len(watt_hours) == 0


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("angle_deg", [0.0, 60.0, 120.0])
def test_a_path_that_is_changed_to_costs_what_the_autopilot_loses_by_it(autopilot, angle_deg):
    spec = with_autopilot(get_vehicle("quad"), autopilot)
    old = np.array([[0.0, 0.0], [200.0, 0.0]])
    states, _, _ = flown(spec, old, (), None)
    motion = states[len(states) // 2][2]
    here = seen(motion)
    course = math.radians(angle_deg)
    along, aside = math.cos(course), math.sin(course)
    first = np.add(here.position_m, (40.0 * along, 40.0 * aside))
    path = np.array([first, np.add(first, (-20.0 * aside, 20.0 * along))])
    items = [MissionItem(178, param1=1.0, param2=SPEED_M_S, param3=-1.0)]
    items += [MissionItem.waypoint(*FARM.to_wgs84(*one), HEIGHT_M) for one in path.tolist()]
    executor = MissionExecutor(spec, HOME, takes_off=climbs_by_itself(spec))
    executor.mission.load(
        [MissionItem(22, 3, 10.0, 0, 0, None, *HOME.to_wgs84(0, 0), HEIGHT_M), *old_items(old)]
    )
    executor.arm()
    executor.start()
    while math.dist(executor.motion.position_m, motion.position_m) > 0.3:
        executor.advance(executor.time_s + 0.02)
    begin_s = executor.time_s
    executor.mission.change(items, 0)
    while not any(isinstance(event, MissionComplete) for event in executor.advance(executor.time_s + 0.1)):
        pass
    predictor = OnwardPredictor(spec, FARM, HOME_M, altitude_m=HEIGHT_M, speed_m_s=SPEED_M_S, ending=())
    (goes_on, begins), _ = predictor.rest(here, [path, path], anew=[False, True])
    assert begins == pytest.approx(executor.time_s - begin_s, rel=0.05, abs=0.3)
    assert begins - goes_on > 0.5 if autopilot == "ardupilot" and angle_deg < 90.0 else begins == goes_on


def old_items(points):
    speed = MissionItem(178, param1=1.0, param2=SPEED_M_S, param3=-1.0)
    return [speed, *(MissionItem.waypoint(*FARM.to_wgs84(x, y), HEIGHT_M) for x, y in points.tolist())]
