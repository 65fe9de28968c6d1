"""Mission files: QGroundControl plans, WPL 110 waypoint lists and our own JSON.

`read_mission` and `write_mission` choose the format by the suffix of the file's name.
"""

from mission.files.common import Firmware
from mission.files.formats import (
    MissionFormat,
    mission_formats,
    read_mission,
    reader_for,
    register_format,
    write_mission,
    writer_for,
)

__all__ = [
    "Firmware",
    "MissionFormat",
    "mission_formats",
    "read_mission",
    "reader_for",
    "register_format",
    "write_mission",
    "writer_for",
]
