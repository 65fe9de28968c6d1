"""After the warm-up no flight waits for the compiler."""

import subprocess
import sys

from sim_vehicle.airframe.catalog import get_vehicle
from wbf_mission.addons.base.simulator import warm_up

FLIGHT = """
from geo.frame import LocalFrame
from mission.model import GeoPoint, MissionItem
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.motion.multirotor import model
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.addons.base.simulator import warm_up
from sim_vehicle.weather.wind import Wind

def compiled():
    found = {}
    for module in (kernel, model):
        for name, value in vars(module).items():
            if hasattr(value, "signatures"):
                found[name] = len(value.signatures)
    return found

spec = get_vehicle("quad")
warm_up(spec)
before = compiled()
assert any(before.values()), before
vehicle = SimVehicle(spec, GeoPoint(28.0, -82.0, 10.0), wind=Wind(2.0, 1.0, 0.5))
pilot = vehicle.pilot
place = LocalFrame(28.0, -82.0).to_wgs84
ways = ((5.0, 0.0), (12.0, 1.0), (3.0, 0.0))
pilot.load([MissionItem.waypoint(*place(x, 5.0), 8.0, hold_s=hold_s) for x, hold_s in ways])
pilot.arm()
pilot.set_mode(type(pilot.mode).MISSION)
pilot.advance(60.0)
pilot.set_mode(type(pilot.mode).RTL)
pilot.advance(200.0)
assert pilot.landed == 1 and pilot.state.path_length_m > 20.0, pilot.state
assert compiled() == before, (before, compiled())
"""


def test_a_flight_compiles_nothing_more():
    done = subprocess.run([sys.executable, "-c", FLIGHT], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_the_ideal_vehicle_needs_none():
    warm_up(get_vehicle("ideal"))
