"""Flights that are small enough to run uncompiled."""

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.weather.wind import Wind

GUSTS = Wind(1.0, -0.5, gust_m_s=0.5, seed=1)
HOME = LocalFrame(28.05, -82.15)


def item(command, x, y, z, first=0.0):
    latitude, longitude = HOME.to_wgs84(x, y)
    return MissionItem(int(command), 3, first, 0.0, 0.0, None, float(latitude), float(longitude), z)


def flying(vehicle, autopilot, items=None, wind=None, height=6.0):
    """A vehicle with a mission, or one that took off and holds."""
    executor = MissionExecutor(with_autopilot(get_vehicle(vehicle), autopilot), HOME, wind=wind)
    if items is not None:
        executor.mission.load(items)
    executor.arm()
    if items is not None:
        executor.start()
    else:
        executor.takeoff(height)
        executor.advance(30.0)
    return executor


def started(items, spec, frame=HOME, **options):
    """An executor that has just begun a mission."""
    executor = MissionExecutor(spec, frame, **options)
    executor.mission.load(items)
    executor.arm()
    executor.start()
    return executor
