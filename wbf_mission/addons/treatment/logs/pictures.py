"""Folders of geotagged pictures: position and time from EXIF or DJI's XMP, read by Pillow."""

from __future__ import annotations

import re
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from geo.texts import one_line
from wbf_mission.addons.treatment.logs.track import LogError, LogImages, LogTrack

_SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff")
_MOST_PICTURES = 50_000
_GPS_IFD, _EXIF_IFD = 0x8825, 0x8769
_LATITUDE_REF, _LATITUDE, _LONGITUDE_REF, _LONGITUDE = 1, 2, 3, 4
_GPS_TIME, _GPS_DATE = 7, 29
_TAKEN, _ZONE = 0x9003, 0x9011
_NOWHERE = float("nan")
_MOST_XMP = 1 << 20
_DJI = re.compile(
    rb"drone-dji:gps(lat|long?t?)itude\s*(?:=\s*[\"']|>)\s*([-+]?\d+(?:\.\d*)?)\s*[\"'<]", re.IGNORECASE
)
"""Latitude or longitude in DJI's XMP, as an attribute or as an element. Older drones write GpsLongtitude."""
_SHOWN = 5


def read_pictures(path: Path) -> LogTrack:
    """Read a folder of JPEG or TIFF pictures; the images are numbered from 0 in the order of their names.

    The position comes from EXIF, else from DJI's XMP. The time comes from GPSDateStamp and GPSTimeStamp
    (UTC), else from DateTimeOriginal and OffsetTimeOriginal. Without an offset the time is unknown. Pixels
    are not read.
    """
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in _SUFFIXES and file.is_file())
    if not files:
        raise LogError(f"{path}: holds no pictures ({', '.join(_SUFFIXES)}) and no result of a flight")
    if len(files) > _MOST_PICTURES:
        raise LogError(f"{path}: holds {len(files)} pictures, more than {_MOST_PICTURES}; give them in parts")
    rows: list[tuple[float, ...]] = []
    names: list[str] = []
    notes, unread, placeless = [], [], []
    for file in files:
        try:
            latitude, longitude, utc_s = _exif(file)
        except Exception as error:  # Pillow's parsers raise many kinds of errors
            unread.append(f"{file.name}: {one_line(str(error), 120)}")
            continue
        if latitude != latitude:
            placeless.append(file.name)
        rows.append((len(rows), _NOWHERE, utc_s, latitude, longitude))
        names.append(file.name)
    if unread:
        notes.append(f"{len(unread)} of {len(files)} pictures cannot be read, the first {unread[0]}")
    if placeless:
        some = ", ".join(one_line(name, 60) for name in placeless[:_SHOWN])
        some += ", ..." if len(placeless) > _SHOWN else ""
        notes.append(f"{len(placeless)} of {len(files)} pictures have no position: {some}")
    if len(unread) + len(placeless) == len(files):
        raise LogError(f"{path}: {'; '.join(notes)}; give pictures with GPS positions (EXIF, or DJI's XMP)")
    images = LogImages.of(rows, tuple(names))
    by_time = sorted(row[2:] for row in rows if row[2] == row[2])
    track = [(_NOWHERE, *row) for row in by_time]
    return LogTrack.of("folder of pictures", track, images, tuple(notes))


def _exif(path: Path) -> tuple[float, float, float]:
    """Return latitude, longitude (degrees) and UTC seconds of a picture; NaN if unknown."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(path, formats=("JPEG", "TIFF", "MPO")) as picture:
            exif = picture.getexif()
            gps, taken = exif.get_ifd(_GPS_IFD), exif.get_ifd(_EXIF_IFD)
            xmp = picture.info.get("xmp")
    latitude = _degrees(gps.get(_LATITUDE), gps.get(_LATITUDE_REF), "S")
    longitude = _degrees(gps.get(_LONGITUDE), gps.get(_LONGITUDE_REF), "W")
    if not _is_place(latitude, longitude):
        latitude, longitude = _of_dji(xmp)
    if not _is_place(latitude, longitude):
        latitude = longitude = _NOWHERE
    return latitude, longitude, _utc_s(gps, taken)


def _is_place(latitude: float, longitude: float) -> bool:
    # A receiver without a fix reports 0, 0.
    return abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and (latitude, longitude) != (0.0, 0.0)


def _of_dji(xmp: Any) -> tuple[float, float]:
    """Return the position in DJI's XMP; NaN if the XMP has no position."""
    packet = xmp[:_MOST_XMP] if isinstance(xmp, bytes) else b""
    found = {name.lower()[:3]: float(number) for name, number in _DJI.findall(packet)}
    return found.get(b"lat", _NOWHERE), found.get(b"lon", _NOWHERE)


def _degrees(parts: Any, reference: Any, negative: str) -> float:
    try:
        degrees, minutes, seconds = map(float, parts)
    except (TypeError, ValueError, ZeroDivisionError):
        return _NOWHERE
    value = degrees + minutes / 60.0 + seconds / 3600.0
    return -value if str(reference).strip("\0 ").upper() == negative else value


def _utc_s(gps: Any, taken: Any) -> float:
    date, time = gps.get(_GPS_DATE), gps.get(_GPS_TIME)
    try:
        year, month, day = map(int, re.split(r"[:\-]", str(date).strip("\0 ")))
        hours, minutes, seconds = map(float, time)
        midnight = datetime(year, month, day, tzinfo=UTC).timestamp()
        return midnight + 3600.0 * hours + 60.0 * minutes + seconds
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        pass
    try:
        text = f"{str(taken[_TAKEN]).strip()}{str(taken[_ZONE]).strip()}"
        return datetime.strptime(text, "%Y:%m:%d %H:%M:%S%z").timestamp()
    except (KeyError, ValueError, OverflowError):
        return _NOWHERE
