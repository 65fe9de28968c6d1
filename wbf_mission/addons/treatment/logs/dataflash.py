"""ArduPilot dataflash logs (.bin), read by pymavlink."""

from __future__ import annotations

import contextlib
import math
import struct
from pathlib import Path
from typing import Any

from wbf_mission.addons.treatment.logs.track import LEAST_UTC_S, LogError, LogImages, LogTrack, parsing

_NAMES = ("POS", "GPS", "CAM", "TRIG")
_HEAD_BYTES = 3
_GPS_3D = 3
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
            if kind == "GPS" and message.Status < _GPS_3D:
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
        # BufferError: a message still in use references the mapped file. The map is freed with the message.
        with contextlib.suppress(BufferError):
            reader.close()
        reader.filehandle.close()
