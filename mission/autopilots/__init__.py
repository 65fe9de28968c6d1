"""Autopilot profiles: facts of PX4 and ArduPilot for a ground station, as data."""

from mission.autopilots.ardupilot import ARDUPILOT as ARDUPILOT
from mission.autopilots.profile import Profile as Profile
from mission.autopilots.px4 import PX4 as PX4
from mission.autopilots.registry import GENERIC as GENERIC
from mission.autopilots.registry import profile_for as profile_for

__all__ = ["ARDUPILOT", "GENERIC", "PX4", "Profile", "profile_for"]
