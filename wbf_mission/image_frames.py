"""The log of a flight whose cameras numbered their readings, with what was read in place of the numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mission.link.codec.dialect import mavlink
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.typed import is_a
from mission.link.tlog import FrameLog
from sensors.camera.layout import LeafLayout

__all__ = ["log_of_readings"]

_SEQUENCE = 4
_ID = slice(7, 10)
_IMAGE_ID = mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY.to_bytes(3, "little")


def log_of_readings(log: FrameLog, readings: NDArray[np.float32], layout: LeafLayout) -> FrameLog:
    """Return the log of the same flight with other readings.

    Parameters
    ----------
    log : FrameLog
        Of MAVLink 2 frames that are not signed, as our own components send them.
    readings : float32[n, fields]
        By their numbers.
    layout : LeafLayout
        Of the cameras.
    """
    told = FrameLog()
    reader = FrameReader()
    for frame, time_s in log:
        if frame[_ID] != _IMAGE_ID:
            told.write(frame, time_s)
            continue
        for message in reader.feed(frame):
            if not is_a(message, mavlink.MAVLink_debug_float_array_message):
                continue
            if message.name == layout.name and layout.fits(message.data):
                message.data = _read(message.data, readings, layout)
            writer = FrameWriter(message.get_srcSystem(), message.get_srcComponent())
            writer.codec.seq = frame[_SEQUENCE]
            told.write(writer.encode(message), time_s)
    return told


def _read(data: Sequence[float], readings: NDArray[np.float32], layout: LeafLayout) -> list[float]:
    part = layout.unpack(data)
    assert part is not None
    begin = 3 + len(layout.header)
    numbers = np.array(part.values).reshape(-1, len(layout.fields))[:, 0]
    known = ~np.isnan(numbers)
    values = np.full((len(numbers), len(layout.fields)), np.nan, np.float32)
    values[known] = readings[numbers[known].astype(np.int64)]
    return [*data[:begin], *values.ravel().tolist(), *data[begin + values.size :]]
