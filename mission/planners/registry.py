"""Planners by name, found through the entry point group ``wbf_mission.planners``."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import cast

from mission.errors import PlanningError
from mission.planners.request import Planner

ENTRY_POINT_GROUP = "wbf_mission.planners"


def planner_names() -> tuple[str, ...]:
    """Return the names of the installed planners, sorted.

    Examples
    --------
    >>> "lawnmower" in planner_names()
    True
    """
    return tuple(sorted({entry.name for entry in entry_points(group=ENTRY_POINT_GROUP)}))


def get_planner(name: str) -> Planner:
    """Return the planner of that name; case does not matter.

    Raises
    ------
    PlanningError
        If there is no planner of that name, or its package cannot be imported.

    Examples
    --------
    >>> get_planner("spiral").__name__
    'spiral'
    """
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name.lower() != name.strip().lower():
            continue
        try:
            planner = entry.load()
        except (ImportError, AttributeError) as error:
            msg = f"planner {entry.name} ({entry.value}) cannot be loaded: {error}"
            raise PlanningError(msg) from error
        if not callable(planner):
            msg = f"planner {entry.name} ({entry.value}) is no callable"
            raise PlanningError(msg)
        return cast("Planner", planner)
    msg = f"no planner is named {name!r}; there are {', '.join(planner_names())}"
    raise PlanningError(msg)
