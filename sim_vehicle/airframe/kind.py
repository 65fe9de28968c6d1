"""Kinds of vehicles, each one value that holds all facts of its kind, and the names of the autopilots.

Those of the package are in `BUILT_IN`; packages register others under the entry point group
``wbf_mission.vehicle_kinds`` (docs/vehicle-kinds.md shows one).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib import resources
from itertools import chain
from typing import TYPE_CHECKING

from geo.imports import entry_points, load_entry
from sim_vehicle.airframe.power_spec import AnyPowerSpec, PowerSpec
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from importlib.resources.abc import Traversable

__all__ = [
    "AUTOPILOT_GROUP",
    "BUILT_IN",
    "DEFAULT_AUTOPILOT",
    "KIND_GROUP",
    "NO_AUTOPILOT",
    "Movement",
    "VehicleKind",
    "autopilot_names",
    "forget_kinds",
    "get_kind",
    "kind_names",
    "kind_of_type",
    "not_installed",
]

AUTOPILOT_GROUP = "wbf_mission.autopilots"
"""The entry point group; each entry is a `sim_vehicle.autopilot.autopilot.Autopilot`."""
DEFAULT_AUTOPILOT = "px4"
NO_AUTOPILOT = "generic"
"""Autopilot of a vehicle with the generic motion; no installed autopilot."""
KIND_GROUP = "wbf_mission.vehicle_kinds"
"""The entry point group; each entry is a `VehicleKind` of the entry's name."""
# The kinds that add-ons of this package bring: the add-on, and the MAV_TYPE.
_ADDED = {"fixed-wing": ("wings", 1), "rover": ("rovers", 10)}
_VEHICLES = resources.files("sim_vehicle.airframe") / "vehicles"


class Movement(Enum):
    """How a vehicle moves and stays where it is."""

    HOVERS = "hovers"
    """It flies at any speed, and stays anywhere."""
    CIRCLES = "circles"
    """It flies, and stays only by circling; `FixedWingProcedures` move it."""
    DRIVES = "drives"
    """It stays on the ground or the water: it does not take off, and heights do not count."""
    STEPS = "steps"
    """From cell to cell, as the paper's robot does, without dynamics, autopilot and battery."""


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """A kind of vehicle.

    Examples
    --------
    >>> get_kind("multirotor").movement
    <Movement.HOVERS: 'hovers'>
    """

    name: str
    """Its name in vehicle files and autopilots; that of its entry point."""
    movement: Movement
    base: str
    """The vehicle whose values hold where a vehicle file of this kind has none."""
    typical: str
    """The vehicle that flies where only the kind is known, and for which its motion is compiled ahead."""
    vehicles: Traversable = _VEHICLES
    """The folder with its vehicle files; each vehicle there is known by the name of its file."""
    power: type[AnyPowerSpec] | None = None
    """Class of ``[power]`` in vehicle files. None uses no energy."""
    airframe: type | None = None
    """Class of ``[airframe]`` in vehicle files, a dataclass; None has no such table."""
    procedures: str = ""
    """The `FlightProcedures` that move it without an autopilot, as ``module:NAME``, imported when it moves;
    without any, those of the default autopilot do."""
    firmwares: Mapping[str, str] = field(default_factory=dict)
    """By the names of autopilots that have no `Firmware` for this kind, one with which they fly it, as
    ``module:NAME``."""
    shown_as: str = ""
    """The kind whose firmware shows it to peers where an autopilot has none for this one; its own procedures
    move it then. Without, such an autopilot is refused."""
    mav_types: tuple[int, ...] = ()
    """The MAV_TYPE of heartbeats by which it is known; a multirotor has all that no other has."""


BUILT_IN = {
    kind.name: kind
    for kind in (
        VehicleKind(
            "multirotor",
            Movement.HOVERS,
            base="quad",
            typical="quad",
            power=PowerSpec,
            procedures="sim_vehicle.autopilot.procedures:GENERIC",
        ),
        VehicleKind(
            "ideal",
            Movement.STEPS,
            base="ideal",
            typical="ideal",
            procedures="sim_vehicle.autopilot.procedures:GENERIC",
            shown_as="multirotor",
        ),
    )
}
"""The kinds of the core, by name."""


@cache
def kind_names() -> tuple[str, ...]:
    """Return the names of all kinds: those of the package, then those of others, sorted.

    Examples
    --------
    >>> kind_names()[:2]
    ('multirotor', 'ideal')
    """
    return (*BUILT_IN, *sorted({entry.name for entry in entry_points(KIND_GROUP)} - BUILT_IN.keys()))


def get_kind(name: str) -> VehicleKind:
    """Return a kind of vehicle by its name.

    Raises
    ------
    VehicleError
        If there is none of that name, or its package does not give one.
    """
    return BUILT_IN.get(name) or _registered(name)


@cache
def _registered(name: str) -> VehicleKind:
    entry = next((entry for entry in entry_points(KIND_GROUP) if entry.name == name), None)
    if entry is None:
        raise VehicleError(f"kind {name!r} is not one of {', '.join(kind_names())}{not_installed()}")
    found = load_entry(entry, f"vehicle kind {name}", VehicleError)
    if not isinstance(found, VehicleKind) or found.name != name:
        raise VehicleError(
            f"vehicle kind {name} ({entry.value}) is no sim_vehicle.airframe.kind.VehicleKind of this name"
        )
    return found


def kind_of_type(mav_type: int) -> str:
    """Return the kind that has a MAV_TYPE, installed or not; a multirotor has all that no other has."""
    installed = (name for name in kind_names() if mav_type in get_kind(name).mav_types)
    added = (name for name, (_, added_type) in _ADDED.items() if mav_type == added_type)
    return next(chain(installed, added), "multirotor")


def not_installed() -> str:
    """Return the end of an error about an unknown kind or vehicle: which of this package's are missing."""
    missing = [
        f"{kind} (wbf_mission.addons.{addon})"
        for kind, (addon, _) in _ADDED.items()
        if kind not in kind_names()
    ]
    return f"; not installed: {', '.join(missing)}: install wbf-mission again" if missing else ""


def forget_kinds() -> None:
    """Find the kinds of packages again, after one was installed while the program runs."""
    kind_names.cache_clear()
    _registered.cache_clear()


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
