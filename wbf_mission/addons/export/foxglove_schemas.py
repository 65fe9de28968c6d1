"""JSON schemas of the Foxglove messages, and of this program's messages, in exported files.

Foxglove's message schemas are the source of names and fields (docs.foxglove.dev, "foxglove schemas"). In
JSON, a time is an object of seconds and nanoseconds, and bytes are base64.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Any, TypeAlias

Schema: TypeAlias = dict[str, Any]

_PLAIN: dict[str, Schema] = {
    "number": {"type": "number"},
    "whole": {"type": "integer"},
    "count": {"type": "integer", "minimum": 0},
    "text": {"type": "string"},
    "flag": {"type": "boolean"},
    "bytes": {"type": "string", "contentEncoding": "base64"},
    "nanoseconds": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
}
_ENUMS = {
    "NumericType": "UNKNOWN UINT8 INT8 UINT16 INT16 UINT32 INT32 FLOAT32 FLOAT64",
    "LineType": "LINE_STRIP LINE_LOOP LINE_LIST",
    "SceneEntityDeletionType": "MATCHING_ID ALL",
    "PositionCovarianceType": "UNKNOWN APPROXIMATED DIAGONAL_KNOWN KNOWN",
    "LogLevel": "UNKNOWN DEBUG INFO WARNING ERROR FATAL",
}
"""Names of the values 0, 1, 2, ... of Foxglove's enumerations."""
_FIELD = re.compile(r"(?P<name>\w+)(?P<optional>\??): (?P<type>\w+)(?P<list>\[(?P<length>\d*)\])?")
_MESSAGES = {
    "time": "sec: count, nsec: nanoseconds",
    "duration": "sec: whole, nsec: nanoseconds",
    "foxglove.Vector2": "x: number, y: number",
    "foxglove.Vector3": "x: number, y: number, z: number",
    "foxglove.Point3": "x: number, y: number, z: number",
    "foxglove.Quaternion": "x: number, y: number, z: number, w: number",
    "foxglove.Pose": "position: Vector3, orientation: Quaternion",
    "foxglove.Color": "r: number, g: number, b: number, a: number",
    "foxglove.KeyValuePair": "key: text, value: text",
    "foxglove.PackedElementField": "name: text, offset: count, type: NumericType",
    "foxglove.ArrowPrimitive": (
        "pose: Pose, shaft_length: number, shaft_diameter: number, head_length: number,"
        " head_diameter: number, color: Color"
    ),
    "foxglove.CubePrimitive": "pose: Pose, size: Vector3, color: Color",
    "foxglove.SpherePrimitive": "pose: Pose, size: Vector3, color: Color",
    "foxglove.CylinderPrimitive": (
        "pose: Pose, size: Vector3, bottom_scale: number, top_scale: number, color: Color"
    ),
    "foxglove.LinePrimitive": (
        "type: LineType, pose: Pose, thickness: number, scale_invariant: flag, points: Point3[],"
        " color: Color, colors: Color[], indices: count[]"
    ),
    "foxglove.TriangleListPrimitive": (
        "pose: Pose, points: Point3[], color: Color, colors: Color[], indices: count[]"
    ),
    "foxglove.TextPrimitive": (
        "pose: Pose, billboard: flag, font_size: number, scale_invariant: flag, color: Color, text: text"
    ),
    "foxglove.ModelPrimitive": (
        "pose: Pose, scale: Vector3, color: Color, override_color: flag, url: text, media_type: text,"
        " data: bytes"
    ),
    "foxglove.SceneEntity": (
        "timestamp: time, frame_id: text, id: text, lifetime: duration, frame_locked: flag,"
        " metadata: KeyValuePair[], arrows: ArrowPrimitive[], cubes: CubePrimitive[],"
        " spheres: SpherePrimitive[], cylinders: CylinderPrimitive[], lines: LinePrimitive[],"
        " triangles: TriangleListPrimitive[], texts: TextPrimitive[], models: ModelPrimitive[]"
    ),
    "foxglove.SceneEntityDeletion": "timestamp: time, type: SceneEntityDeletionType, id: text",
    "foxglove.LocationFix": (
        "timestamp: time, frame_id: text, latitude: number, longitude: number, altitude: number,"
        " position_covariance: number[9], position_covariance_type: PositionCovarianceType,"
        " heading?: number, velocity?: Vector3, color?: Color, metadata?: KeyValuePair[]"
    ),
    "foxglove.FrameTransform": (
        "timestamp: time, parent_frame_id: text, child_frame_id: text, translation: Vector3,"
        " rotation: Quaternion"
    ),
    "foxglove.SceneUpdate": "deletions: SceneEntityDeletion[], entities: SceneEntity[]",
    "foxglove.GeoJSON": "geojson: text",
    "foxglove.Grid": (
        "timestamp: time, frame_id: text, pose: Pose, column_count: count, cell_size: Vector2,"
        " row_stride: count, cell_stride: count, fields: PackedElementField[], data: bytes"
    ),
    "foxglove.PointCloud": (
        "timestamp: time, frame_id: text, pose: Pose, point_stride: count, fields: PackedElementField[],"
        " data: bytes"
    ),
    "foxglove.Log": "timestamp: time, level: LogLevel, message: text, name: text, file: text, line: count",
    "wbf_mission.VehicleState": (
        "timestamp: time, day: whole, flight: whole, x_m: number, y_m: number, height_m: number,"
        " speed_m_s: number, heading_deg?: number, battery?: number, mode?: text, armed?: flag,"
        " item?: whole, items?: whole, phase?: text, link_quality?: number"
    ),
    "change": "vehicle: whole, points: count, outcome: text",
    "candidate": "vehicle: whole, value: number, cost: number",
    "wbf_mission.Decision": (
        "timestamp: time, event: text, reason: text, refused: text, compute_s: number, observations: count,"
        " changes: change[], candidates: candidate[]"
    ),
}
"""Fields of each message: ``?`` marks an optional field, ``[]`` a list, ``[9]`` a list of nine."""


def schemas(fields: Collection[str]) -> dict[str, Schema]:
    """Return the schemas, keyed by message name; the score message has a loss for each of the `fields`."""
    known = dict(_PLAIN)
    for name, values in _ENUMS.items():
        numbered = [{"title": value, "const": number} for number, value in enumerate(values.split())]
        known[name] = {"title": f"foxglove.{name}", "oneOf": numbered}
    messages = _MESSAGES | {
        "losses": ", ".join(f"{name}: number" for name in fields),
        "wbf_mission.Score": (
            "timestamp: time, day: whole, observations: count, score: number, losses: losses"
        ),
    }
    for title, text in messages.items():
        parts = list(_FIELD.finditer(text))
        known[title.rpartition(".")[2]] = {
            "title": title,
            "type": "object",
            "properties": {part["name"]: _type(part, known) for part in parts},
            "required": [part["name"] for part in parts if not part["optional"]],
        }
    return {title: known[title.rpartition(".")[2]] for title in messages}


def _type(field: re.Match[str], known: dict[str, Schema]) -> Schema:
    own = known[field["type"]]
    if not field["list"]:
        return own
    length = {"minItems": int(field["length"]), "maxItems": int(field["length"])} if field["length"] else {}
    return {"type": "array", "items": own, **length}
