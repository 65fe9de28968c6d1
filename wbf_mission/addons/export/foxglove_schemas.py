"""JSON schemas of the Foxglove messages that are written, and of our own messages.

Source of names and fields: Foxglove's message schemas (docs.foxglove.dev, "foxglove schemas"). In JSON a time
is an object of seconds and nanoseconds, bytes are base64.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, TypeAlias

Schema: TypeAlias = dict[str, Any]

NUMBER: Schema = {"type": "number"}
WHOLE: Schema = {"type": "integer"}
_COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
_BYTES: Schema = {"type": "string", "contentEncoding": "base64"}
_NANOSECONDS: Schema = {"type": "integer", "minimum": 0, "maximum": 999_999_999}


def message(title: str, optional: Collection[str] = (), **fields: Schema) -> Schema:
    """Return the schema of an object with these fields, all required except those in `optional`."""
    required = [name for name in fields if name not in optional]
    return {"title": title, "type": "object", "properties": fields, "required": required}


def list_of(items: Schema, **how_many: int) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": items, **how_many}


def _one_of(title: str, first: int, *names: str) -> Schema:
    values = [{"title": name, "const": number} for number, name in enumerate(names, first)]
    return {"title": title, "oneOf": values}


TIME = message("time", sec=_COUNT, nsec=_NANOSECONDS)
_DURATION = message("duration", sec=WHOLE, nsec=_NANOSECONDS)
_VECTOR = message("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
_POINT = message("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
_QUATERNION = message("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
_POSE = message("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOUR = message("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_PAIR = message("foxglove.KeyValuePair", key=TEXT, value=TEXT)
_FIELDS = list_of(
    message(
        "foxglove.PackedElementField",
        name=TEXT,
        offset=_COUNT,
        type=_one_of(
            "foxglove.NumericType",
            0,
            *("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"),
        ),
    )
)
_ARROW = message(
    "foxglove.ArrowPrimitive",
    pose=_POSE,
    shaft_length=NUMBER,
    shaft_diameter=NUMBER,
    head_length=NUMBER,
    head_diameter=NUMBER,
    color=_COLOUR,
)
_CORNERS = {"color": _COLOUR, "colors": list_of(_COLOUR), "indices": list_of(_COUNT)}
_LINE = message(
    "foxglove.LinePrimitive",
    type=_one_of("foxglove.LineType", 0, "LINE_STRIP", "LINE_LOOP", "LINE_LIST"),
    pose=_POSE,
    thickness=NUMBER,
    scale_invariant=FLAG,
    points=list_of(_POINT),
    **_CORNERS,
)
_TRIANGLES = message("foxglove.TriangleListPrimitive", pose=_POSE, points=list_of(_POINT), **_CORNERS)
_WORDS = message(
    "foxglove.TextPrimitive",
    pose=_POSE,
    billboard=FLAG,
    font_size=NUMBER,
    scale_invariant=FLAG,
    color=_COLOUR,
    text=TEXT,
)
_SHAPE = {"pose": _POSE, "size": _VECTOR, "color": _COLOUR}
_ENTITY = message(
    "foxglove.SceneEntity",
    timestamp=TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_DURATION,
    frame_locked=FLAG,
    metadata=list_of(_PAIR),
    arrows=list_of(_ARROW),
    cubes=list_of(message("foxglove.CubePrimitive", **_SHAPE)),
    spheres=list_of(message("foxglove.SpherePrimitive", **_SHAPE)),
    cylinders=list_of(
        message(
            "foxglove.CylinderPrimitive",
            pose=_POSE,
            size=_VECTOR,
            bottom_scale=NUMBER,
            top_scale=NUMBER,
            color=_COLOUR,
        )
    ),
    lines=list_of(_LINE),
    triangles=list_of(_TRIANGLES),
    texts=list_of(_WORDS),
    models=list_of(
        message(
            "foxglove.ModelPrimitive",
            pose=_POSE,
            scale=_VECTOR,
            color=_COLOUR,
            override_color=FLAG,
            url=TEXT,
            media_type=TEXT,
            data=_BYTES,
        )
    ),
)
_DELETION = message(
    "foxglove.SceneEntityDeletion",
    timestamp=TIME,
    type=_one_of("foxglove.SceneEntityDeletionType", 0, "MATCHING_ID", "ALL"),
    id=TEXT,
)

_KNOWN = (
    message(
        "foxglove.LocationFix",
        ("heading", "velocity", "color", "metadata"),
        timestamp=TIME,
        frame_id=TEXT,
        latitude=NUMBER,
        longitude=NUMBER,
        altitude=NUMBER,
        position_covariance=list_of(NUMBER, minItems=9, maxItems=9),
        position_covariance_type=_one_of(
            "foxglove.PositionCovarianceType", 0, "UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"
        ),
        heading=NUMBER,
        velocity=_VECTOR,
        color=_COLOUR,
        metadata=list_of(_PAIR),
    ),
    message(
        "foxglove.FrameTransform",
        timestamp=TIME,
        parent_frame_id=TEXT,
        child_frame_id=TEXT,
        translation=_VECTOR,
        rotation=_QUATERNION,
    ),
    message("foxglove.SceneUpdate", deletions=list_of(_DELETION), entities=list_of(_ENTITY)),
    message("foxglove.GeoJSON", geojson=TEXT),
    message(
        "foxglove.Grid",
        timestamp=TIME,
        frame_id=TEXT,
        pose=_POSE,
        column_count=_COUNT,
        cell_size=message("foxglove.Vector2", x=NUMBER, y=NUMBER),
        row_stride=_COUNT,
        cell_stride=_COUNT,
        fields=_FIELDS,
        data=_BYTES,
    ),
    message(
        "foxglove.PointCloud",
        timestamp=TIME,
        frame_id=TEXT,
        pose=_POSE,
        point_stride=_COUNT,
        fields=_FIELDS,
        data=_BYTES,
    ),
    message(
        "foxglove.Log",
        timestamp=TIME,
        level=_one_of("foxglove.LogLevel", 0, "UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
        message=TEXT,
        name=TEXT,
        file=TEXT,
        line=_COUNT,
    ),
)
_STATE = ("heading_deg", "battery", "mode", "armed", "item", "items", "phase", "link_quality")
_OWN = (
    message(
        "wbf_mission.VehicleState",
        _STATE,
        timestamp=TIME,
        day=WHOLE,
        flight=WHOLE,
        x_m=NUMBER,
        y_m=NUMBER,
        height_m=NUMBER,
        speed_m_s=NUMBER,
        heading_deg=NUMBER,
        battery=NUMBER,
        mode=TEXT,
        armed=FLAG,
        item=WHOLE,
        items=WHOLE,
        phase=TEXT,
        link_quality=NUMBER,
    ),
    message(
        "wbf_mission.Decision",
        timestamp=TIME,
        event=TEXT,
        reason=TEXT,
        refused=TEXT,
        compute_s=NUMBER,
        observations=_COUNT,
        changes=list_of(message("change", vehicle=WHOLE, points=_COUNT, outcome=TEXT)),
        candidates=list_of(message("candidate", vehicle=WHOLE, value=NUMBER, cost=NUMBER)),
    ),
)

SCHEMAS: dict[str, Schema] = {one["title"]: one for one in (*_KNOWN, *_OWN)}
"""Schemas by message name."""


def score_schema(fields: Collection[str]) -> Schema:
    """Return the schema of our score message, with one loss per field."""
    return message(
        "wbf_mission.Score",
        timestamp=TIME,
        day=WHOLE,
        observations=_COUNT,
        score=NUMBER,
        losses=message("losses", **dict.fromkeys(fields, NUMBER)),
    )
