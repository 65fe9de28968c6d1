"""Items of missions about a home, in metres east and north of it."""

from geo.frame import LocalFrame
from mission.model import GeoPoint, Mission, MissionItem

HOME = LocalFrame(28.05, -82.15, 30.0)


def wp(x, y, z=10.0, **options):
    return MissionItem.waypoint(*HOME.to_wgs84(float(x), float(y)), z, **options)


def at(command, x, y, z=10.0, *params):
    params = (*params, *(None,) * (4 - len(params)))
    return MissionItem(command, 3, *params, *HOME.to_wgs84(float(x), float(y)), z)


def item(command, x, y, z=0.0, *params):
    """Return an item with zeros for the parameters that are not given."""
    return MissionItem(command, 3, *params, *[0.0] * (4 - len(params)), *HOME.to_wgs84(x, y), z)


def do(command, *params):
    return MissionItem(command, 2, *params)


def takeoff(z=10.0):
    return MissionItem(22, 3, 0, 0, 0, None, 0.0, 0.0, z)


RTL = do(20)
SHORT = Mission(
    (MissionItem(22, 3, z=5.0), MissionItem.waypoint(28.0501, -82.15, 5.0), MissionItem(20)),
    GeoPoint(28.05, -82.15, 30.0),
)
