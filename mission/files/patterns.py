"""Landing patterns and structure scans: complex items of QGroundControl plans that store no commands.

QGroundControl generates the commands of these items when it loads a plan. This module generates the same
commands from the keys of the items. Sources: QGroundControl, src/MissionManager: LandingComplexItem,
FixedWingLandingComplexItem (versions 1 and 2), VTOLLandingComplexItem, StructureScanComplexItem (version 3),
QGCMapPolygon::offset, CameraSection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias, TypeVar

import msgspec
import numpy as np

from geo.frame import LocalFrame
from mission.errors import MissionError, MissionFileError
from mission.model import Command, Frame, check_place

T = TypeVar("T")
Values: TypeAlias = tuple[float | None, ...]
Step: TypeAlias = tuple[int, int, Values]
"""A command, its frame, and its seven parameters."""

_VTOL_LAND, _ROI_OFFSET = 85, 196
_VIDEO_STOP = 2501
_NOTHING: Values = (0.0,) * 7
_PLAIN: Values = (0.0, 0.0, 0.0, None)  # a waypoint without hold, with default radius and heading
_UNSET: Values = (0.0, *(None,) * 6)
_Place = tuple[float, float, float] | None


class Camera(msgspec.Struct):
    """The ``CameraCalc`` of a structure scan, in metres."""

    side_m: float = msgspec.field(name="AdjustedFootprintSide")
    frontal_m: float = msgspec.field(name="AdjustedFootprintFrontal")
    distance_m: float = msgspec.field(name="DistanceToSurface")


class Pattern(msgspec.Struct, rename="camel"):
    """Keys of landing patterns and structure scans; a missing key is None."""

    version: int | None = None
    # Landing patterns.
    landing_approach_coordinate: _Place = None
    loiter_coordinate: _Place = None
    land_coordinate: _Place = None
    loiter_radius: float | None = None
    loiter_clockwise: bool | None = None
    use_loiter_to_alt: bool | None = None
    altitudes_are_relative: bool | None = None
    loiter_altitude_relative: bool | None = None
    land_altitude_relative: bool | None = None
    stop_taking_photos: bool | None = None
    stop_video_photos: bool | None = None
    use_do_change_speed: bool | None = None
    final_approach_speed: float | None = None
    # Structure scans.
    polygon: list[tuple[float, float]] | None = None
    entrance_altitude: float | None = msgspec.field(default=None, name="EntranceAltitude")
    scan_bottom_alt: float | None = msgspec.field(default=None, name="ScanBottomAlt")
    structure_height: float | None = msgspec.field(default=None, name="StructureHeight")
    layers: float | None = msgspec.field(default=None, name="Layers")
    gimbal_pitch: float | None = msgspec.field(default=None, name="GimbalPitch")
    start_from_top: bool | None = msgspec.field(default=None, name="StartFromTop")
    camera: Camera | None = msgspec.field(default=None, name="CameraCalc")


_KNOWN_VERSIONS = {"fwLandingPattern": (1, 2), "vtolLandingPattern": (1,), "StructureScan": (3,)}
KINDS = frozenset(_KNOWN_VERSIONS)


def commands_of(where: str, kind: str, pattern: Pattern) -> Iterator[Step]:
    """Yield the commands that QGroundControl generates for a complex item of one of the `KINDS`.

    MissionFileError names a key that is missing or impossible.
    """
    known = _KNOWN_VERSIONS[kind]
    if pattern.version not in known:
        versions = " or ".join(map(str, known))
        msg = f"{where}: {kind} of version {pattern.version}, not {versions}; save it with QGroundControl 4"
        raise MissionFileError(msg)
    if kind == "StructureScan":
        return _structure_scan(where, pattern)
    return _landing(where, pattern, is_vtol=kind == "vtolLandingPattern")


def _need(where: str, key: str, value: T | None) -> T:
    if value is None:
        raise MissionFileError(f"{where}: {key} is missing; save the plan again with QGroundControl")
    return value


def _landing(where: str, pattern: Pattern, *, is_vtol: bool) -> Iterator[Step]:
    approach = pattern.landing_approach_coordinate or pattern.loiter_coordinate
    approach = _need(where, "landingApproachCoordinate", approach)
    land = _need(where, "landCoordinate", pattern.land_coordinate)
    frame = Frame.GLOBAL_RELATIVE_ALT if _is_relative(where, pattern, is_vtol=is_vtol) else Frame.GLOBAL
    yield Command.DO_LAND_START, Frame.MISSION, _NOTHING
    if pattern.use_do_change_speed:
        speed_m_s = float(int(_need(where, "finalApproachSpeed", pattern.final_approach_speed)))
        yield Command.DO_CHANGE_SPEED, Frame.MISSION, (0.0, speed_m_s, -1.0, 0.0, 0.0, 0.0, 0.0)
    if pattern.stop_taking_photos:
        yield Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, _NOTHING
        yield Command.IMAGE_STOP_CAPTURE, Frame.MISSION, _UNSET
    if pattern.stop_video_photos:
        yield _VIDEO_STOP, Frame.MISSION, _UNSET
    if pattern.use_loiter_to_alt is False:
        yield Command.NAV_WAYPOINT, frame, (*_PLAIN, *approach)
    else:
        radius_m = abs(_need(where, "loiterRadius", pattern.loiter_radius))
        clockwise = _need(where, "loiterClockwise", pattern.loiter_clockwise)
        turn = (1.0, radius_m if clockwise else -radius_m, 0.0, 1.0)
        yield Command.NAV_LOITER_TO_ALT, frame, (*turn, *approach)
    if is_vtol:
        yield _VTOL_LAND, frame, (*_PLAIN, *land)
    else:
        yield Command.NAV_LAND, frame, (0.0, 0.0, 0.0, 0.0, *land)


def _is_relative(where: str, pattern: Pattern, *, is_vtol: bool) -> bool:
    if is_vtol or pattern.version != 1:
        return _need(where, "altitudesAreRelative", pattern.altitudes_are_relative)
    loiter = _need(where, "loiterAltitudeRelative", pattern.loiter_altitude_relative)
    if loiter != _need(where, "landAltitudeRelative", pattern.land_altitude_relative):
        raise MissionFileError(
            f"{where}: loiterAltitudeRelative and landAltitudeRelative differ, but QGroundControl no longer"
            " supports that; plan the landing again"
        )
    return loiter


def _structure_scan(where: str, pattern: Pattern) -> Iterator[Step]:
    """Yield the commands of a scan in layers round a structure, starting at the first vertex."""
    camera = _need(where, "CameraCalc", pattern.camera)
    from_top = _need(where, "StartFromTop", pattern.start_from_top)
    start_m = (
        _need(where, "StructureHeight", pattern.structure_height)
        if from_top
        else _need(where, "ScanBottomAlt", pattern.scan_bottom_alt)
    )
    entrance_m = _need(where, "EntranceAltitude", pattern.entrance_altitude)
    pitch_deg = _need(where, "GimbalPitch", pattern.gimbal_pitch)
    layers = _need(where, "Layers", pattern.layers)
    if layers < 1.0 or camera.frontal_m <= 0.0:
        sizes = f"Layers is {layers:g}, AdjustedFootprintFrontal is {camera.frontal_m:g}"
        raise MissionFileError(f"{where}: {sizes}; give numbers above 0")
    ring = _flight_polygon(where, _need(where, "polygon", pattern.polygon), camera.distance_m)
    relative = Frame.GLOBAL_RELATIVE_ALT
    gate: Step = (Command.NAV_WAYPOINT, relative, (*_PLAIN, *ring[0], entrance_m))
    yield gate
    yield _ROI_OFFSET, Frame.MISSION, (0.0, 0.0, 0.0, 0.0, pitch_deg, 0.0, 90.0)
    for layer in range(int(layers)):
        up_m = (layer + 0.5) * camera.frontal_m
        altitude_m = start_m - up_m if from_top else start_m + up_m
        for number, vertex in enumerate([*ring, ring[0]]):
            yield Command.NAV_WAYPOINT, relative, (*_PLAIN, *vertex, altitude_m)
            if number == 0:
                trigger = (camera.side_m, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
                yield Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, trigger
        yield Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, _NOTHING
    yield Command.DO_SET_ROI_NONE, Frame.MISSION, _NOTHING
    yield gate


def _flight_polygon(
    where: str, polygon: Sequence[tuple[float, float]], distance_m: float
) -> list[tuple[float, float]]:
    """Return a structure's polygon (latitude, longitude) with its edges moved outwards by `distance_m`."""
    if len(polygon) < 3:
        raise MissionFileError(f"{where}: polygon has {len(polygon)} vertices; a structure has at least 3")
    for number, (latitude_deg, longitude_deg) in enumerate(polygon, 1):
        try:
            check_place(latitude_deg, longitude_deg, 0.0, f"polygon, vertex {number}")
        except MissionError as error:
            raise MissionFileError(f"{where}: {error}; correct the value") from None
    frame = LocalFrame(*polygon[0], 0.0)
    corners = np.column_stack(frame.from_wgs84(*np.array(polygon, dtype=float).T))
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*edges.T)
    before = np.roll(edges, 1, axis=0)
    turns = before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0]
    straight = np.abs(turns) <= 1e-9 * lengths * np.roll(lengths, 1)
    if straight.any():
        number = int(np.argmax(straight)) + 1
        msg = f"{where}: polygon has no corner at vertex {number}; remove the vertex in QGroundControl"
        raise MissionFileError(msg)
    area = np.sum(corners[:, 0] * np.roll(corners[:, 1], -1) - corners[:, 1] * np.roll(corners[:, 0], -1))
    outwards = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None] * np.sign(area) * distance_m
    # Each new corner is the intersection of two adjacent edges that were shifted outwards.
    shift = outwards - np.roll(outwards, 1, axis=0)
    along = (shift[:, 0] * edges[:, 1] - shift[:, 1] * edges[:, 0]) / turns
    moved = corners + np.roll(outwards, 1, axis=0) + along[:, None] * before
    latitudes_deg, longitudes_deg = frame.to_wgs84(moved[:, 0], moved[:, 1])
    return list(zip(latitudes_deg.tolist(), longitudes_deg.tolist(), strict=True))
