"""Names of the installed autopilots, without importing any of them.

A vehicle file has a table for each autopilot's parameters, and a vehicle names the autopilot that moves it:
both need the names only.
"""

from __future__ import annotations

from functools import cache

from geo.imports import entry_points

__all__ = ["AUTOPILOT_GROUP", "DEFAULT_AUTOPILOT", "NO_AUTOPILOT", "autopilot_names"]

AUTOPILOT_GROUP = "wbf_mission.autopilots"
"""The entry point group; each entry is a `sim_vehicle.autopilot.autopilot.Autopilot`."""
DEFAULT_AUTOPILOT = "px4"
NO_AUTOPILOT = "generic"
"""What a vehicle names that moves as no autopilot in particular makes it move; not an installed autopilot."""


@cache
def autopilot_names() -> tuple[str, ...]:
    """Names of the installed autopilots, the default one first, the others sorted.

    Examples
    --------
    >>> autopilot_names()[:2]
    ('px4', 'ardupilot')
    """
    names = {entry.name for entry in entry_points(group=AUTOPILOT_GROUP)}
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_AUTOPILOT, name)))
