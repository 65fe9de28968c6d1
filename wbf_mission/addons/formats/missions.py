"""Lists the mission formats that the core lacks: fence and rally text, KML, GeoJSON, GPX, CSV, WPML."""

from mission.files.formats import MissionFormat
from wbf_mission.addons.formats import dji, geojson, gpx, kml, points, table

FORMATS = (
    MissionFormat("fence or rally text", (".fen", ".ral"), points.loads),
    MissionFormat("KML", (".kml",), kml.loads, kml.dumps),
    MissionFormat("KMZ", (".kmz",), kml.kmz_loads, kml.kmz_dumps),
    MissionFormat("GeoJSON", (".geojson", ".geojsonl", ".geojsons"), geojson.loads, geojson.dumps),
    MissionFormat("GPX", (".gpx",), gpx.loads, gpx.dumps),
    MissionFormat("CSV", (".csv",), table.loads, table.dumps),
    MissionFormat("DJI WPML", (".wpml.kmz",), None, dji.dumps, losses=dji.losses),
)
