"""The parameters that a real autopilot has besides those that do something here.

The lists are tables in ``lists/``: name, type, default, documented range, unit. Each begins with a note of
where its facts are from. What an autopilot tells of its parameters besides is in tables of their own, which
are read when somebody asks.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from sim_vehicle.autopilot.mav_parameter import MavParameter

__all__ = ["ParameterDetails", "parameter_details", "reference_parameters"]


@dataclass(frozen=True, slots=True)
class ParameterDetails:
    """What an autopilot tells of one parameter for those who edit it."""

    group: str
    """Heading under which ground stations show it."""
    # The range that the autopilot documents, in the parameter's unit; infinite where it documents none.
    low: float = -math.inf
    high: float = math.inf
    decimals: int | None = None
    """Decimal places to show."""
    increment: float | None = None
    """Step of an editor, in the parameter's unit."""
    reboot: bool = False
    """Whether a change needs a reboot."""
    values: tuple[tuple[int, str], ...] = ()
    """The values that there are, with short names; empty for any."""
    bits: tuple[tuple[int, str], ...] = ()
    """The bits that there are, counted from 0, with short names; empty for no bit mask."""


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
    return tuple(_parameter(row) for row in _rows(name) if not row["name"].startswith(without))


@cache
def parameter_details(name: str) -> Mapping[str, ParameterDetails]:
    """Read what the autopilot of a list tells of its parameters, by their names.

    Parameters
    ----------
    name : str
        Name of the list: ``px4``.

    Examples
    --------
    >>> details = parameter_details("px4")["GF_ACTION"]
    >>> details.group, details.values[2], details.high
    ('Geofence', (2, 'Hold mode'), 5.0)
    """
    choices: dict[str, dict[str, list[tuple[int, str]]]] = {}
    for row in _rows(f"{name}-choices"):
        kinds = choices.setdefault(row["choices"], {"value": [], "bit": []})
        kinds[row["kind"]].append((int(row["number"]), row["label"]))
    ranges = {parameter.name: (parameter.low, parameter.high) for parameter in reference_parameters(name)}
    details = {}
    for row in _rows(f"{name}-details"):
        kinds = choices.get(row["choices"], {"value": [], "bit": []})
        low, high = ranges.get(row["name"], (-math.inf, math.inf))
        details[row["name"]] = ParameterDetails(
            row["group"],
            low=low,
            high=high,
            decimals=int(row["decimals"]) if row["decimals"] else None,
            increment=float(row["increment"]) if row["increment"] else None,
            reboot=row["reboot"] == "yes",
            values=tuple(kinds["value"]),
            bits=tuple(kinds["bit"]),
        )
    return MappingProxyType(details)


def _rows(table: str) -> Iterator[dict[str, str]]:
    text = files(__package__).joinpath("lists", f"{table}.csv").read_text(encoding="utf-8")
    return csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))


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
