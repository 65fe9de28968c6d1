"""Tracks and images of flights, from logs of autopilots or geotagged pictures."""

from wbf_mission.addons.treatment.logs.reading import read_track
from wbf_mission.addons.treatment.logs.track import LogError, LogImages, LogTrack

__all__ = ["LogError", "LogImages", "LogTrack", "read_track"]
