"""Where a camera was, from the log of a flight or from geotagged pictures, whoever flew."""

from mission.logs.reading import read_track
from mission.logs.track import LogError, LogImages, LogTrack

__all__ = ["LogError", "LogImages", "LogTrack", "read_track"]
