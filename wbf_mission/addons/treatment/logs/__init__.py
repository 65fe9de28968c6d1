"""Tracks and images of flights, read from autopilot logs or geotagged pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from wbf_mission.addons.treatment.logs.track import MAX_LOG_BYTES, LogError, LogImages, LogTrack

__all__ = ["LogError", "LogImages", "LogTrack", "read_track"]

_ULOG = b"ULog\x01\x12\x35"
_DATAFLASH = b"\xa3\x95"
_MAVLINK = (b"\xfe", b"\xfd")
_TIME_BYTES = 8


def read_track(path: Path | str) -> LogTrack:
    """Read a telemetry log (.tlog), an ArduPilot (.bin) or PX4 (.ulg) log, or a folder of pictures.

    A truncated log is read up to its end. Raises LogError if the format is unknown, or the log is larger
    than 1 GiB, cannot be read, or has no position.
    """
    path = Path(path)
    track = _reader(path)(path)
    if not len(track.latitude_deg) and not len(track.images.index):
        raise LogError(f"{path}: the {track.kind} has no position; is it the log of a flight?")
    return track


def _reader(path: Path) -> Callable[[Path], LogTrack]:
    if path.is_dir():
        from wbf_mission.addons.treatment.logs.pictures import read_pictures

        return read_pictures
    try:
        if path.exists() and not path.is_file():
            raise LogError(f"{path}: cannot be read: it is a pipe or a device, not a file")
        with path.open("rb") as file:
            begin = file.read(_TIME_BYTES + 1)
        if path.stat().st_size > MAX_LOG_BYTES:
            raise LogError(f"{path}: cannot be read: it is larger than {MAX_LOG_BYTES / 2**20:g} MiB")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {(error.strerror or str(error)).lower()}") from None
    except LogError:
        raise
    except ValueError:  # a NUL in the name
        raise LogError(f"{str(path)!r}: cannot be read: there is a NUL character in its name") from None
    if begin.startswith(_ULOG):
        from wbf_mission.addons.treatment.logs.onboard import read_ulog

        return read_ulog
    if begin.startswith(_DATAFLASH):
        from wbf_mission.addons.treatment.logs.onboard import read_dataflash

        return read_dataflash
    if path.suffix.lower() == ".tlog" or begin[_TIME_BYTES:] in _MAVLINK:
        from wbf_mission.addons.treatment.logs.telemetry import read_telemetry

        return read_telemetry
    kinds = "a .tlog, an ArduPilot .bin, a PX4 .ulg, or a folder of pictures"
    raise LogError(f"{path}: is not a known kind of log; give {kinds}")
