import math

import pytest
from short_flights import started

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.execution.state import BatteryDepleted, CannotFly, MissionComplete
from sim_vehicle.prediction.battery_swaps import batteries_needed, battery_changes
from sim_vehicle.prediction.predict import predict_flight
from sim_vehicle.weather.atmosphere import Turbulence
from sim_vehicle.weather.wind import Wind

HOME = LocalFrame(28.05, -82.15)


def rows(width, count, spacing, speed, aside=0.0):
    items = [MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0), MissionItem(178, 2, 1, speed, -1)]
    for k in range(count):
        ends = (0.0, width) if k % 2 == 0 else (width, 0.0)
        items += [MissionItem.waypoint(*HOME.to_wgs84(aside + x, k * spacing), 10.0) for x in ends]
    return Mission((*items, MissionItem(20, 2)), GeoPoint(28.05, -82.15))


def begun(spec, wind, items):
    return started(items, spec, HOME, wind=wind)


def landed(vehicle):
    """Fly on to the ground and return the energy that was used; the flight must not go wrong."""
    while vehicle.flight.armed:
        events = vehicle.advance(vehicle.time_s + 1.0)
        assert not any(isinstance(event, CannotFly | BatteryDepleted) for event in events)
    return vehicle.motion.energy_j / WH_J


def flown_with_changes(mission, spec, wind, changes):
    """Fly the mission as an operator would who changes batteries there; return what each battery gave."""
    used = []
    items, first = mission.items, 0
    for change in changes:
        vehicle = begun(spec, wind, items)
        before = math.inf
        while True:
            is_near = vehicle.mission.current_seq == change.seq + first
            vehicle.advance(vehicle.time_s + (0.1 if is_near else 1.0))
            assert vehicle.flight.armed and vehicle.mission.current_seq <= change.seq + first
            away = math.dist(vehicle.motion.position_m, change.place_m)
            if vehicle.mission.current_seq == change.seq + first and away < 3.0 and away > before:
                break
            before = away
        vehicle.return_home()
        used.append(landed(vehicle))
        there = MissionItem.waypoint(*HOME.to_wgs84(*change.place_m[:2]), max(change.place_m[2], 0.5))
        begin = mission.items[: 2 if spec.kind != "rover" else 0]
        items = (*begin, there, *mission.items[change.seq :])
        first = len(begin) + 1 - change.seq
    vehicle = begun(spec, wind, items)
    complete = False
    while vehicle.flight.armed and not complete:
        complete = any(isinstance(event, MissionComplete) for event in vehicle.advance(vehicle.time_s + 1.0))
    assert complete
    used.append(landed(vehicle))
    return used


CASES = [
    ("quad", "px4", rows(400.0, 50, 6.0, 8.0), None),
    ("quad", "ardupilot", rows(400.0, 60, 6.0, 8.0, aside=300.0), Wind(0.0, -4.0)),
    ("mini-quad", "ardupilot", rows(300.0, 60, 6.0, 5.0), None),
    ("rover", "px4", rows(400.0, 60, 6.0, 1.5), None),
]


@pytest.mark.parametrize(("name", "autopilot", "mission", "wind"), CASES)
def test_each_battery_comes_home_with_its_reserve_and_little_more(name, autopilot, mission, wind):
    spec = with_autopilot(get_vehicle(name), autopilot)
    capacity = spec.battery.capacity_wh
    usable = (1.0 - spec.battery.reserve_fraction) * capacity
    changes = battery_changes(mission, spec, wind=wind)
    assert changes and batteries_needed(
        mission, spec, predict_flight(mission, spec, wind=wind), wind=wind
    ) == (len(changes) + 1)
    used = flown_with_changes(mission, spec, wind, changes)
    for change, given in zip(changes, used, strict=False):
        assert given == pytest.approx(change.energy_wh, abs=0.01 * capacity)
        assert usable - 0.02 * capacity < given < usable + 0.01 * capacity
    assert used[-1] < usable + 0.01 * capacity


def test_batteries_are_changed_in_order_and_on_the_way():
    spec = with_autopilot(get_vehicle("quad"), "px4")
    mission = rows(400.0, 70, 4.0, 8.0, aside=1000.0)
    changes = battery_changes(mission, spec)
    assert len(changes) >= 3
    times = [change.time_s for change in changes]
    assert times == sorted(times) and [c.seq for c in changes] == sorted(c.seq for c in changes)
    for change in changes:
        assert 997.0 < change.place_m[0] < 1403.0 and change.place_m[2] == pytest.approx(10.0, abs=0.5)
    # Farther from home, more of each battery goes into the ways.
    assert len(battery_changes(rows(400.0, 70, 4.0, 8.0), spec)) < len(changes)


def test_gusts_are_one_sample_that_is_not_the_flight():
    spec = with_autopilot(get_vehicle("mini-quad"), "ardupilot")
    mission = rows(300.0, 40, 6.0, 5.0)
    air = [Wind(3.0, seed=seed, turbulence=Turbulence(5.0, 10.0, 5.0)) for seed in (1, 2)]
    one, two = (battery_changes(mission, spec, wind=wind) for wind in air)
    assert one == two


def test_without_a_battery_or_without_hope():
    assert battery_changes(rows(10.0, 2, 2.0, 1.0), get_vehicle("ideal")) == ()
    spec = with_autopilot(get_vehicle("quad"), "px4")
    assert battery_changes(rows(400.0, 2, 4.0, 8.0, aside=9000.0), spec) is None
    assert battery_changes(rows(400.0, 2, 4.0, 8.0), spec, wind=Wind(25.0)) is None
