"""Telemetry logs (.tlog) in the format of MAVProxy, QGroundControl and pymavlink.

Each record is a Unix time in microseconds (8 bytes, big-endian) and one MAVLink frame.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from geo.reading import UnreadableError, read_file
from geo.system import Closing
from mission.errors import LinkError
from mission.link.codec.dialect import Message
from mission.link.codec.frames import FrameReader, valid_frame_end

MAX_LOG_BYTES = 2**30
_TIME = struct.Struct(">Q")
_UNKNOWN_TIME = bytes(_TIME.size)
_LATEST_US = 4_102_444_800_000_000  # the year 2100; larger values are not a time stamp


class FrameSink(Protocol):
    """Consumer of frames with their times."""

    def write(self, frame: bytes, time_s: float) -> None:
        """Add one frame with its time (s)."""


class TlogWriter(Closing):
    """Writer of a .tlog file; overwrites an existing file. Raises LinkError if the file cannot be opened."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.frames = 0
        self._time_s, self._stamp = 0.0, bytes(_TIME.size)
        try:
            self._file = self.path.open("wb")
        except OSError as error:
            msg = f"{self.path}: the log cannot be written: {(error.strerror or str(error)).lower()}"
            raise LinkError(msg) from error

    def write(self, frame: bytes, time_s: float) -> None:
        """Add one frame with its Unix time (s); an OSError names the file."""
        if time_s != self._time_s:  # most frames have the time of the previous frame
            self._time_s, self._stamp = time_s, _stamp(time_s)
        self._put(self._stamp + frame)
        self.frames += 1

    def write_all(self, log: FrameLog, begin_s: float) -> None:
        """Add the frames of ``log``, which began at the Unix time ``begin_s``."""
        self._put(log.records(begin_s))
        self.frames += len(log)

    def close(self) -> None:
        """Flush and close the file; raise OSError with the file name if that fails."""
        try:
            self._file.close()
        except OSError as error:
            error.filename = str(self.path)  # the error of a full disk does not name the file
            raise

    def _put(self, data: bytes) -> None:
        try:
            self._file.write(data)
        except OSError as error:
            error.filename = str(self.path)
            raise


class FrameLog:
    r"""Frames timed from a start (s), kept until the Unix time of the start is known.

    >>> log = FrameLog()
    >>> log.write(b"frame", 1.5)
    >>> log.records(0.000001)
    b'\x00\x00\x00\x00\x00\x16\xe3aframe'
    """

    def __init__(self) -> None:
        self._times_s = array("d")
        self._starts = array("q")
        self._records = bytearray()

    def __len__(self) -> int:
        return len(self._times_s)

    def __iter__(self) -> Iterator[tuple[bytes, float]]:
        """Yield each frame and its time since the start (s)."""
        ends = [*self._starts[1:], len(self._records)]
        for start, end, time_s in zip(self._starts, ends, self._times_s, strict=True):
            yield bytes(self._records[start + _TIME.size : end]), time_s

    def write(self, frame: bytes, time_s: float) -> None:
        """Add one frame; ``time_s`` is the time since the start (s)."""
        self._starts.append(len(self._records))
        self._times_s.append(time_s)
        self._records += _UNKNOWN_TIME + frame

    def records(self, begin_s: float) -> bytes:
        """Return the records of a .tlog file that starts at the Unix time ``begin_s``."""
        made = np.frombuffer(bytes(self._records), np.uint8).copy()
        times_us = np.rint((begin_s + np.array(self._times_s)) * 1e6).astype(">u8")
        places = np.array(self._starts)[:, None] + np.arange(_TIME.size)
        made[places] = times_us.view(np.uint8).reshape(-1, _TIME.size)
        return made.tobytes()


def tlog_record(frame: bytes, time_s: float) -> bytes:
    r"""Return the .tlog record of one frame; ``time_s`` is the Unix time (s).

    >>> tlog_record(b"frame", 1.5)
    b'\x00\x00\x00\x00\x00\x16\xe3`frame'
    """
    return _stamp(time_s) + frame


def _stamp(time_s: float) -> bytes:
    return _TIME.pack(max(0, round(time_s * 1e6)))


def read_tlog(path: Path | str) -> Iterator[tuple[float, Message]]:
    """Yield the Unix time (s) and the message of each record of a .tlog file.

    Damaged records are skipped up to the next valid record. A truncated last record is ignored.

    Raises
    ------
    LinkError
        If the file cannot be read, is not a regular file, or is larger than 1 GiB (about 20 hours of a
        vehicle's telemetry at full rate).
    """
    try:
        data = read_file(Path(path), MAX_LOG_BYTES)
    except UnreadableError as error:
        raise LinkError(f"{path}: the log cannot be read: {error}") from error
    reader = FrameReader()
    at = 0
    while at + 8 < len(data):
        (time_us,) = _TIME.unpack_from(data, at)
        after = valid_frame_end(data, at + 8) if time_us < _LATEST_US else 0
        if after:
            for message in reader.feed(data[at + 8 : after]):
                yield time_us / 1e6, message
            at = after
        else:
            at += 1
