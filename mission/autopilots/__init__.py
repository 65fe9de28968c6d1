"""Profiles of autopilots as data: PX4, ArduPilot, and profiles from entry points."""

from collections.abc import Mapping
from functools import cache

from geo.imports import entry_points, load_entry
from mission.autopilots.ardupilot import ARDUPILOT as ARDUPILOT
from mission.autopilots.profile import Profile as Profile
from mission.autopilots.px4 import PX4 as PX4
from mission.errors import TransferError
from mission.link.codec.dialect import mavlink as m

__all__ = ["ARDUPILOT", "GENERIC", "PX4", "Profile", "profile_for"]

PROFILE_GROUP = "wbf_mission.transfer_profiles"
"""Entry point group for `Profile` objects of other packages."""

GENERIC = Profile("the vehicle", m.MAV_AUTOPILOT_GENERIC)


def profile_for(autopilot: int) -> Profile:
    """Return the profile for the MAV_AUTOPILOT of a heartbeat; `GENERIC` if the autopilot is unknown.

    Raises TransferError if an entry point cannot be loaded or is not a `Profile`.

    >>> profile_for(12).name
    'PX4'
    """
    return _profiles().get(autopilot, GENERIC)


@cache
def _profiles() -> Mapping[int, Profile]:
    """Return the profiles of this package and of entry points, by MAV_AUTOPILOT."""
    found = {profile.autopilot: profile for profile in (PX4, ARDUPILOT)}
    for entry in entry_points(group=PROFILE_GROUP):
        profile = load_entry(entry, f"transfer profile {entry.name}", TransferError)
        if not isinstance(profile, Profile):
            msg = f"transfer profile {entry.name} ({entry.value}) is not a mission.autopilots.Profile"
            raise TransferError(msg)
        found[profile.autopilot] = profile
    return found
