"""What ``wbf-mission sim`` can be told, by options or by a scenario file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import msgspec

from sim_vehicle.faults.fault import Fault, faults_of
from wbf_mission.scenario import Scenario, ScenarioError, read_table, scenario_from_table

__all__ = ["SimOptions", "load_sim", "parse_speed"]

_SLOWEST, _FASTEST = 0.01, 10_000.0


@dataclass(frozen=True, slots=True)
class SimOptions:
    """The simulator besides its scenario; the keys of the table ``[sim]`` of a file.

    Parameters
    ----------
    count : int or None
        How many vehicles; None: as many as there are homes.
    home : tuple of str
        Start places, ``LAT,LON[,ALT[,HEADING]]``.
    spacing_m : float
        Between vehicles that share a home.
    listen, connect : tuple of str
        Links; none: the autopilot's own simulator's ports.
    speed : float or str
        Simulated seconds per second, or "max".
    duration_s : float or None
        When to stop, in simulated seconds.
    camera : bool
        Whether the vehicles carry leaf cameras.
    """

    count: int | None = None
    home: tuple[str, ...] = ()
    spacing_m: float = 4.0
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    speed: float | str = 1.0
    duration_s: float | None = None
    camera: bool = True

    def __post_init__(self) -> None:
        parse_speed(self.speed)
        if self.duration_s is not None and not 0.0 < self.duration_s < 1e9:
            msg = f"duration {self.duration_s} is out of range: give a positive number of simulated seconds"
            raise ScenarioError(msg)


def parse_speed(speed: float | str) -> float:
    """Return a speed as a number; "max" is infinity.

    Raises
    ------
    ScenarioError
        If it is neither "max" nor a number from 0.01 to 10000.

    Examples
    --------
    >>> parse_speed("max"), parse_speed("2.5")
    (inf, 2.5)
    """
    if isinstance(speed, str) and speed.strip().lower() == "max":
        return math.inf
    try:
        number = float(speed)
    except ValueError:
        number = math.nan
    if not _SLOWEST <= number <= _FASTEST:
        msg = f"speed {speed} is out of range: give {_SLOWEST:g} to {_FASTEST:g} (1 is real time), or max"
        raise ScenarioError(msg)
    return number


def load_sim(path: str | Path) -> tuple[Scenario, SimOptions, tuple[Fault, ...]]:
    """Read a scenario file for the simulator: a scenario's keys, a table ``[sim]``, tables ``[[fault]]``.

    Raises
    ------
    ScenarioError
        If the file cannot be read, or something in it is wrong.
    FaultError
        If a fault is wrong.
    """
    path = Path(path)
    table = read_table(path)
    faults = faults_of(table, str(path))
    table.pop("fault", None)
    given = table.pop("sim", {})
    scenario = scenario_from_table(table, path)
    known = [field.name for field in fields(SimOptions)]
    if not isinstance(given, dict):
        msg = f"{path}: sim is written as a table [sim]"
        raise ScenarioError(msg)
    unknown = sorted(set(given) - set(known))
    if unknown:
        msg = f"{path}: unknown key {unknown[0]!r} in [sim]; known keys are {', '.join(known)}"
        raise ScenarioError(msg)
    try:
        return scenario, msgspec.convert(given, SimOptions), faults
    except (msgspec.ValidationError, ScenarioError) as error:
        msg = f"{path}: {error}"
        raise ScenarioError(msg) from error


def sim_with(base: SimOptions, changes: dict[str, Any]) -> SimOptions:
    """Return ``base`` with those of ``changes`` that are given (neither None nor empty)."""
    return replace(
        base, **{key: value for key, value in changes.items() if value is not None and value != ()}
    )
