"""How near and how far apart the rows or rings of a path may be."""

from __future__ import annotations

import math

from mission.errors import PlanningError


def spacing_limits(
    planner: str, footprint_m: float, min_spacing_m: float | None, max_spacing_m: float | None
) -> tuple[float, float]:
    """Return the least and the greatest spacing that a planner may choose, metres.

    Parameters
    ----------
    planner : str
        Its name, for the error text.
    footprint_m : float
        Width of what the camera sees at once: rows are never closer than it.
    min_spacing_m, max_spacing_m : float or None
        What the planner was asked for; None: the footprint, and no limit.

    Returns
    -------
    tuple of float
        The second one is infinite without a limit.

    Raises
    ------
    PlanningError
        If one is no distance above zero, or the greatest is below the least.
    """
    for name, value in (("min_spacing_m", min_spacing_m), ("max_spacing_m", max_spacing_m)):
        if value is not None and not (is_number(value) and value > 0):
            msg = f"{planner}: {name} {value!r} is no distance in metres; give a number above zero"
            raise PlanningError(msg)
    least = max(footprint_m, min_spacing_m or 0.0)
    most = math.inf if max_spacing_m is None else max_spacing_m
    if most < least:
        reason = "the footprint" if least == footprint_m else "min_spacing_m"
        msg = f"{planner}: max_spacing_m {most:g} is less than {reason} of {least:g} m; give more"
        raise PlanningError(msg)
    return least, most


def is_number(value: object) -> bool:
    """Tell whether a planner's parameter is a finite number (True and False are none)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
