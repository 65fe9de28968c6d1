"""Check that Python imports the packages of this project, and not a user's files with the same names.

A user's file or folder may be called ``mission`` or ``sensors``. If such a file comes first on the path, a
later import would fail with a misleading error.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

PACKAGES = ("geo", "sensors", "mission", "sim_vehicle")
_HERE = Path(__file__).resolve().parent.parent


def require_packages() -> None:
    """Raise ImportError if a file or folder hides a package of this project; the error names it."""
    for name in PACKAGES:
        try:
            spec = importlib.util.find_spec(name)
        except ValueError:  # find_spec refuses a module object that was made without a spec
            spec = None
        place = None if spec is None else next(iter(spec.submodule_search_locations or ()), spec.origin)
        location = None if place is None else Path(place).resolve()
        if location is None or location != _HERE / name:
            hidden = f"is hidden by {location}; rename this file or folder, or run elsewhere"
            found = "is missing; install wbf-mission again" if location is None else hidden
            msg = f"wbf_mission: its package {name!r} {found}"
            # With this name, ``python -m wbf_mission`` prints the error in one line.
            raise ImportError(msg, name="wbf_mission", path=str(location))
