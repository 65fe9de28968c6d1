"""Kinds of vehicles, and names of autopilots.

`BUILT_IN` holds the kinds of the core. Packages register further kinds under the entry point group
``wbf_mission.vehicle_kinds`` (example in docs/vehicle-kinds.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib import resources
from itertools import chain
from typing import TYPE_CHECKING

from geo.imports import entry_named, entry_points, load_entry
from sim_vehicle.airframe.power_spec import AnyPowerSpec, PowerSpec
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from importlib.resources.abc import Traversable

AUTOPILOT_GROUP = "wbf_mission.autopilots"
"""Entry point group of autopilots; each entry is a `sim_vehicle.autopilot.Autopilot`."""
DEFAULT_AUTOPILOT = "px4"
NO_AUTOPILOT = "generic"
"""Autopilot name of a vehicle that no autopilot controls; it has the generic motion."""
KIND_GROUP = "wbf_mission.vehicle_kinds"
"""Entry point group of kinds; each entry is a `VehicleKind` that has the entry's name."""
# Kinds that the add-ons of this package provide, with their add-on and MAV_TYPE.
_ADDED = {"fixed-wing": ("wings", 1), "rover": ("rovers", 10)}
_VEHICLES = resources.files("sim_vehicle.airframe") / "vehicles"


class Movement(Enum):
    """Way in which a vehicle moves and holds its position."""

    HOVERS = "hovers"
    """The vehicle flies at any speed and can hover."""
    CIRCLES = "circles"
    """The vehicle flies and can hold its position only by circling; `FixedWingProcedures` move it."""
    DRIVES = "drives"
    """The vehicle stays on the ground or the water; take-offs and heights are ignored."""
    STEPS = "steps"
    """The vehicle steps from cell to cell (the paper's robot), without dynamics, autopilot or battery."""


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """A kind of vehicle.

    Examples
    --------
    >>> get_kind("multirotor").movement
    <Movement.HOVERS: 'hovers'>
    """

    name: str
    """Name of the kind in vehicle files, for autopilots, and as an entry point."""
    movement: Movement
    base: str
    """Name of the vehicle that supplies values missing from a vehicle file of this kind."""
    typical: str
    """Name of the vehicle to use if only the kind is known; its motion is compiled ahead of time."""
    vehicles: Traversable = _VEHICLES
    """Folder of vehicle files; the name of a file is the name of its vehicle."""
    power: type[AnyPowerSpec] | None = None
    """Class of ``[power]`` in vehicle files; None if vehicles of the kind use no energy."""
    airframe: type | None = None
    """Dataclass of ``[airframe]`` in vehicle files; None if the kind has no such table."""
    procedures: str = ""
    """``module:NAME`` of the `FlightProcedures` of vehicles without an autopilot; the module is imported when
    a vehicle first needs it. If this is empty, the procedures of the default autopilot are used."""
    firmwares: Mapping[str, str] = field(default_factory=dict)
    """``module:NAME`` of the `Firmware` that the kind provides for an autopilot which does not itself support
    the kind, by autopilot name."""
    shown_as: str = ""
    """Kind as which the vehicle appears on MAVLink if the autopilot has no firmware for the vehicle's kind;
    the procedures of its own kind still move the vehicle. If this is empty, the autopilot is refused."""
    mav_types: tuple[int, ...] = ()
    """MAV_TYPEs in heartbeats of this kind; a vehicle with a MAV_TYPE of no kind counts as a multirotor."""


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
"""Kinds of the core, by name."""


@cache
def kind_names() -> tuple[str, ...]:
    """Return the names of all kinds: the kinds of the core, then the kinds of packages, sorted.

    Examples
    --------
    >>> kind_names()[:2]
    ('multirotor', 'ideal')
    """
    return (*BUILT_IN, *sorted({entry.name for entry in entry_points(KIND_GROUP)} - BUILT_IN.keys()))


def get_kind(name: str) -> VehicleKind:
    """Return the vehicle kind with this name.

    Raises
    ------
    VehicleError
        If the kind does not exist, or its entry point is not a kind.
    """
    return BUILT_IN.get(name) or _registered(name)


@cache
def _registered(name: str) -> VehicleKind:
    entry = entry_named(KIND_GROUP, name)
    if entry is None:
        raise VehicleError(f"kind {name!r} is not one of {', '.join(kind_names())}{not_installed()}")
    found = load_entry(entry, f"vehicle kind {name}", VehicleError)
    if not isinstance(found, VehicleKind) or found.name != name:
        raise VehicleError(
            f"vehicle kind {name} ({entry.value}) is not a sim_vehicle.airframe.kind.VehicleKind of this name"
        )
    return found


def kind_of_type(mav_type: int) -> str:
    """Return the name of the kind with this MAV_TYPE, installed or not; "multirotor" if there is none."""
    installed = (name for name in kind_names() if mav_type in get_kind(name).mav_types)
    added = (name for name, (_, added_type) in _ADDED.items() if mav_type == added_type)
    return next(chain(installed, added), "multirotor")


def not_installed() -> str:
    """Return a note that lists missing add-ons, for errors about an unknown kind or vehicle."""
    missing = [
        f"{kind} (wbf_mission.addons.{addon})"
        for kind, (addon, _) in _ADDED.items()
        if kind not in kind_names()
    ]
    return f"; not installed: {', '.join(missing)}: install wbf-mission again" if missing else ""


def forget_kinds() -> None:
    """Clear the caches of kinds, so that a package installed at run time is found."""
    kind_names.cache_clear()
    _registered.cache_clear()


@cache
def autopilot_names() -> tuple[str, ...]:
    """Return the names of the installed autopilots, the default autopilot first, the others sorted.

    Examples
    --------
    >>> autopilot_names()[:2]
    ('px4', 'ardupilot')
    """
    names = {entry.name for entry in entry_points(group=AUTOPILOT_GROUP)}
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_AUTOPILOT, name)))
