"""The vehicles of the package, against what is published of such aircraft (docs/energy.md)."""

from importlib import resources

import pytest

from sim_vehicle.airframe.catalog import get_vehicle, vehicle_names
from sim_vehicle.energy.power import best_speeds, endurance_s
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.legs import Leg, Route
from sim_vehicle.motion.model import MotionEvent
from sim_vehicle.motion.multirotor.model import Multirotor
from wbf_mission.cli.app import main

DOCUMENTED = [name for name in vehicle_names() if get_vehicle(name).published is not None]
POWERED = [name for name in vehicle_names() if get_vehicle(name).power is not None]


@pytest.mark.parametrize("name", DOCUMENTED)
def test_endurance_is_the_published_one(name):
    vehicle = get_vehicle(name)
    told = vehicle.published
    model = endurance_s(vehicle, told.airspeed_m_s, used_fraction=told.used_fraction)
    assert model / 60.0 == pytest.approx(told.endurance_min, rel=0.05)
    assert told.condition and told.source


@pytest.mark.parametrize("name", ["quad", "mini-quad"])
def test_a_flight_lasts_as_long_as_published(name):
    vehicle = get_vehicle(name)
    told = vehicle.published
    motion = Multirotor(vehicle)
    motion.fly(Route.through([Leg((0.0, 0.0, 5.0), vehicle.cruise_speed_m_s)]))
    assert motion.advance(10_000) is MotionEvent.REACHED
    if told.airspeed_m_s > 0.0:
        motion.fly(Route.through([Leg((20_000.0, 0.0, 5.0), told.airspeed_m_s)]))
    assert motion.advance(400_000) is MotionEvent.ENERGY
    assert motion.time_s / 60.0 == pytest.approx(told.endurance_min, rel=0.05)


@pytest.mark.parametrize("name", POWERED)
def test_the_best_speeds_are_the_best(name):
    vehicle = get_vehicle(name)
    best = best_speeds(vehicle)
    cruise = endurance_s(vehicle, vehicle.cruise_speed_m_s)
    assert best.endurance_s >= cruise * (1.0 - 1e-3)
    assert best.range_m >= cruise * vehicle.cruise_speed_m_s * (1.0 - 1e-3)
    assert best.range_speed_m_s >= best.endurance_speed_m_s


def test_an_endless_vehicle_has_no_endurance():
    with pytest.raises(VehicleError, match="endurance is unlimited"):
        endurance_s(get_vehicle("ideal"), 1.0)


def test_the_files_are_complete():
    folder = resources.files("sim_vehicle.airframe") / "vehicles"
    for entry in folder.iterdir():
        text = entry.read_text(encoding="utf-8")
        assert "base =" not in text and "description =" in text


def test_the_command_lists_and_shows_them(capsys):
    assert main(["vehicle", "list"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in vehicle_names())
    for name in vehicle_names():
        assert main(["vehicle", "show", name]) == 0
    shown = capsys.readouterr().out
    assert "as modelled" in shown and "31.0 min" in shown
    assert main(["vehicle", "show", "mini-quad", "--json"]) == 0
    assert '"published_endurance_min": 31.0' in capsys.readouterr().out
    assert main(["vehicle", "show", "hovercraft"]) == 2
    assert "unknown vehicle 'hovercraft'" in capsys.readouterr().err
