"""Mission files: QGroundControl plans, WPL 110, fence and rally files, native JSON, and formats of packages.

`read_mission` and `write_mission` choose the format by the suffix of the file name.
"""

from typing import TYPE_CHECKING

from geo.imports import attach

if TYPE_CHECKING:
    from mission.files.common import Firmware as Firmware
    from mission.files.formats import MissionFormat as MissionFormat
    from mission.files.formats import ending as ending
    from mission.files.formats import fitted as fitted
    from mission.files.formats import losses as losses
    from mission.files.formats import mission_formats as mission_formats
    from mission.files.formats import open_mission as open_mission
    from mission.files.formats import read_mission as read_mission
    from mission.files.formats import reader_for as reader_for
    from mission.files.formats import write_mission as write_mission
    from mission.files.formats import writer_for as writer_for
else:
    __getattr__, __dir__, __all__ = attach(__name__)
