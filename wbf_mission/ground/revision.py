"""The mission that takes the place of one in flight: take-off, speed, camera and end stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mission.model import Command, Mission, MissionItem
from wbf_mission.ground.change import CAMERA, is_return

__all__ = ["revised_mission"]


def revised_mission(
    held: Mission,
    item: int,
    path_deg: Sequence[tuple[float, float]],
    *,
    altitude_m: float,
    acceptance_radius_m: float,
) -> tuple[Mission, int]:
    """Return the mission that goes on through other waypoints, and its item to go on with.

    It keeps take-off, speed and camera of the held mission and ends as that does. A camera that takes images
    already goes on without one of its own at the change; otherwise it begins at the change.

    Parameters
    ----------
    held : Mission
        What the vehicle holds.
    item : int
        The item that it flies to now.
    path_deg : sequence of (float, float)
        Latitude and longitude of the waypoints; none is the way home at once.
    altitude_m : float
        Of the waypoints, above home.
    acceptance_radius_m : float

    Examples
    --------
    >>> items = (MissionItem.waypoint(28.05, -82.15, 10.0), MissionItem(Command.NAV_RETURN_TO_LAUNCH))
    >>> new, resume_at = revised_mission(
    ...     Mission(items), 0, [(28.06, -82.15)], altitude_m=10.0, acceptance_radius_m=1.0
    ... )
    >>> [one.command for one in new.items], resume_at
    ([16, 20], 0)
    """
    items = held.items
    end = next(
        (k for k, one in enumerate(items) if is_return(one) or one.command == Command.DO_LAND_START),
        len(items),
    )
    begin = [one for one in items[:end] if one.command == Command.NAV_TAKEOFF][:1]
    speeds = [one for one in items[:end] if one.command == Command.DO_CHANGE_SPEED]
    before = [one for one in items[: min(item, end)] if one.command == Command.DO_CHANGE_SPEED]
    begin += before[-1:] or speeds[:1]
    cameras = [one for one in items[:end] if one.command in CAMERA]
    taking = [one for one in items[: min(item, end)] if one.command in CAMERA]
    starts = [one for one in cameras if (one.param1 or 0.0) > 0.0]
    on = bool(taking) and (taking[-1].param1 or 0.0) > 0.0
    waypoints = [
        MissionItem.waypoint(latitude, longitude, altitude_m, acceptance_radius_m=acceptance_radius_m)
        for latitude, longitude in path_deg
    ]
    if on and waypoints:
        begin.append(replace(taking[-1], param3=0.0))
    elif waypoints:
        begin += starts[:1]
    resume_at = len(begin)
    stop = [MissionItem(starts[0].command)] if starts else []
    if not waypoints:
        resume_at += len(stop)
    return replace(held, items=(*begin, *waypoints, *stop, *items[end:])), resume_at
