"""Export to an MCAP file for Foxglove: map, scene, layers, readings, plots and log on one time line.

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
from mission.outcome import in_words
from sensors.fields import FieldSet
from wbf_mission import events
from wbf_mission.addons.base.fence_rings import fence_rings
from wbf_mission.addons.export import style
from wbf_mission.addons.export.foxglove_schemas import SCHEMAS, score_schema
from wbf_mission.addons.export.layers import Layers, reading_colours
from wbf_mission.addons.export.rerun import ExportError
from wbf_mission.addons.export.tracks import highest_m
from wbf_mission.version import __version__

if TYPE_CHECKING:
    from wbf_mission.run.record import RunRecord

FARM = "farm"
"""Frame of all fixed objects."""
_LEVELS = (5, 5, 5, 4, 3, 2, 2, 1)  # foxglove.LogLevel by MAV_SEVERITY
_INFO, _WARNING = 2, 3
_FLOAT, _BYTE = 7, 1  # foxglove.NumericType
_STRIP, _LOOP = 0, 1  # foxglove.LineType
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
    """State of a vehicle's display during a flight."""

    flight: tuple[int, int]
    track: list[tuple[float, float, float]] = field(default_factory=list)
    shown: int = 0  # Track points already shown
    yaw_rad: float = 0.0


class FoxgloveFile:
    """Writer of a finished run's events to an open MCAP file; `finish` completes the file.

    Parameters
    ----------
    stream : binary file
        Open file to write: compressed chunks with indexes and statistics.
    record : RunRecord
        The run; sets the colour scales of the layers.
    epoch_s : float
        Time of day at the start of the run (s since 1970).
    """

    def __init__(self, stream: IO[bytes], record: RunRecord, epoch_s: float) -> None:
        self._writer = load_extra("mcap.writer", "mcap", "files of Foxglove need", ExportError).Writer(stream)
        self._writer.start(library=f"wbf-mission {__version__}")
        self._epoch_ns = round(epoch_s * 1e6) * 1000
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._known = SCHEMAS | {"wbf_mission.Score": score_schema(record.fields.names)}
        self._counts: Counter[str] = Counter()
        self._farm, self._fields, self._layers = record.farm, record.fields, Layers(record)
        self._size_m = style.vehicle_size_m(self._farm)
        self._vehicles: dict[int, _Vehicle] = {}
        states = max((len(flight.track.time_s) for flight in record.flights), default=0)
        self._states_a_show = max(1, states // style.SHOWN_AGAIN)
        self._points: list[bytes] = []
        self._readings_a_show = max(1, len(record.observations) // style.SHOWN_AGAIN)
        self._readings = 0

    def take(self, event: events.Event) -> None:
        """Write an event."""
        match event:
            case events.RunBegun():
                self._write_farm(event)
            case events.DayBegun():
                self._points = []
                if event.truth is not None:
                    self._write_layers(event.time_s, "truth", event.truth)
            case events.Planned():
                self._write_plan(event)
            case events.VehicleMoved():
                self._write_state(event)
            case events.VehicleSaid():
                level = _LEVELS[min(max(event.severity, 0), len(_LEVELS) - 1)]
                self._log(event.time_s, level, f"vehicle {event.system_id}", event.text)
            case events.Seen():
                self._add_readings(event)
            case events.Estimated():
                self._write_estimate(event)
            case events.Decided():
                self._write_decision(event)
            case events.FlightEnded():
                self._write_track(event.time_s, event.system_id)
                self._end(event.time_s, f"vehicle {event.system_id}", event.outcome, event.reason)
            case events.RunEnded():
                self._write_readings(event.time_s)
                self._end(event.time_s, "run", event.outcome, event.reason)
            case _:
                pass

    def finish(self) -> None:
        """Write indexes and statistics."""
        self._writer.finish()

    # --- Messages ---

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

    def _log(self, time_s: float, level: int, name: str, text: str) -> None:
        line = {"level": level, "message": text, "name": name, "file": "", "line": 0}
        self._write("/log", "foxglove.Log", time_s, {"timestamp": self._time(time_s), **line})

    def _end(self, time_s: float, name: str, outcome: str, reason: str) -> None:
        self._log(time_s, _INFO, name, in_words(outcome, reason))

    def _write_scene(self, topic: str, time_s: float, **entity: Any) -> None:
        """Write a scene that replaces the previous scene of the topic."""
        parts: _Json = dict.fromkeys(_PRIMITIVES, ()) | {
            "frame_id": FARM,
            "frame_locked": True,
            "metadata": (),
        }
        parts |= {"timestamp": self._time(time_s), "lifetime": {"sec": 0, "nsec": 0}, "id": topic}
        self._write(topic, "foxglove.SceneUpdate", time_s, {"deletions": [], "entities": [parts | entity]})

    def _write_map(self, topic: str, time_s: float, features: Iterable[_Json]) -> None:
        text = msgspec.json.encode({"type": "FeatureCollection", "features": list(features)}).decode()
        self._write(topic, "foxglove.GeoJSON", time_s, {"geojson": text})

    # --- Fixed objects ---

    def _write_farm(self, event: events.RunBegun) -> None:
        farm = self._farm
        colours = [style.crop_colour(patch.crop) for patch in farm.patches]
        colours += [style.OBSTACLE] * len(farm.obstacles)
        features = farm_document(farm)["features"]
        for feature, colour in zip(features, colours, strict=True):
            feature["properties"]["style"] = {"color": colour}
        places = [("home", farm.home_m), *(("rally point", place) for place in farm.rally_m)]
        features += [_feature("Point", farm, [place], name=name) for name, place in places]
        self._write_map("/farm/map", 0.0, features)
        lines = [
            _line(ring, style.crop_colour(patch.crop), kind=_LOOP)
            for patch in farm.patches
            for ring in _rings(patch.polygon)
        ]
        walls = [
            _wall(ring, obstacle.height_m or self._size_m)
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
        self._writer.add_metadata("wbf_mission", {name: str(one) for name, one in about.items()})
        self._log(0.0, _INFO, "run", event.title)

    def _write_plan(self, event: events.Planned) -> None:
        farm, number, colour = self._farm, event.system_id, style.vehicle_colour(event.system_id)
        rings = [ring for ring, _ in fence_rings(event.mission.fence, farm.frame)]
        features = [_way(farm, event.path_m, f"plan of vehicle {number}", colour)]
        features += [_way(farm, np.vstack((ring, ring[:1])), "fence", style.FENCE) for ring in rings]
        self._write_map(f"/vehicle/{number}/plan/map", event.time_s, features)
        lines = [_line(event.path_m, colour, height_m=highest_m(event.mission, farm), opacity=0.5)]
        lines += [_line(ring, style.FENCE, kind=_LOOP) for ring in rings]
        self._write_scene(f"/vehicle/{number}/plan/scene", event.time_s, lines=lines)
        if number not in self._vehicles:
            self._write_body(event.time_s, number)
        if number not in self._vehicles or self._vehicles[number].flight != (event.day, event.flight):
            self._vehicles[number] = _Vehicle((event.day, event.flight))

    # --- Vehicles ---

    def _write_body(self, time_s: float, number: int) -> None:
        """Draw a vehicle as an arrow with its number, in the vehicle's own frame."""
        size, colour = self._size_m, _colour(style.vehicle_colour(number))
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

    def _write_state(self, event: events.VehicleMoved) -> None:
        farm, number = self._farm, event.system_id
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
            "color": _colour(style.vehicle_colour(number)),
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
        told = {name: one for name, one in state.items() if one is not None}
        self._write(f"/vehicle/{number}/state", "wbf_mission.VehicleState", event.time_s, told)
        if len(vehicle.track) - vehicle.shown >= self._states_a_show:
            self._write_track(event.time_s, number)

    def _write_track(self, time_s: float, number: int) -> None:
        """Draw the track of a vehicle's current flight up to now."""
        vehicle = self._vehicles.get(number)
        if vehicle is None or len(vehicle.track) < 2:
            return
        vehicle.shown, colour = len(vehicle.track), style.vehicle_colour(number)
        step = -(-len(vehicle.track) // style.TRACK_POINTS)
        flown = np.array(vehicle.track[::step] + vehicle.track[-1:])
        self._write_scene(
            f"/vehicle/{number}/track/scene", time_s, lines=[_line(flown, colour, thickness=3.0)]
        )
        track = _way(self._farm, flown, f"track of vehicle {number}", colour)
        self._write_map(f"/vehicle/{number}/track/map", time_s, [track])

    # --- Readings, estimates and decisions ---

    def _add_readings(self, event: events.Seen) -> None:
        observations = event.observations
        rows = np.zeros(len(observations), _reading(self._fields))
        rows["x"] = self._farm.cell_size_m * (observations.x + 0.5)
        rows["y"] = self._farm.cell_size_m * (observations.y + 0.5)
        for k, one in enumerate(self._fields):
            rows[f"{one.name}_value"] = observations.values[:, k]
        painted = reading_colours(self._fields, observations.values)
        for part, name in enumerate(_COLOURS):
            rows[name] = painted[:, part]
        self._points.append(rows.tobytes())
        self._readings += len(rows)
        if self._readings >= self._readings_a_show:
            self._write_readings(event.offset_s + float(observations.time_s.max()))

    def _write_readings(self, time_s: float) -> None:
        """Write all readings of the current day."""
        self._readings = 0
        layout = _reading(self._fields)
        cloud = {
            "timestamp": self._time(time_s),
            "frame_id": FARM,
            "pose": _POSE,
            "point_stride": layout.itemsize,
            "fields": _packed(layout),
            "data": base64.b64encode(b"".join(self._points)).decode(),
        }
        self._write("/readings", "foxglove.PointCloud", time_s, cloud)

    def _write_estimate(self, event: events.Estimated) -> None:
        if event.score is not None:
            score = {
                "timestamp": self._time(event.time_s),
                "day": event.day,
                "observations": event.observations,
                "score": event.score.score,
                "losses": dict(zip(event.score.fields, event.score.field_loss, strict=True)),
            }
            self._write("/score", "wbf_mission.Score", event.time_s, score)
        if event.model is not None:
            self._write_layers(event.time_s, "estimate", event.model.value)
            self._write_layers(event.time_s, "uncertainty", event.model.uncertainty)

    def _write_layers(self, time_s: float, what: str, values: NDArray[np.float32]) -> None:
        """Write one layer per field."""
        layers = self._layers
        for k, one in enumerate(self._fields):
            means = layers.means(k, values[k])
            colours = layers.uncertainty_colours if what == "uncertainty" else layers.colours
            # Foxglove's grid rows run from the bottom up, each from left to right.
            width, height = means.shape
            rows = np.zeros((height, width), _PIXEL)
            rows["value"] = means.T
            painted = colours(k, means)
            for part, name in enumerate(_COLOURS):
                rows[name] = painted[..., part].T
            grid = {
                "timestamp": self._time(time_s),
                "frame_id": FARM,
                "pose": _POSE,
                "column_count": width,
                "cell_size": {"x": layers.pixel_m, "y": layers.pixel_m},
                "row_stride": width * _PIXEL.itemsize,
                "cell_stride": _PIXEL.itemsize,
                "fields": _packed(_PIXEL),
                "data": base64.b64encode(rows.tobytes()).decode(),
            }
            self._write(f"/layers/{one.name}/{what}", "foxglove.Grid", time_s, grid)

    def _write_decision(self, event: events.Decided) -> None:
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
        said = record.refused or record.reason
        if said:
            self._log(event.time_s, _WARNING if record.refused else _INFO, "policy", said)


def _point(x: float, y: float, z: float) -> _Json:
    return {"x": round(x, 3), "y": round(y, 3), "z": round(z, 3)}


def _points(points: NDArray[np.float64], height_m: float) -> list[_Json]:
    """Return points, float64[n, 2 or 3], as JSON; 2D points get the height `height_m`."""
    return [_point(point[0], point[1], point[2] if len(point) > 2 else height_m) for point in points.tolist()]


def _colour(colour: str, opacity: float = 1.0) -> _Json:
    red, green, blue = (part / 255 for part in style.rgb(colour))
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
    """Return a vertical wall over a ring: two triangles per edge."""
    count = len(ring)
    edges = [(k, (k + 1) % count) for k in range(count)]
    corners = [(a, b, a + count, b, b + count, a + count) for a, b in edges]
    return {
        "pose": _POSE,
        "points": _points(ring, 0.0) + _points(ring, height_m),
        "color": _colour(style.OBSTACLE, 0.5),
        "colors": [],
        "indices": [number for corner in corners for number in corner],
    }


def _rings(polygon: shapely.Polygon) -> list[NDArray[np.float64]]:
    """Return the rings of a polygon (outline and holes) without the closing point."""
    return [shapely.get_coordinates(one)[:-1] for one in (polygon.exterior, *polygon.interiors)]


def _feature(kind: str, farm: Farm, points_m: Any, **properties: object) -> _Json:
    places = np.round(style.places_of(farm, np.asarray(points_m, np.float64))[:, ::-1], 8).tolist()
    geometry = {"type": kind, "coordinates": places[0] if kind == "Point" else places}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _way(farm: Farm, points_m: NDArray[np.float64], name: str, colour: str) -> _Json:
    return _feature("LineString", farm, points_m, name=name, style={"color": colour})


def _reading(fields: FieldSet) -> np.dtype[np.void]:
    """Return the packed layout of a reading."""
    names = [*"xyz", *(f"{one.name}_value" for one in fields)]
    return np.dtype([*((name, "<f4") for name in names), *((name, "u1") for name in _COLOURS)])


def _packed(layout: np.dtype[np.void]) -> list[_Json]:
    """Return a packed layout as Foxglove's list of fields."""
    assert layout.names is not None and layout.fields is not None
    told = []
    for name in layout.names:
        kind, offset = layout.fields[name][0], layout.fields[name][1]
        told.append({"name": name, "offset": offset, "type": _FLOAT if kind.itemsize == 4 else _BYTE})
    return told


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
    """Return a Foxglove layout for a run: map, scene, plots and log panels."""
    farm, numbers = result.farm, sorted({flight.system_id for flight in result.flights})
    width_m, height_m = farm.width_cells * farm.cell_size_m, farm.height_cells * farm.cell_size_m
    shown = [f"/layers/{result.fields[0].name}/estimate", "/farm/scene", "/readings"]
    shown += [
        f"/vehicle/{number}/{what}" for number in numbers for what in ("body", "plan/scene", "track/scene")
    ]
    scene = {
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
        "3D!farm": scene,
        "map!farm": {"layer": "map", "zoomLevel": 17, "followTopic": f"/vehicle/{numbers[0]}/fix"},
        "RosOut!log": {"topicToRender": "/log"},
    }
    for title, paths in plots.items():
        series = [{"value": path, "enabled": True, "timestampMethod": "receiveTime"} for path in paths]
        panels[f"Plot!{title}"] = {"title": title, "paths": series, "isSynced": True, "xAxisVal": "timestamp"}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split(
            "row",
            60,
            _split("column", 70, "3D!farm", "RosOut!log"),
            _split("column", 40, "map!farm", _split("column", 34, *_plots(plots))),
        ),
    }


def _split(direction: str, percent: float, first: object, second: object) -> _Json:
    return {"direction": direction, "splitPercentage": percent, "first": first, "second": second}


def _plots(titles: Iterable[str]) -> tuple[object, object]:
    first, second, third = (f"Plot!{title}" for title in titles)
    return first, _split("column", 50, second, third)
