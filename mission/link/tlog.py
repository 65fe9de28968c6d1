"""Telemetry logs (.tlog) as MAVProxy, QGroundControl and pymavlink write and read them.

Each record is the time in microseconds since 1970 (8 bytes, big-endian) and one MAVLink frame.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from geo.reading import UnreadableError, read_file
from mission.errors import LinkError
from mission.link.codec.dialect import Message
from mission.link.codec.frames import FrameReader, valid_frame_end

MAX_LOG_BYTES = 2**30
_TIME = struct.Struct(">Q")
_LATEST_US = 4_102_444_800_000_000  # the year 2100: later than that is not a time stamp


class TlogWriter:
    """Writes frames to a log.

    Parameters
    ----------
    path : Path or str
        File to write; an existing one is replaced.

    Raises
    ------
    LinkError
        If the file cannot be written.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.frames = 0
        try:
            self._file = self.path.open("wb")
        except OSError as error:
            msg = f"{self.path}: the log cannot be written: {(error.strerror or str(error)).lower()}"
            raise LinkError(msg) from error

    def write(self, frame: bytes, time_s: float) -> None:
        """Add one frame; ``time_s`` is in seconds since 1970."""
        self._file.write(_TIME.pack(max(0, round(time_s * 1e6))) + frame)
        self.frames += 1

    def close(self) -> None:
        """Finish the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def read_tlog(path: Path | str) -> Iterator[tuple[float, Message]]:
    """Yield the time (s since 1970) and the message of each record.

    Records that are damaged are skipped up to the next one that makes sense; a cut last record ends the
    log.

    Raises
    ------
    LinkError
        If the file cannot be read, is no regular file, or is larger than 1 GiB (about 20 hours of a vehicle's
        telemetry at full rate).
    """
    try:
        data = read_file(Path(path), MAX_LOG_BYTES)
    except UnreadableError as error:
        msg = f"{path}: the log cannot be read: {error}"
        raise LinkError(msg) from error
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
