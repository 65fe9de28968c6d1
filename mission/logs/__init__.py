"""Tracks and images of flights, read from autopilot logs or geotagged pictures."""

from mission.logs.reading import read_track
from mission.logs.track import LogError, LogImages, LogTrack

__all__ = ["LogError", "LogImages", "LogTrack", "read_track"]
