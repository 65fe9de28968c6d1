"""The parameters that a real autopilot has besides those that do something here.

The lists are tables in ``lists/``: name, type, default, documented range, unit. Each begins with a note of
where its facts are from.
"""

from __future__ import annotations

import csv
import math
from functools import cache
from importlib.resources import files

from sim_vehicle.autopilot.mav_parameter import MavParameter

__all__ = ["reference_parameters"]


@cache
def reference_parameters(name: str, without: tuple[str, ...] = ()) -> tuple[MavParameter, ...]:
    """Read the list of a firmware.

    Parameters
    ----------
    name : str
        Name of its table: ``arducopter``, ``arduplane``, ``rover``, ``px4``.
    without : tuple of str
        Beginnings of names that this firmware does not have.

    Examples
    --------
    >>> [p.name for p in reference_parameters("px4") if p.name.startswith("GF_MAX")]
    ['GF_MAX_HOR_DIST', 'GF_MAX_VER_DIST']
    """
    text = files(__package__).joinpath("lists", f"{name}.csv").read_text(encoding="ascii")
    rows = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return tuple(_parameter(row) for row in rows if not row["name"].startswith(without))


def _parameter(row: dict[str, str]) -> MavParameter:
    kind = row["type"]
    integer = kind != "float"
    return MavParameter(
        row["name"],
        integer=integer,
        low=float(row["low"]) if row["low"] else -math.inf,
        high=float(row["high"]) if row["high"] else math.inf,
        value=float(row["default"]),
        stored=True,
        bits=int(kind.removeprefix("int")) if integer else 32,
        unit=row["unit"],
    )
