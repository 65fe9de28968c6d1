"""Logs kept on board: of PX4 (.ulg), read by pyulog, and of ArduPilot (.bin), read by pymavlink."""

from __future__ import annotations

import contextlib
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np

from geo.imports import load_extra
from wbf_mission.addons.treatment.logs.track import (
    LEAST_UTC_S,
    Floats,
    LogError,
    LogImages,
    LogTrack,
    is_position,
    parsing,
)

_POSITION, _CAPTURE, _TRIGGER = "vehicle_global_position", "camera_capture", "camera_trigger"
_GPS = ("vehicle_gps_position", "sensor_gps")
_TOPICS = (_POSITION, _CAPTURE, _TRIGGER, *_GPS)
_FIX_3D = 3
_MOST_FIELDS = 4096
_DEEPEST = 8
_LEAST_UTC_US = 1e15


def read_ulog(path: Path) -> LogTrack:
    """Read the track (`vehicle_global_position`) and images (`camera_capture` or `camera_trigger`) of a .ulg.

    Without `vehicle_global_position`, the track has the positions of the satellite receiver that have a 3D
    fix. UTC is the time since boot plus the median offset of the receiver's `time_utc_usec`.
    """
    ULog = load_extra("pyulog.core", "gis", f"{path}: logs of PX4 need", LogError).ULog
    with parsing(path, "PX4 log"):
        declared = ULog(str(path), parse_header_only=True).message_formats
        for topic in declared:
            _count_fields(topic, declared, _DEEPEST)
        log = ULog(str(path), list(_TOPICS))
        topics = {topic.name: topic.data for topic in log.data_list if topic.multi_id == 0}
        offset_s = _utc_offset_s(topics)
        rows, notes = np.empty((0, 4)), []
        if _POSITION in topics:
            rows = _rows(topics[_POSITION], offset_s)
        if not is_position(rows[:, 2], rows[:, 3]).any() and (receiver := _receiver(topics)) is not None:
            rows = _rows(receiver, offset_s)
            notes.append(f"the log has no {_POSITION}: the positions come from the satellite receiver (GPS)")
        images = LogImages.of(_images(topics, offset_s))
    if log.file_corruption:
        notes.append("the log is damaged or truncated: only its valid part is read")
    return LogTrack.of("PX4 log", rows, images, tuple(notes))


def _rows(data: Any, offset_s: float) -> Floats:
    time_s = data["timestamp"] / 1e6
    return np.column_stack((time_s, time_s + offset_s, data["lat"], data["lon"]))


def _receiver(topics: dict[str, Any]) -> Any:
    """Return the positions of a satellite receiver with a 3D fix; None without such a receiver."""
    for name in _GPS:
        data = topics.get(name, {})
        if "latitude_deg" in data:  # PX4 1.14 and later
            places = data["latitude_deg"], data["longitude_deg"]
        elif "lat" in data:
            places = data["lat"] / 1e7, data["lon"] / 1e7
        else:
            continue
        fixed = data["fix_type"] >= _FIX_3D if "fix_type" in data else np.ones(len(places[0]), np.bool_)
        if fixed.any():
            named = zip(("timestamp", "lat", "lon"), (data["timestamp"], *places), strict=True)
            return {key: column[fixed] for key, column in named}
    return None


def _images(topics: dict[str, Any], offset_s: float) -> Any:
    if _CAPTURE in topics:
        data = topics[_CAPTURE]
        taken = data["result"] == 1 if "result" in data else np.ones(len(data["timestamp"]), np.bool_)
        places = data["lat"], data["lon"]
    elif _TRIGGER in topics:
        data = topics[_TRIGGER]
        taken = np.ones(len(data["timestamp"]), np.bool_)
        places = (np.full(len(taken), np.nan),) * 2
    else:
        return np.empty((0, 5))
    time_s = data["timestamp"] / 1e6
    return np.column_stack((data["seq"], time_s, time_s + offset_s, *places))[taken]


def _utc_offset_s(topics: dict[str, Any]) -> float:
    """Return the offset from seconds since boot to seconds since 1970; NaN if no receiver has the time."""
    for name in _GPS:
        if name in topics and "time_utc_usec" in topics[name]:
            utc_us: Floats = topics[name]["time_utc_usec"].astype(np.float64)
            known = utc_us > _LEAST_UTC_US
            if known.any():
                return float(np.median(utc_us[known] - topics[name]["timestamp"][known])) / 1e6
    return float("nan")


def _count_fields(topic: str, declared: dict[str, Any], depth: int) -> int:
    """Return the number of values in a message of `topic`; raise LogError for types nested too deeply.

    pyulog expands all nested types, so the check precedes the parsing of the data.
    """
    if depth == 0:
        raise LogError(f"message {topic[:40]!r} is nested too deeply in the log")
    count = 0
    for kind, size, _ in declared[topic].fields:
        each = _count_fields(kind, declared, depth - 1) if kind in declared else 1
        count += each * max(size, 1)
        if count > _MOST_FIELDS:
            raise LogError(f"message {topic[:40]!r} has more than {_MOST_FIELDS} numbers in the log")
    return count


_NAMES = ("POS", "GPS", "CAM", "TRIG")
_HEAD_BYTES = 3
_NOWHERE = math.nan


class _Formats(dict[int, Any]):
    """Message formats by number. A format shorter than its fields raises LogError: pymavlink would hang."""

    def __setitem__(self, number: int, form: Any) -> None:
        if form.len < _HEAD_BYTES or form.len < _HEAD_BYTES + struct.calcsize(form.msg_struct):
            raise LogError(f"the log declares message {form.name} shorter than its fields")
        super().__setitem__(number, form)


def read_dataflash(path: Path) -> LogTrack:
    """Read an ArduPilot .bin: the track from POS or else GPS, the images from CAM or else TRIG.

    The time since boot is TimeUS. pymavlink computes UTC from the GPS week and time in the log.
    """
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in _NAMES}
    with parsing(path, "ArduPilot log"):
        for message in _messages(path):
            boot_s = getattr(message, "TimeUS", _NOWHERE) / 1e6
            utc_s = message._timestamp if message._timestamp >= LEAST_UTC_S else _NOWHERE
            kind = message.get_type()
            if kind == "GPS" and message.Status < _FIX_3D:
                continue
            place = boot_s, utc_s, message.Lat, message.Lng
            if kind in ("CAM", "TRIG"):
                number = getattr(message, "Img", len(rows[kind]))
                rows[kind].append((number, *place))
            elif getattr(message, "I", 0) == 0:  # the first receiver
                rows[kind].append(place)
    images = LogImages.of(rows["CAM"] or rows["TRIG"])
    notes = (
        () if rows["POS"] else ("the log has no POS: the positions come from the satellite receiver (GPS)",)
    )
    return LogTrack.of("ArduPilot log", rows["POS"] or rows["GPS"], images, notes)


def _messages(path: Path) -> Any:
    from pymavlink import DFReader

    class Reader(DFReader.DFReader_binary):  # type: ignore[misc]
        """pymavlink's reader, which also checks the message formats that the log declares."""

        @property
        def formats(self) -> _Formats:
            return self._formats

        @formats.setter
        def formats(self, given: dict[int, Any]) -> None:
            self._formats = _Formats()
            for number, form in given.items():
                self._formats[number] = form

    reader = Reader(str(path))
    try:
        while (message := reader.recv_match(type=set(_NAMES), strict=True)) is not None:
            if message.get_type() in _NAMES:
                yield message
    finally:
        # BufferError: a message in use refers to the mapped file. The map is freed with the message.
        with contextlib.suppress(BufferError):
            reader.close()
        reader.filehandle.close()
