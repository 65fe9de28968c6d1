"""Exports tracks, planned missions and readings to GPX, KML (Google Earth), GeoJSON and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from geo.atomic import atomic_write
from geo.geojson import farm_document
from geo.texts import printable
from mission.outcome import in_words
from wbf_mission.addons.base.antimeridian import cut
from wbf_mission.addons.base.markup import GPX, add, decimal, document
from wbf_mission.addons.export.scene import OBSTACLE, crop_colour, places_of, vehicle_colour, waypoints_of
from wbf_mission.events import Event, FlightEnded, Planned, RunBegun, Seen, VehicleMoved

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

_KML = {"xmlns": "http://www.opengis.net/kml/2.2", "xmlns:gx": "http://www.google.com/kml/ext/2.2"}
_CSV = ("time", "time_s", "day", "flight", "vehicle", "latitude_deg", "longitude_deg", "altitude_m")
_TOLD = ("x_m", "y_m", "height_m", "speed_m_s", "heading_rad", "battery", "mode", "item")


@dataclass(slots=True)
class _Flight:
    """One flight of a vehicle, with its states, as the files show it."""

    day: int
    flight: int
    system_id: int
    vehicle: str
    states: list[VehicleMoved] = field(default_factory=list)
    plan: Planned | None = None  # The plan before the take-off.
    outcome: str = ""

    @property
    def numbers(self) -> dict[str, int]:
        """Day, flight and vehicle numbers, keyed by column name."""
        return {"day": self.day, "flight": self.flight, "vehicle": self.system_id}

    @property
    def name(self) -> str:
        """Name of the flight, the same in all files."""
        return printable(f"day {self.day}, flight {self.flight}, vehicle {self.system_id} ({self.vehicle})")


class _Tracks:
    """Flights and readings collected from the events of a run."""

    def __init__(self, record: RunRecord, events: Iterable[Event], epoch_s: float) -> None:
        self.farm = record.farm
        self.epoch = datetime.fromtimestamp(epoch_s, UTC)
        self.flights: dict[tuple[int, int, int], _Flight] = {}
        self.seen: list[Seen] = []
        self.title = ""
        names: dict[int, str] = {}
        for event in events:
            if isinstance(event, RunBegun):
                self.title = printable(event.title)
                names = {vehicle.system_id: vehicle.name for vehicle in event.vehicles}
            elif isinstance(event, Seen):
                self.seen.append(event)
            elif isinstance(event, Planned | VehicleMoved | FlightEnded):
                key = (event.day, event.flight, event.system_id)
                flight = self.flights.setdefault(key, _Flight(*key, names[event.system_id]))
                if isinstance(event, VehicleMoved):
                    flight.states.append(event)
                elif isinstance(event, FlightEnded):
                    flight.outcome = event.outcome
                elif flight.plan is None:
                    flight.plan = event

    @property
    def flown(self) -> list[_Flight]:
        """Flights with a track of at least two points."""
        return [flight for flight in self.flights.values() if len(flight.states) > 1]

    def time(self, time_s: float) -> str:
        """Return a time of the run in ISO 8601."""
        time = self.epoch + timedelta(seconds=time_s)
        return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")

    def places(self, points_m: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return latitude and longitude of points, float64[n, 2], rounded to 8 digits."""
        return np.round(places_of(self.farm, points_m), 8)

    def track(self, flight: _Flight) -> list[tuple[VehicleMoved, float, float, float]]:
        """Return each state of a flight with its latitude, longitude and altitude above sea level."""
        places = self.places(np.array([(state.x_m, state.y_m) for state in flight.states])).tolist()
        sea_m = self.farm.frame.altitude_m
        return [
            (state, latitude, longitude, round(sea_m + state.height_m, 3))
            for state, (latitude, longitude) in zip(flight.states, places, strict=True)
        ]

    def planned(self, flight: _Flight) -> list[tuple[float, float, float]]:
        """Return latitude, longitude and height above home of the planned waypoints."""
        return [] if flight.plan is None else waypoints_of(flight.plan.mission, self.farm)


def write_gpx(record: RunRecord, files: tuple[Path, ...], events: Iterable[Event], epoch_s: float) -> None:
    """Write tracks with times and altitudes, and the planned waypoints as routes."""
    tracks = _Tracks(record, events, epoch_s)
    gpx = ElementTree.Element("gpx", GPX)
    about = add(gpx, "metadata")
    add(about, "name", tracks.title)
    add(about, "time", tracks.time(0.0))
    sea_m = tracks.farm.frame.altitude_m
    (home,) = tracks.places(np.array([tracks.farm.home_m])).tolist()
    mark = add(gpx, "wpt", lat=decimal(home[0]), lon=decimal(home[1]))
    add(mark, "ele", decimal(sea_m))
    add(mark, "name", "Home")
    for flight in tracks.flights.values():
        if waypoints := tracks.planned(flight):
            route = add(gpx, "rte")
            add(route, "name", f"Planned, {flight.name}")
            for latitude, longitude, height_m in waypoints:
                point = add(route, "rtept", lat=decimal(latitude), lon=decimal(longitude))
                add(point, "ele", decimal(sea_m + height_m))
    for flight in tracks.flown:
        track = add(gpx, "trk")
        add(track, "name", flight.name)
        add(track, "desc", printable(in_words(flight.outcome)))
        segment = add(track, "trkseg")
        for state, latitude, longitude, altitude_m in tracks.track(flight):
            point = add(segment, "trkpt", lat=decimal(latitude), lon=decimal(longitude))
            add(point, "ele", decimal(altitude_m))
            add(point, "time", tracks.time(state.time_s))
    _write(files, document(gpx).encode())


def write_kml(record: RunRecord, files: tuple[Path, ...], events: Iterable[Event], epoch_s: float) -> None:
    """Write tracks that Google Earth can play, planned paths, and the farm with its obstacles."""
    tracks = _Tracks(record, events, epoch_s)
    kml = ElementTree.Element("kml", _KML)
    top = add(kml, "Document")
    add(top, "name", tracks.title)
    _add_farm(top, tracks)
    planned, flown = add(top, "Folder"), add(top, "Folder")
    add(planned, "name", "Planned")
    add(flown, "name", "Flown")
    for flight in tracks.flights.values():
        if len(waypoints := tracks.planned(flight)) > 1:
            mark = _mark(planned, f"Planned, {flight.name}", vehicle_colour(flight.system_id), opacity=0x80)
            path = np.array(waypoints)[:, [1, 0, 2]].tolist()
            for line, places in _shapes(mark, "LineString", path):
                add(line, "altitudeMode", "relativeToGround")
                add(line, "coordinates", _coordinates(places))
    for flight in tracks.flown:
        mark = _mark(flown, flight.name, vehicle_colour(flight.system_id))
        add(mark, "description", printable(in_words(flight.outcome)))
        track = add(mark, "gx:Track")
        add(track, "altitudeMode", "relativeToGround")
        rows = tracks.track(flight)
        for state, *_ in rows:
            add(track, "when", tracks.time(state.time_s))
        for state, latitude, longitude, _ in rows:
            add(track, "gx:coord", _coordinate(latitude, longitude, state.height_m).replace(",", " "))
    _write(files, document(kml).encode())


def write_geojson(
    record: RunRecord, files: tuple[Path, ...], events: Iterable[Event], epoch_s: float
) -> None:
    """Write the farm, planned waypoints, tracks with times, and readings as features of different ``kind``.

    The third coordinate of a track is the altitude above sea level; ``coordTimes`` has its times unless cut.
    """
    tracks = _Tracks(record, events, epoch_s)
    features = farm_document(tracks.farm)["features"]
    for feature in features:
        kind = "obstacle" if feature["properties"].pop("obstacle", False) else "patch"
        feature["properties"] = {"kind": kind, **feature["properties"]}
        feature["geometry"] = cut(feature["geometry"])
    for flight in tracks.flights.values():
        for number, (latitude, longitude, height_m) in enumerate(tracks.planned(flight)):
            properties = {"kind": "waypoint", **flight.numbers, "number": number, "height_m": height_m}
            features.append(_feature("Point", [longitude, latitude], properties))
    for flight in tracks.flown:
        rows = tracks.track(flight)
        times = [tracks.time(state.time_s) for state, *_ in rows]
        line = [[longitude, latitude, altitude_m] for _, latitude, longitude, altitude_m in rows]
        shape = cut({"type": "LineString", "coordinates": line})
        properties = {
            "kind": "track",
            "name": flight.name,
            **flight.numbers,
            "begin": times[0],
            "end": times[-1],
            "outcome": flight.outcome,
            **({"coordTimes": times} if shape["type"] == "LineString" else {}),
        }
        features.append({"type": "Feature", "properties": properties, "geometry": shape})
    for seen in tracks.seen:
        features += _readings(tracks, seen)
    collection = {"type": "FeatureCollection", "name": tracks.title, "features": features}
    _write(files, msgspec.json.encode(collection))


def write_csv(record: RunRecord, files: tuple[Path, ...], events: Iterable[Event], epoch_s: float) -> None:
    """Write the states of all vehicles as a table, one row per state."""
    tracks = _Tracks(record, events, epoch_s)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*_CSV, *_TOLD))
    for flight in tracks.flown:
        for state, latitude, longitude, altitude_m in tracks.track(flight):
            values = [getattr(state, name) for name in _TOLD]
            writer.writerow(
                [tracks.time(state.time_s), round(state.time_s, 3), *flight.numbers.values()]
                + [latitude, longitude, altitude_m]
                + [round(value, 4) if isinstance(value, float) else value for value in values]
            )
    _write(files, text.getvalue().encode())


def _write(files: tuple[Path, ...], content: bytes) -> None:
    with atomic_write(files[0], "wb") as stream:
        stream.write(content)


def _shapes(
    mark: ElementTree.Element, kind: str, coordinates: list[Any]
) -> Iterator[tuple[ElementTree.Element, list[Any]]]:
    """Add a shape, or its parts if it crosses 180 degrees, and yield each with its coordinates."""
    shape = cut({"type": kind, "coordinates": coordinates})
    whole = shape["type"] == kind
    parent = mark if whole else add(mark, "MultiGeometry")
    for part in [shape["coordinates"]] if whole else shape["coordinates"]:
        yield add(parent, kind), part


def _coordinates(places: Iterable[Sequence[float]]) -> str:
    return " ".join(_coordinate(latitude, longitude, height_m) for longitude, latitude, height_m in places)


def _coordinate(latitude: float, longitude: float, height_m: float) -> str:
    return f"{decimal(longitude)},{decimal(latitude)},{decimal(round(height_m, 3))}"


def _mark(parent: ElementTree.Element, name: str, colour: str, *, opacity: int = 0xFF) -> ElementTree.Element:
    """Add a placemark with a colour, which KML writes in the order opacity, blue, green, red."""
    mark = add(parent, "Placemark")
    add(mark, "name", name)
    style = add(mark, "Style")
    shown = f"{opacity:02x}{colour[5:7]}{colour[3:5]}{colour[1:3]}"
    add(add(style, "IconStyle"), "color", shown)
    line = add(style, "LineStyle")
    add(line, "color", shown)
    add(line, "width", "3")
    add(add(style, "PolyStyle"), "color", f"40{shown[2:]}")
    return mark


def _add_farm(top: ElementTree.Element, tracks: _Tracks) -> None:
    farm = tracks.farm
    folder = add(top, "Folder")
    add(folder, "name", printable(farm.name))
    shapes = [(patch.name, patch.polygon, 0.0, crop_colour(str(patch.crop))) for patch in farm.patches]
    shapes += [(it.name or "obstacle", it.polygon, it.height_m or 0.0, OBSTACLE) for it in farm.obstacles]
    for name, polygon, height_m, colour in shapes:
        corners = [
            tracks.places(shapely.get_coordinates(ring)).tolist()
            for ring in (polygon.exterior, *polygon.interiors)
        ]
        edges = [[(longitude, latitude, height_m) for latitude, longitude in ring] for ring in corners]
        for area, rings in _shapes(_mark(folder, printable(name), colour), "Polygon", edges):
            if height_m:
                add(area, "extrude", "1")
            add(area, "altitudeMode", "relativeToGround" if height_m else "clampToGround")
            for number, ring in enumerate(rings):
                edge = add(add(area, "innerBoundaryIs" if number else "outerBoundaryIs"), "LinearRing")
                add(edge, "coordinates", _coordinates(ring))


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def _readings(tracks: _Tracks, seen: Seen) -> list[dict[str, Any]]:
    """Return a feature for each reading, at the centre of its cell."""
    observations, side_m = seen.observations, tracks.farm.cell_size_m
    middles = side_m * (np.stack([observations.x, observations.y], 1) + 0.5)
    places = tracks.places(middles).tolist()
    features = []
    for k, (latitude, longitude) in enumerate(places):
        values = dict(zip(observations.fields, observations.values[k].tolist(), strict=True))
        known = {name: round(value, 6) for name, value in values.items() if value == value}
        time = tracks.time(seen.offset_s + float(observations.time_s[k]))
        properties = {"kind": "reading", "time": time, "day": int(observations.day[k]), **known}
        features.append(_feature("Point", [longitude, latitude], properties))
    return features
