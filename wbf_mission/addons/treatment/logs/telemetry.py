"""Telemetry logs (.tlog), including observations of the leaf camera (`sensors.camera.wire`)."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

from geo import Farm
from mission.errors import LinkError
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.link.tlog import read_tlog
from sensors.camera.wire import ObservationAssembler
from sensors.observations import Observations
from wbf_mission.addons.treatment.logs.track import LogError, LogImages, LogTrack

_E7 = 1e7
_NOWHERE = float("nan")


def read_telemetry(path: Path) -> LogTrack:
    """Read from a .tlog the track (GLOBAL_POSITION_INT) and images of the vehicle with the most positions."""
    fixes: dict[int, list[tuple[float, ...]]] = {}
    # Images by number and place, or time: a restarted camera uses numbers again
    images: dict[int, dict[tuple[float, ...], tuple[float, ...]]] = {}
    messages = 0
    try:
        for time_s, message in read_tlog(path):
            messages += 1
            system = message.get_srcSystem()
            if is_a(message, m.MAVLink_global_position_int_message):
                place = message.lat / _E7, message.lon / _E7
                fixes.setdefault(system, []).append((message.time_boot_ms / 1e3, time_s, *place))
            elif (image := _image(message, time_s)) is not None:
                index, _, utc_s, *where = image
                key = (index, utc_s) if math.isnan(where[0]) else (index, *where)
                images.setdefault(system, {}).setdefault(key, image)
    except LinkError as error:
        raise LogError(str(error)) from None
    if not messages:
        raise LogError(f"{path}: holds no MAVLink message; is it a telemetry log (.tlog)?")
    counts = Counter({system: len(rows) for system, rows in fixes.items()})
    system = counts.most_common(1)[0][0] if counts else next(iter(images), 0)
    others = sorted((fixes.keys() | images.keys()) - {system})
    notes = []
    if others:
        named = ", ".join(map(str, others))
        notes.append(
            f"positions and images are read for vehicle {system} only; other vehicles in the log: {named}"
        )
    rows = list(images.get(system, {}).values())
    placed = {row[0] for row in rows if not math.isnan(row[-1])}
    rows = [row for row in rows if row[0] not in placed or not math.isnan(row[-1])]
    return LogTrack.of("telemetry log", fixes.get(system, []), LogImages.of(rows), tuple(notes))


def _image(message: Message, time_s: float) -> tuple[float, ...] | None:
    """Return index, boot time, UTC and position of the image that a message reports, or None."""
    if is_a(message, m.MAVLink_camera_image_captured_message):
        if message.capture_result != 1:
            return None
        place = message.lat / _E7, message.lon / _E7
        return message.image_index, message.time_boot_ms / 1e3, time_s, *place
    if is_a(message, m.MAVLink_camera_feedback_message):
        return message.img_idx, _NOWHERE, message.time_usec / 1e6, message.lat / _E7, message.lng / _E7
    if is_a(message, m.MAVLink_camera_trigger_message):
        return message.seq, _NOWHERE, time_s, _NOWHERE, _NOWHERE
    return None


def observations_in(
    path: Path, farm: Farm, day: int, fields: tuple[str, ...]
) -> tuple[Observations, tuple[str, ...]]:
    """Return the observations of leaf cameras in a .tlog, and notes on lost images.

    Raises LogError if the log cannot be read, or the camera senses other fields.
    """
    cameras: dict[int, ObservationAssembler] = {}
    try:
        for _, message in read_tlog(path):
            system = message.get_srcSystem()
            if system not in cameras:
                cameras[system] = ObservationAssembler(farm, day=day, system_id=system, fields=fields)
            cameras[system].add(message)
    except LinkError as error:
        raise LogError(str(error)) from None
    mismatch = next(filter(None, (camera.mismatch() for camera in cameras.values())), None)
    if mismatch is not None:
        raise LogError(f"{path}: {mismatch} (--fields)")
    parts = [camera.take() for _, camera in sorted(cameras.items())]
    statistics = [camera.statistics for camera in cameras.values()]
    lost = sum(counts.lost + counts.unpaired for counts in statistics)
    off = sum(counts.off_farm for counts in statistics)
    notes = [f"{lost} images are incomplete in the log"] * bool(lost)
    notes += [f"{off} cells of images lie outside the farm"] * bool(off)
    return Observations.concatenate(parts, fields), tuple(notes)
