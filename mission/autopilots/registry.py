"""The autopilots that a ground station knows: those of this package, and those of further packages."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from geo.imports import entry_points, load_entry
from mission.autopilots.ardupilot import ARDUPILOT
from mission.autopilots.profile import Profile
from mission.autopilots.px4 import PX4
from mission.errors import TransferError
from mission.link.codec.dialect import mavlink as m

__all__ = ["GENERIC", "PROFILE_GROUP", "profile_for"]

PROFILE_GROUP = "wbf_mission.transfer_profiles"
"""The entry point group in which further packages give a `Profile`, found by its MAV_AUTOPILOT."""

GENERIC = Profile("the vehicle", m.MAV_AUTOPILOT_GENERIC)


def profile_for(autopilot: int) -> Profile:
    """Profile for the MAV_AUTOPILOT of a heartbeat, `GENERIC` for one of which no installed package has any.

    TransferError if an installed package does not give the profile that it promises.

    Examples
    --------
    >>> profile_for(12).name
    'PX4'
    """
    return _profiles().get(autopilot, GENERIC)


@cache
def _profiles() -> Mapping[int, Profile]:
    """Profiles by MAV_AUTOPILOT: those of this package, and those of further packages."""
    found = {profile.autopilot: profile for profile in (PX4, ARDUPILOT)}
    for entry in entry_points(group=PROFILE_GROUP):
        profile = load_entry(entry, f"transfer profile {entry.name}", TransferError)
        if not isinstance(profile, Profile):
            msg = f"transfer profile {entry.name} ({entry.value}) is no mission.autopilots.Profile"
            raise TransferError(msg)
        found[profile.autopilot] = profile
    return found
