"""Comparing the plan that was sent with the plan that was read back."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.autopilots import GENERIC
from mission.autopilots.profile import Profile
from mission.model import Command, MissionItem, plan_of

_PLACE_DEG = 2.5e-7
_ALTITUDE_M = 0.011
_RELATIVE = 1e-5
_YAW_DEG = 1e-2
_WITH_YAW = frozenset({Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LAND, Command.NAV_TAKEOFF})
_FIELDS = ("command", "frame", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that is not the same on both sides.

    Parameters
    ----------
    sequence : int
        The item, from 0 (a user counts from 1); -1 for the plan as a whole.
    field : str
        ``count``, or a field of `MissionItem`.
    sent, received : float or None
        The two values.
    """

    sequence: int
    field: str
    sent: float | None
    received: float | None

    def __str__(self) -> str:
        if self.sequence < 0:
            return f"{self.sent:g} items were sent, the vehicle holds {self.received:g}"
        sent = f"item {self.sequence + 1}: {self.field} was sent as {self.sent}"
        return f"{sent}, the vehicle holds {self.received}"


def _equal(name: str, one: MissionItem, other: MissionItem, profile: Profile) -> bool:
    sent: float | None = getattr(one, name)
    received: float | None = getattr(other, name)
    if name == "frame" and not profile.keeps_frame and not one.has_position:
        return True
    if name == "autocontinue" and plan_of(one.command) not in profile.keeps_autocontinue:
        return True
    known = profile.read_back.get(one.command, {}).get(name)
    if known is not None and received is not None and known.of(sent) == received:
        return True
    if sent is None or received is None:
        return sent is received or (sent is None and received == 0.0 and not profile.keeps_default)
    difference = abs(float(sent) - float(received))
    if name in ("command", "frame", "autocontinue"):
        return difference == 0.0
    if one.has_position and name in ("x", "y"):
        return difference <= _PLACE_DEG
    if one.has_position and name == "z":
        return difference <= max(_ALTITUDE_M, _RELATIVE * abs(sent))
    if difference <= _RELATIVE * max(1.0, abs(sent)):
        return True
    if name in ("x", "y"):
        return int(sent) == int(received)
    if one.command == Command.NAV_WAYPOINT and name == "param1" and profile.whole_seconds:
        return difference < 1.0
    if one.command in _WITH_YAW and name == "param4":
        return abs(math.remainder(difference, 360.0)) <= _YAW_DEG
    return False


def compare_plans(
    sent: tuple[MissionItem, ...],
    received: tuple[MissionItem, ...],
    profile: Profile = GENERIC,
    *,
    limit: int = 20,
) -> tuple[Difference, ...]:
    """List what differs between two plans, beyond what the wire and the autopilot's storage change.

    Allowed are: 32-bit floats (1e-5 relative), 2.5e-7 degree, 1.1 cm of altitude, a yaw that differs by
    full turns, the frames 5/6/11 for 0/3/10 (the same by `MissionItem`), and what the profile says of the
    fields that an autopilot does not keep, or keeps roughly.

    Parameters
    ----------
    sent, received : tuple of MissionItem
        The plans.
    profile : Profile
        The autopilot that stored the plan.
    limit : int
        Stop after so many differences.

    Returns
    -------
    tuple of Difference
        Empty if the plans are the same.
    """
    if len(sent) != len(received):
        return (Difference(-1, "count", len(sent), len(received)),)
    found: list[Difference] = []
    for sequence, (one, other) in enumerate(zip(sent, received, strict=True)):
        if one != other:
            found += [
                Difference(sequence, name, getattr(one, name), getattr(other, name))
                for name in _FIELDS
                if name not in profile.lossy.get(one.command, ()) and not _equal(name, one, other, profile)
            ]
        if len(found) >= limit:
            break
    return tuple(found[:limit])
