"""Exports a run to an MCAP file for Foxglove: map, scene, layers, readings, plots and log over time.

Messages are JSON with the schemas of `wbf_mission.addons.export.foxglove_schemas`. The frame ``farm`` is the
frame of the farm: metres along its x and y axes (east and north, unless the farm is rotated) and above home.
"""

from __future__ import annotations

import base64
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from geo.atomic import atomic_write
from geo.frame import quaternion_of
from geo.geojson import farm_document
from geo.imports import load_extra
from wbf_mission import events
from wbf_mission.addons.base.antimeridian import cut
from wbf_mission.addons.base.plots import fence_rings, rgb
from wbf_mission.addons.export import scene
from wbf_mission.addons.export.foxglove_schemas import schemas
from wbf_mission.version import __version__

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

FARM = "farm"
"""Frame of all fixed objects."""
_LEVELS = (5, 5, 5, 4, 3, 2, 2, 1)  # Values of foxglove.LogLevel, indexed by MAV_SEVERITY.
_FLOAT, _BYTE = 7, 1  # Values of foxglove.NumericType.
_STRIP, _LOOP = 0, 1  # Values of foxglove.LineType.
_NOWHERE = {"x": 0.0, "y": 0.0, "z": 0.0}
_LEVEL = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_POSE = {"position": _NOWHERE, "orientation": _LEVEL}

_PRIMITIVES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
_COLOURS = ("red", "green", "blue", "alpha")
_PIXEL = np.dtype([("value", "<f4"), *((name, "u1") for name in _COLOURS)])
_LEAST_STEP_M = 0.05

_Json = dict[str, Any]


@dataclass(slots=True)
class _Vehicle:
    """Drawing state of a vehicle during a flight."""

    flight: tuple[int, int]
    track: list[tuple[float, float, float]] = field(default_factory=list)
    shown: int = 0  # Number of track points that are already drawn.
    yaw_rad: float = 0.0


class FoxgloveFile(scene.Scene):
    """An MCAP file of a run, in compressed chunks; `finish` writes the indexes and statistics."""

    def __init__(self, stream: IO[bytes], record: RunRecord, epoch_s: float) -> None:
        super().__init__(record)
        self._writer = load_extra("mcap.writer", "mcap", "files of Foxglove need", scene.ExportError).Writer(
            stream
        )
        self._writer.start(library=f"wbf-mission {__version__}")
        self._epoch_ns = round(epoch_s * 1e6) * 1000
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._known = schemas(record.fields.names)
        self._counts: Counter[str] = Counter()
        self._vehicles: dict[int, _Vehicle] = {}
        states = max((len(flight.track.time_s) for flight in record.flights), default=0)
        self._states_a_show = max(1, states // scene.SHOWN_AGAIN)
        names = [*"xyz", *(f"{field.name}_value" for field in record.fields)]
        self._reading = np.dtype([*((name, "<f4") for name in names), *((name, "u1") for name in _COLOURS)])

    def finish(self) -> None:
        """Write indexes and statistics."""
        self._writer.finish()

    def _write(self, topic: str, schema: str, time_s: float, message: _Json) -> None:
        if topic not in self._channels:
            if schema not in self._schemas:
                text = msgspec.json.encode(self._known[schema])
                self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", text)
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema])
        self._counts[topic] += 1
        at_ns = self._at_ns(time_s)
        data = msgspec.json.encode(message)
        self._writer.add_message(self._channels[topic], at_ns, data, at_ns, self._counts[topic])

    def _at_ns(self, time_s: float) -> int:
        return self._epoch_ns + round(time_s * 1e9)

    def _time(self, time_s: float) -> _Json:
        seconds, nanoseconds = divmod(self._at_ns(time_s), 10**9)
        return {"sec": seconds, "nsec": nanoseconds}

    def _say(self, time_s: float, severity: int, name: str, text: str) -> None:
        level = _LEVELS[min(max(severity, 0), len(_LEVELS) - 1)]
        line = {"level": level, "message": text, "name": name, "file": "", "line": 0}
        self._write("/log", "foxglove.Log", time_s, {"timestamp": self._time(time_s), **line})

    def _write_scene(self, topic: str, time_s: float, **entity: Any) -> None:
        """Write a scene that replaces the previous scene on the same topic."""
        parts: _Json = dict.fromkeys(_PRIMITIVES, ()) | {
            "frame_id": FARM,
            "frame_locked": True,
            "metadata": (),
        }
        parts |= {"timestamp": self._time(time_s), "lifetime": {"sec": 0, "nsec": 0}, "id": topic}
        self._write(topic, "foxglove.SceneUpdate", time_s, {"deletions": [], "entities": [parts | entity]})

    def _write_map(self, topic: str, time_s: float, features: Iterable[_Json]) -> None:
        shown = [{**feature, "geometry": cut(feature["geometry"])} for feature in features]
        text = msgspec.json.encode({"type": "FeatureCollection", "features": shown}).decode()
        self._write(topic, "foxglove.GeoJSON", time_s, {"geojson": text})

    def _begin(self, event: events.RunBegun) -> None:
        farm = self.farm
        colours = [scene.crop_colour(patch.crop) for patch in farm.patches]
        colours += [scene.OBSTACLE] * len(farm.obstacles)
        features = farm_document(farm)["features"]
        for feature, colour in zip(features, colours, strict=True):
            feature["properties"]["style"] = {"color": colour}
        places = [("home", farm.home_m), *(("rally point", place) for place in farm.rally_m)]
        features += [_feature("Point", farm, [place], name=name) for name, place in places]
        self._write_map("/farm/map", 0.0, features)
        lines = [
            _line(ring, scene.crop_colour(patch.crop), kind=_LOOP)
            for patch in farm.patches
            for ring in _rings(patch.polygon)
        ]
        walls = [
            _wall(ring, obstacle.height_m or self.size_m)
            for obstacle in farm.obstacles
            for ring in _rings(obstacle.polygon)
        ]
        self._write_scene("/farm/scene", 0.0, lines=lines, triangles=walls)
        about = {
            "title": event.title,
            "estimator": event.estimator,
            "planner": event.planner,
            "seed": event.seed,
        }
        self._writer.add_metadata("wbf_mission", {name: str(value) for name, value in about.items()})

    def _plan(self, event: events.Planned) -> None:
        farm, number, colour = self.farm, event.system_id, scene.vehicle_colour(event.system_id)
        rings = [ring for ring, _ in fence_rings(event.mission.fence, farm.frame)]
        features = [_way(farm, event.path_m, f"plan of vehicle {number}", colour)]
        features += [_way(farm, np.vstack((ring, ring[:1])), "fence", scene.FENCE) for ring in rings]
        self._write_map(f"/vehicle/{number}/plan/map", event.time_s, features)
        lines = [_line(event.path_m, colour, height_m=scene.highest_m(event.mission, farm), opacity=0.5)]
        lines += [_line(ring, scene.FENCE, kind=_LOOP) for ring in rings]
        self._write_scene(f"/vehicle/{number}/plan/scene", event.time_s, lines=lines)
        if number not in self._vehicles:
            self._write_body(event.time_s, number)
        if number not in self._vehicles or self._vehicles[number].flight != (event.day, event.flight):
            self._vehicles[number] = _Vehicle((event.day, event.flight))

    def _write_body(self, time_s: float, number: int) -> None:
        """Draw a vehicle as an arrow with its number, in the frame of the vehicle."""
        size, colour = self.size_m, _colour(scene.vehicle_colour(number))
        arrow = {
            "pose": _POSE,
            "shaft_length": 0.6 * size,
            "shaft_diameter": 0.3 * size,
            "head_length": 0.6 * size,
            "head_diameter": 0.7 * size,
            "color": colour,
        }
        words = {
            "pose": {"position": _point(0.0, 0.0, size), "orientation": _LEVEL},
            "billboard": True,
            "font_size": size,
            "scale_invariant": False,
            "color": colour,
            "text": str(number),
        }
        frame = f"vehicle {number}"
        self._write_scene(f"/vehicle/{number}/body", time_s, frame_id=frame, arrows=[arrow], texts=[words])

    def _move(self, event: events.VehicleMoved) -> None:
        farm, number = self.farm, event.system_id
        vehicle = self._vehicles.setdefault(number, _Vehicle((event.day, event.flight)))
        place = (event.x_m, event.y_m, event.height_m)
        if event.heading_rad is not None:
            vehicle.yaw_rad = 0.5 * math.pi - event.heading_rad - math.radians(farm.frame.rotation_deg)
        elif vehicle.track and math.dist(place[:2], vehicle.track[-1][:2]) > _LEAST_STEP_M:
            # Without a heading, the vehicle points along its track.
            before = vehicle.track[-1]
            vehicle.yaw_rad = math.atan2(place[1] - before[1], place[0] - before[0])
        vehicle.track.append(place)
        timestamp, frame = self._time(event.time_s), f"vehicle {number}"
        w, x, y, z = quaternion_of(0.0, 0.0, vehicle.yaw_rad)
        turned = {
            "timestamp": timestamp,
            "parent_frame_id": FARM,
            "child_frame_id": frame,
            "translation": _point(*place),
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        }
        self._write("/tf", "foxglove.FrameTransform", event.time_s, turned)
        latitude, longitude = farm.frame.to_wgs84(event.x_m, event.y_m)
        fix = {
            "timestamp": timestamp,
            "frame_id": frame,
            "latitude": round(latitude, 8),
            "longitude": round(longitude, 8),
            "altitude": round(farm.frame.altitude_m + event.height_m, 3),
            "position_covariance": [0.0] * 9,
            "position_covariance_type": 0,
            "color": _colour(scene.vehicle_colour(number)),
        }
        self._write(f"/vehicle/{number}/fix", "foxglove.LocationFix", event.time_s, fix)
        heading = None if event.heading_rad is None else round(math.degrees(event.heading_rad), 2)
        state = {
            "timestamp": timestamp,
            "day": event.day,
            "flight": event.flight,
            "x_m": round(event.x_m, 3),
            "y_m": round(event.y_m, 3),
            "height_m": round(event.height_m, 3),
            "speed_m_s": round(event.speed_m_s, 3),
            "heading_deg": heading,
            "battery": event.battery,
            "mode": event.mode or None,
            "armed": event.armed if event.mode else None,
            "item": event.item,
            "items": event.items,
            "phase": event.phase or None,
            "link_quality": event.link_quality,
        }
        known = {name: value for name, value in state.items() if value is not None}
        self._write(f"/vehicle/{number}/state", "wbf_mission.VehicleState", event.time_s, known)
        if len(vehicle.track) - vehicle.shown >= self._states_a_show:
            self._write_track(event.time_s, number)

    def _land(self, event: events.FlightEnded) -> None:
        self._write_track(event.time_s, event.system_id)

    def _write_track(self, time_s: float, number: int) -> None:
        """Draw the track of a vehicle's current flight until now."""
        vehicle = self._vehicles.get(number)
        if vehicle is None or len(vehicle.track) < 2:
            return
        vehicle.shown, colour = len(vehicle.track), scene.vehicle_colour(number)
        step = -(-len(vehicle.track) // scene.TRACK_POINTS)
        flown = np.array(vehicle.track[::step] + vehicle.track[-1:])
        self._write_scene(
            f"/vehicle/{number}/track/scene", time_s, lines=[_line(flown, colour, thickness=3.0)]
        )
        track = _way(self.farm, flown, f"track of vehicle {number}", colour)
        self._write_map(f"/vehicle/{number}/track/map", time_s, [track])

    def _show_readings(
        self,
        time_s: float,
        places_m: NDArray[np.float64],
        values: NDArray[np.float32],
        colours: scene.Colours,
    ) -> None:
        rows = np.zeros(len(values), self._reading)
        rows["x"], rows["y"] = places_m.T
        for k, name in enumerate(self.fields.names):
            rows[f"{name}_value"] = values[:, k]
        for part, name in enumerate(_COLOURS):
            rows[name] = colours[:, part]
        cloud = {
            "timestamp": self._time(time_s),
            "frame_id": FARM,
            "pose": _POSE,
            "point_stride": self._reading.itemsize,
            "fields": _packed(self._reading),
            "data": base64.b64encode(rows.tobytes()).decode(),
        }
        self._write("/readings", "foxglove.PointCloud", time_s, cloud)

    def _score(self, event: events.Estimated) -> None:
        if event.score is not None:
            score = {
                "timestamp": self._time(event.time_s),
                "day": event.day,
                "observations": event.observations,
                "score": event.score.score,
                "losses": dict(zip(event.score.fields, event.score.field_loss, strict=True)),
            }
            self._write("/score", "wbf_mission.Score", event.time_s, score)

    def _show_layer(self, time_s: float, name: str, means: scene.Pixels, colours: scene.Colours) -> None:
        # Foxglove's grid begins with the bottom row; each row goes from left to right.
        width, height = means.shape
        rows = np.zeros((height, width), _PIXEL)
        rows["value"] = means.T
        for part, colour in enumerate(_COLOURS):
            rows[colour] = colours[..., part].T
        grid = {
            "timestamp": self._time(time_s),
            "frame_id": FARM,
            "pose": _POSE,
            "column_count": width,
            "cell_size": {"x": self.pixel_m, "y": self.pixel_m},
            "row_stride": width * _PIXEL.itemsize,
            "cell_stride": _PIXEL.itemsize,
            "fields": _packed(_PIXEL),
            "data": base64.b64encode(rows.tobytes()).decode(),
        }
        self._write(f"/layers/{name}", "foxglove.Grid", time_s, grid)

    def _decide(self, event: events.Decided) -> None:
        record = event.record
        decision = {
            "timestamp": self._time(event.time_s),
            "event": record.event,
            "reason": record.reason,
            "refused": record.refused,
            "compute_s": record.compute_s,
            "observations": record.observations,
            "changes": [
                {"vehicle": change.system_id, "points": len(change.path_m), "outcome": change.outcome}
                for change in record.changes
            ],
            "candidates": [
                {"vehicle": alternative.system_id, "value": alternative.value, "cost": alternative.cost}
                for alternative in record.alternatives
            ],
        }
        self._write("/decision", "wbf_mission.Decision", event.time_s, decision)


def _point(x: float, y: float, z: float) -> _Json:
    return {"x": round(x, 3), "y": round(y, 3), "z": round(z, 3)}


def _points(points: NDArray[np.float64], height_m: float) -> list[_Json]:
    """Return points, float64[n, 2 or 3], as JSON; 2D points get the height `height_m`."""
    return [_point(point[0], point[1], point[2] if len(point) > 2 else height_m) for point in points.tolist()]


def _colour(colour: str, opacity: float = 1.0) -> _Json:
    red, green, blue = (part / 255 for part in rgb(colour))
    return {"r": round(red, 4), "g": round(green, 4), "b": round(blue, 4), "a": opacity}


def _line(
    points: NDArray[np.float64],
    colour: str,
    *,
    kind: int = _STRIP,
    height_m: float = 0.0,
    thickness: float = 2.0,
    opacity: float = 1.0,
) -> _Json:
    return {
        "type": kind,
        "pose": _POSE,
        "thickness": thickness,
        "scale_invariant": True,
        "points": _points(points, height_m),
        "color": _colour(colour, opacity),
        "colors": [],
        "indices": [],
    }


def _wall(ring: NDArray[np.float64], height_m: float) -> _Json:
    """Return a vertical wall along a ring, made of two triangles per edge."""
    count = len(ring)
    edges = [(k, (k + 1) % count) for k in range(count)]
    corners = [(a, b, a + count, b, b + count, a + count) for a, b in edges]
    return {
        "pose": _POSE,
        "points": _points(ring, 0.0) + _points(ring, height_m),
        "color": _colour(scene.OBSTACLE, 0.5),
        "colors": [],
        "indices": [number for corner in corners for number in corner],
    }


def _rings(polygon: shapely.Polygon) -> list[NDArray[np.float64]]:
    """Return the rings of a polygon (outline and holes) without the closing point."""
    return [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def _feature(kind: str, farm: Farm, points_m: Any, **properties: object) -> _Json:
    places = np.round(scene.places_of(farm, np.asarray(points_m, np.float64))[:, ::-1], 8).tolist()
    geometry = {"type": kind, "coordinates": places[0] if kind == "Point" else places}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _way(farm: Farm, points_m: NDArray[np.float64], name: str, colour: str) -> _Json:
    return _feature("LineString", farm, points_m, name=name, style={"color": colour})


def _packed(layout: np.dtype[np.void]) -> list[_Json]:
    """Return the fields of a packed numpy type in Foxglove's form: name, offset and type."""
    assert layout.names is not None and layout.fields is not None
    parts = {name: layout.fields[name][:2] for name in layout.names}
    return [
        {"name": name, "offset": offset, "type": _FLOAT if kind.itemsize == 4 else _BYTE}
        for name, (kind, offset) in parts.items()
    ]


def write_mcap(
    record: RunRecord, files: tuple[Path, ...], run_events: Iterable[events.Event], epoch_s: float
) -> None:
    """Write the events of a finished run as an MCAP file, with a Foxglove layout beside it."""
    path, layout = files
    with atomic_write(path, "wb") as stream:
        file = FoxgloveFile(stream, record, epoch_s)
        for event in run_events:
            file.take(event)
        file.finish()
    with atomic_write(layout, "wb") as stream:
        stream.write(msgspec.json.format(msgspec.json.encode(layout_of(record))))


def layout_of(result: RunRecord) -> _Json:
    """Return a Foxglove layout for a run, with panels for map, scene, plots and log."""
    farm, numbers = result.farm, sorted({flight.system_id for flight in result.flights})
    width_m, height_m = farm.width_cells * farm.cell_size_m, farm.height_cells * farm.cell_size_m
    shown = [f"/layers/{result.fields[0].name}/estimate", "/farm/scene", "/readings"]
    shown += [
        f"/vehicle/{number}/{what}" for number in numbers for what in ("body", "plan/scene", "track/scene")
    ]
    view = {
        "cameraState": {
            "perspective": True,
            "distance": 1.3 * max(width_m, height_m),
            "phi": 35.0,
            "thetaOffset": 0.0,
            "target": [0.0, 0.0, 0.0],
            "targetOffset": [0.5 * width_m, 0.5 * height_m, 0.0],
            "targetOrientation": [0.0, 0.0, 0.0, 1.0],
            "fovy": 45.0,
            "near": 0.5,
            "far": 20.0 * max(width_m, height_m),
        },
        "followMode": "follow-none",
        "followTf": FARM,
        "scene": {"transforms": {"visible": False}},
        "topics": {topic: {"visible": True} for topic in shown},
    }
    plots = {
        "score": ["/score.score"],
        "height, speed": [
            f"/vehicle/{number}/state.{what}" for number in numbers for what in ("height_m", "speed_m_s")
        ],
        "battery": [f"/vehicle/{number}/state.battery" for number in numbers],
    }
    panels: dict[str, _Json] = {
        "3D!farm": view,
        "map!farm": {"layer": "map", "zoomLevel": 17, "followTopic": f"/vehicle/{numbers[0]}/fix"},
        "RosOut!log": {"topicToRender": "/log"},
    }
    for title, paths in plots.items():
        series = [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths]
        panels[f"Plot!{title}"] = {"title": title, "paths": series, "isSynced": True, "xAxisVal": "timestamp"}
    first, second, third = (f"Plot!{title}" for title in plots)
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split(
            "row",
            60,
            _split("column", 70, "3D!farm", "RosOut!log"),
            _split(
                "column", 40, "map!farm", _split("column", 34, first, _split("column", 50, second, third))
            ),
        ),
    }


def _split(direction: str, percent: float, first: object, second: object) -> _Json:
    return {"direction": direction, "splitPercentage": percent, "first": first, "second": second}
