"""GDAL reads what we write, with the same places, and what it writes of that is still the same mission."""

import pytest
import shapely
from pyogrio.raw import read

from mission.files import write_mission
from mission.model import GeoPoint, Mission, MissionItem
from wbf_mission.addons.formats.records import is_flown

SQUARE = [(28.0, -82.0), (28.001, -82.0), (28.001, -81.999), (28.0, -81.999)]
MISSION = Mission(
    (
        MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=10.0),
        MissionItem(206, 2, 5.0),
        MissionItem.waypoint(28.051, -82.1512345, 10.0, hold_s=2.0),
        MissionItem.waypoint(28.052, -82.151, 12.5, yaw_deg=90.0),
        MissionItem(201, 3, x=28.1, y=-82.1, z=0.0),
        MissionItem(177, 2, 2.0, 3.0),
        MissionItem(20),
    ),
    home=GeoPoint(28.05, -82.15, 30.0),
    fence=(
        *(MissionItem(5001, 0, 4.0, x=x, y=y, autocontinue=False) for x, y in SQUARE),
        *(MissionItem(5002, 0, 4.0, x=x, y=y, autocontinue=False) for x, y in reversed(SQUARE)),
        MissionItem(5003, 0, 50.0, x=28.0, y=-82.0, autocontinue=False),
    ),
    rally=(MissionItem(5100, 3, x=28.0, y=-82.0, z=20.0, autocontinue=False),),
)
PATH = [(item.y, item.x) for item in MISSION.items if is_flown(item)]
CSV = {"X_POSSIBLE_NAMES": "longitude", "Y_POSSIBLE_NAMES": "latitude", "Z_POSSIBLE_NAMES": "altitude_m"}


def layer(path, name=None):
    """Return the geometries and the named fields of a layer, as GDAL reads them."""
    options = {"KEEP_GEOM_COLUMNS": "YES", **CSV} if path.suffix == ".csv" else {}
    meta, _, shapes, fields = read(path, layer=name, **options)
    found = [None if shape is None else shapely.from_wkb(shape) for shape in shapes]
    return found, dict(zip(meta["fields"], fields, strict=True)), meta


@pytest.mark.parametrize("suffix", [".kml", ".kmz", ".geojson", ".csv"])
def test_gdal_finds_the_places_and_fields(tmp_path, suffix):
    path = tmp_path / f"mine{suffix}"
    write_mission(MISSION, path)
    shapes, fields, meta = layer(path)
    roles = list(fields["role"])
    items = [
        (int(fields["index"][k]), int(fields["command"][k]), shapes[k])
        for k, role in enumerate(roles)
        if role == "item"
    ]
    assert [(index, command) for index, command, _ in items] == [
        (index, item.command) for index, item in enumerate(MISSION.items)
    ]
    for (_, _, shape), item in zip(items, MISSION.items, strict=True):
        assert (shape is None) == (not item.has_position)
        if shape is not None:
            assert (shape.x, shape.y) == (item.y, item.x)
            if suffix != ".geojson":
                assert shape.z == item.z
    if suffix == ".csv":
        assert roles.count("fence") == 9
        return
    assert meta["crs"] == "EPSG:4326"
    (line,) = (shape for shape, role in zip(shapes, roles, strict=True) if role == "path")
    assert list(shapely.force_2d(line).coords) == PATH
    areas = [shape for shape in shapes if shape is not None and shape.geom_type == "Polygon"]
    for area in areas:
        assert area.exterior.is_ccw
        assert {(y, x) for x, y in shapely.force_2d(area).exterior.coords} == set(SQUARE)
    assert len(areas) == 2


def test_gdal_finds_the_route_and_the_waypoints_of_gpx(tmp_path):
    path = tmp_path / "mine.gpx"
    write_mission(MISSION, path)
    (route,), names, _ = layer(path, "routes")
    assert list(route.coords) == PATH
    assert list(names["name"]) == ["Mission"]
    points, fields, _ = layer(path, "route_points")
    assert [(point.x, point.y) for point in points] == PATH
    assert list(fields["ele"]) == [40.0, 40.0, 42.5]
    pins, fields, _ = layer(path, "waypoints")
    assert [(pin.x, pin.y) for pin in pins[:2]] == [(-82.15, 28.05), (-82.1, 28.1)]
    assert fields["ele"][0] == 30.0
    assert len(pins) == 1 + 1 + 9 + 1
