"""Plans for the checks before a flight: a good one, and what is changed in it."""

from dataclasses import replace
from functools import cache

import shapely

from geo.farm import Farm, Obstacle, Patch
from geo.frame import LocalFrame
from geo.grid import Crop
from mission.model import Command, GeoPoint, Mission, MissionItem
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.scenario import VehicleOptions, WeatherOptions

HOME = GeoPoint(28.05, -82.15, 20.0)
FRAME = LocalFrame(HOME.latitude_deg, HOME.longitude_deg, HOME.altitude_m)
RTL = MissionItem(Command.NAV_RETURN_TO_LAUNCH)
CAMERA_OFF = MissionItem(Command.DO_SET_CAM_TRIGG_DIST)


def at(east, north, up=10.0, command=Command.NAV_WAYPOINT, **more):
    """An item at metres east and north of home."""
    latitude, longitude = FRAME.to_wgs84(float(east), float(north))
    given = {"frame": 3, "param2": 2.0 if command == Command.NAV_WAYPOINT else 0.0, "param4": None, **more}
    return MissionItem(command, x=latitude, y=longitude, z=up, **given)


def takeoff(up=10.0):
    return at(0.0, 0.0, up, Command.NAV_TAKEOFF)


def speed(metres_per_second):
    return MissionItem(Command.DO_CHANGE_SPEED, param1=1.0, param2=metres_per_second, param3=-1.0)


def camera(metres):
    return MissionItem(Command.DO_SET_CAM_TRIGG_DIST, param1=metres, param3=1.0)


def good(*middle, start=None, end=(CAMERA_OFF, RTL)):
    """A plan without a fault; `middle` replaces its waypoints."""
    rows = middle or (at(40, 0), at(40, 40), at(0, 40))
    return Mission((*((takeoff(),) if start is None else start), speed(5.0), camera(5.0), *rows, *end), HOME)


def fence(points, *, inside=True):
    command = (
        Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION if inside else Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    )
    return tuple(at(x, y, 0.0, command, frame=0, param1=float(len(points)), param2=0.0) for x, y in points)


def box(west, south, east, north, *, inside=True):
    return fence([(west, south), (east, south), (east, north), (west, north)], inside=inside)


def fenced(mission, *zones):
    return replace(mission, fence=tuple(item for zone in zones for item in zone))


def farm_with_obstacle(west, south, east, north, *, height_m=None, margin_m=None):
    """A farm about home with a box that must not be flown over, or so high."""
    frame = LocalFrame(*FRAME.to_wgs84(-200.0, -200.0))
    land = Patch("field", Crop.TOMATO, "me", shapely.box(0, 0, 400, 400))
    obstacle = Obstacle(shapely.box(200 + west, 200 + south, 200 + east, 200 + north), height_m, margin_m)
    return Farm("walled", frame, 400, 400, (land,), "me", (200.0, 200.0), 1.0, obstacles=(obstacle,))


def checked(mission, *, vehicle="quad", autopilot="px4", wind=0.0, gust=0.0, turbulence=None, **more):
    """The check of a plan."""
    weather = WeatherOptions(
        wind_speed_m_s=wind, wind_direction_deg=270.0, wind_gust_m_s=gust, turbulence=turbulence
    )
    options = VehicleOptions(name=vehicle, autopilot=autopilot, parameters=more.pop("parameters", {}))
    return check_mission(mission, Circumstances(options, weather, **more))


def findings(mission, **more):
    """The findings by their codes, computed once for the same plan and circumstances.

    A vehicle's snapshot has no hash, so a check against it is made each time.
    """
    return (_findings if "snapshot" in more else _kept_findings)(mission, **more)


def _findings(mission, **more):
    return {one.code: one for one in checked(mission, **more).report.findings}


_kept_findings = cache(_findings)
