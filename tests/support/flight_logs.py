"""Small logs of flights, written byte by byte as autopilots and cameras write them."""

import struct
from fractions import Fraction

from PIL import Image, TiffImagePlugin

from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import TlogWriter

UTC_S = 1_777_600_800.0  # 2026-05-01T02:00:00Z


def _fmt(number, length, name, types, columns):
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name, types, columns)


def gps_week(utc_s):
    """GPS week and milliseconds of a time: 18 leap seconds ahead of UTC since 2017."""
    since = utc_s - 315_964_800 + 18
    return int(since // 604_800), round(since % 604_800 * 1000)


def write_dataflash(path, fixes, images=(), *, with_pos=True, end=b""):
    """An ArduPilot .bin: fixes are (boot s, latitude, longitude), images have a number before these."""
    formats = {
        b"FMT": (0x80, b"BBnNZ", b"Type,Length,Name,Format,Columns", "<BB4s16s64s"),
        b"GPS": (1, b"QBIHBcLLe", b"TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt", "<QBIHBhiii"),
        b"POS": (2, b"QLLfff", b"TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "<Qiifff"),
        b"CAM": (3, b"QBHIHLLeeeccC", b"TimeUS,I,Img,GPSTime,GPSWeek,Lat,Lng,Alt,RelAlt,GPSAlt,R,P,Y", None),
    }
    packers = {name: packing or "<QBHIHiiiiihhH" for name, (*_, packing) in formats.items()}
    data = b"".join(
        _fmt(number, 3 + struct.calcsize(packers[name]), name, types, columns)
        for name, (number, types, columns, _) in formats.items()
    )

    def message(name, *values):
        return b"\xa3\x95" + bytes([formats[name][0]]) + struct.pack(packers[name], *values)

    rows = []
    for boot_s, latitude, longitude, *status in fixes:
        place = round(latitude * 1e7), round(longitude * 1e7)
        week, ms = gps_week(UTC_S + boot_s)
        rows.append(
            (boot_s, message(b"GPS", round(boot_s * 1e6), *(status or [3]), ms, week, 12, 80, *place, 5000))
        )
        if with_pos:
            rows.append((boot_s, message(b"POS", round(boot_s * 1e6), *place, 50.0, 20.0, 20.0)))
    for number, boot_s, latitude, longitude in images:
        place = round(latitude * 1e7), round(longitude * 1e7)
        week, ms = gps_week(UTC_S + boot_s)
        values = round(boot_s * 1e6), 0, number, ms, week, *place, 5000, 2000, 5000, 0, 0, 9000
        rows.append((boot_s, message(b"CAM", *values)))
    rows.sort(key=lambda row: row[0])
    path.write_bytes(data + b"".join(row for _, row in rows) + end)
    return path


def _ulog_message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


_CLOCK = b"uint64_t timestamp;uint64_t time_utc_usec;"
_RECEIVERS = {
    "clock": (_CLOCK, "<QQ"),
    "1.13": (_CLOCK + b"int32_t lat;int32_t lon;uint8_t fix_type;", "<QQiiB"),
    "1.14": (_CLOCK + b"double latitude_deg;double longitude_deg;uint8_t fix_type;", "<QQddB"),
}
"""What PX4's satellite receiver tells by the versions that tell it: the time only, or positions, too."""


def write_ulog(path, fixes, images=(), *, formats=(), cut=None, receiver="clock", with_position=True):
    """A PX4 .ulg: as `write_dataflash`; images with a position of NaN are bare triggers."""
    topics = {
        b"vehicle_global_position": (b"uint64_t timestamp;double lat;double lon;float alt;", "<Qddf"),
        b"vehicle_gps_position": _RECEIVERS[receiver],
        b"camera_capture": (
            b"uint64_t timestamp;uint64_t timestamp_utc;uint32_t seq;double lat;double lon;float alt;"
            b"float ground_distance;float[4] q;int8_t result;",
            "<QQIddff4fb",
        ),
        b"camera_trigger": (
            b"uint64_t timestamp;uint64_t timestamp_utc;uint32_t seq;bool feedback;",
            "<QQI?",
        ),
    }
    number = {name: k for k, name in enumerate(topics)}
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    for name, (columns, _) in topics.items():
        data += _ulog_message("F", name + b":" + columns)
    data += b"".join(_ulog_message("F", text) for text in formats)
    used = [one for one in topics if one != b"camera_capture" or any(i[2] == i[2] for i in images)]
    used = used[not with_position :]
    for name in used:
        data += _ulog_message("A", struct.pack("<BH", 0, number[name]) + name)

    def record(name, *values):
        return _ulog_message("D", struct.pack("<H", number[name]) + struct.pack(topics[name][1], *values))

    for boot_s, latitude, longitude, *status in fixes:
        us = round(boot_s * 1e6)
        if with_position:
            data += record(b"vehicle_global_position", us, latitude, longitude, 50.0)
        scale = 1e7 if receiver == "1.13" else 1
        place = [round(one * scale) if scale > 1 else one for one in (latitude, longitude)]
        told = [] if receiver == "clock" else [*place, *(status or [3])]
        data += record(b"vehicle_gps_position", us, round((UTC_S + boot_s) * 1e6), *told)
    for index, boot_s, latitude, longitude, *result in images:
        us = round(boot_s * 1e6)
        if latitude == latitude:
            values = latitude, longitude, 50.0, 20.0, 1, 0, 0, 0, *(result or [1])
            data += record(b"camera_capture", us, 0, index, *values)
        else:
            data += record(b"camera_trigger", us, 0, index, False)
    path.write_bytes(data if cut is None else data[:cut])
    return path


def write_telemetry(path, fixes, images=(), *, system=1):
    """A .tlog: as `write_dataflash`; images with a position of NaN are bare triggers."""
    link = m.MAVLink(None, srcSystem=system, srcComponent=1)
    frames = []
    for boot_s, latitude, longitude in fixes:
        place = round(latitude * 1e7), round(longitude * 1e7)
        message = m.MAVLink_global_position_int_message(
            round(boot_s * 1e3), *place, 50_000, 20_000, 0, 0, 0, 0
        )
        frames.append((boot_s, message))
    for index, boot_s, latitude, longitude, *result in images:
        place = [round(one * 1e7) if one == one else 0 for one in (latitude, longitude)]
        if result:
            message = m.MAVLink_camera_image_captured_message(
                round(boot_s * 1e3), 0, 1, *place, 50_000, 20_000, [1.0, 0.0, 0.0, 0.0], index, *result, b""
            )
        elif latitude == latitude:
            message = m.MAVLink_camera_feedback_message(
                round((UTC_S + boot_s) * 1e6), 1, 0, index, *place, 50.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0
            )
        else:
            message = m.MAVLink_camera_trigger_message(round(boot_s * 1e6), index)
        frames.append((boot_s, message))
    with TlogWriter(path) as writer:
        for boot_s, message in sorted(frames, key=lambda one: one[0]):
            writer.write(bytes(message.pack(link)), UTC_S + boot_s)
    return path


def write_picture(path, latitude=None, longitude=None, *, utc=None, taken=None, kind="JPEG", xmp=None):
    """A picture with EXIF: utc is ((h, m, s), "2026:05:01"), taken (DateTimeOriginal, offset), and XMP."""
    picture, exif = Image.new("RGB", (8, 6), (40, 120, 40)), Image.Exif()
    if latitude is not None:
        gps = exif.get_ifd(0x8825)
        for reference, value, letters in ((1, latitude, "NS"), (3, longitude, "EW")):
            degrees, minutes = divmod(abs(value) * 60.0, 60.0)
            seconds, minutes = minutes % 1 * 60, int(minutes)
            parts = (Fraction(int(degrees)), Fraction(minutes), Fraction(round(seconds * 1e6), 10**6))
            gps[reference] = letters[0] if value >= 0 else letters[1]
            gps[reference + 1] = tuple(float(part) for part in parts)
        if utc is not None:
            gps[7], gps[29] = tuple(map(float, utc[0])), utc[1]
    if taken is not None:
        ifd = exif.get_ifd(0x8769)
        ifd[0x9003], ifd[0x9011] = taken
    if kind == "TIFF":  # whose directories Pillow writes only in its own form
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        for number in (0x8825, 0x8769):
            tags[number] = dict(exif.get_ifd(number))
        if xmp is not None:
            tags.tagtype[700], tags[700] = 1, xmp
        picture.save(path, kind, tiffinfo=tags)
    else:
        picture.save(path, kind, exif=exif, **({} if xmp is None else {"xmp": xmp}))
    return path
