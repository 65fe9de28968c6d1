"""Vehicle files: TOML files with the fields of `VehicleSpec` and a table for each part of the vehicle.

The files of the built-in vehicles are in ``sim_vehicle/airframe/vehicles``.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geo.reading import UnreadableError, read_toml
from geo.texts import unknown
from sim_vehicle.airframe.kind import autopilot_names, forget_kinds, get_kind, kind_names, not_installed
from sim_vehicle.airframe.power_spec import BatterySpec
from sim_vehicle.airframe.spec import PublishedEndurance, VehicleSpec
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

_DEFAULT = "quad"
# Fields that a vehicle file cannot set. The file name is the vehicle's name; a scenario sets the rest.
_NOT_IN_FILES = ("name", "autopilot", "parameters", "return_margin_m", "autopilot_parameters")
_PARAMETER = re.compile(r"[A-Z][A-Z0-9_]{0,15}")


@cache
def vehicle_names() -> tuple[str, ...]:
    """Return the names of the vehicles of all installed kinds, the default vehicle first."""
    return tuple(sorted(_files(), key=lambda name: (name != _DEFAULT, name == "ideal", name)))


@cache
def _files() -> dict[str, Traversable]:
    """Return the vehicle files of all kinds by vehicle name; built-in kinds take precedence."""
    files: dict[str, Traversable] = {}
    for folder in dict.fromkeys(get_kind(kind).vehicles for kind in kind_names()):
        for entry in folder.iterdir():
            if entry.name.endswith(".toml"):
                files.setdefault(entry.name.removesuffix(".toml"), entry)
    return files


def forget_vehicles() -> None:
    """Clear the caches of kinds and vehicle files, so that a package installed at run time is found."""
    forget_kinds()
    for known in (vehicle_names, _files, _packaged):
        known.cache_clear()


def get_vehicle(name: str) -> VehicleSpec:
    """Return a vehicle by its name, or read it from a TOML file.

    Parameters
    ----------
    name : str
        One of `vehicle_names`, or a path that ends in ``.toml``.

    Raises
    ------
    VehicleError
        If the vehicle does not exist, or the file is not a vehicle file.

    Examples
    --------
    >>> get_vehicle("Quad").cruise_speed_m_s
    8.0
    """
    if name.lower().endswith(".toml"):
        return load_vehicle(Path(name))
    if name.lower() not in vehicle_names():
        more = f", or give a file (.toml){not_installed()}"
        raise VehicleError(unknown("vehicle", name, vehicle_names(), more))
    return _packaged(name.lower())


@cache
def _packaged(name: str) -> VehicleSpec:
    data = tomllib.loads(_files()[name].read_text(encoding="utf-8"))
    return _build(f"vehicle {name}", name, data, VehicleSpec(name, kind=data.get("kind", "multirotor")))


def load_vehicle(path: Path) -> VehicleSpec:
    """Return the vehicle that a vehicle file describes.

    The keys are fields of `VehicleSpec`. The tables are ``[battery]``, ``[power]``, ``[airframe]``,
    ``[published]``, and a table of parameters for each autopilot (``[px4]``, ``[ardupilot]``). Values missing
    from the file are those of the vehicle that the key ``base`` names, by default the kind's base vehicle.

    Raises
    ------
    VehicleError
        If the file cannot be read, is not TOML, is empty, or has unknown keys or invalid values.
    """
    where = f"vehicle file {path}"
    try:
        data = read_toml(path)
    except UnreadableError as error:
        raise VehicleError(f"{where}: {error}") from None
    if not data:
        bases = ", ".join(vehicle_names())
        msg = f"{where} is empty: give at least kind ({', '.join(kind_names())}) or base ({bases})"
        raise VehicleError(msg)
    kind = data.get("kind", "multirotor" if "base" not in data else None)
    if kind is not None and kind not in kind_names():
        raise VehicleError(f"{where}: kind {kind!r} is not one of {', '.join(kind_names())}{not_installed()}")
    name = str(data.pop("base") if kind is None or "base" in data else get_kind(kind).base).lower()
    if name not in vehicle_names():
        raise VehicleError(f"{where}: base must be one of {', '.join(vehicle_names())}")
    base = replace(_packaged(name), published=None, description="")
    if kind is not None and kind != base.kind:
        msg = f"{where}: kind {kind} does not fit base {name}, which is a {base.kind}: leave out kind or base"
        raise VehicleError(msg)
    return _build(where, path.stem, data, base)


def _build(where: str, name: str, data: dict[str, Any], base: VehicleSpec) -> VehicleSpec:
    """Return a vehicle with the values of a vehicle file; `base` supplies the missing values."""
    changes: dict[str, Any] = {"name": name}
    own = dict(base.autopilot_parameters)
    known = {f.name for f in fields(VehicleSpec) if f.name not in _NOT_IN_FILES}
    try:
        for key, value in data.items():
            if key in autopilot_names():
                own[key] = _parameters(key, value, base.parameters_for(key))
            elif key not in known:
                raise VehicleError(unknown("key", key, sorted(known)))
            elif key in ("battery", "power", "airframe", "published"):
                changes[key] = _part(key, value, base)
            elif isinstance(getattr(base, key), str) != isinstance(value, str):
                raise VehicleError(f"{key} {value!r} has the wrong type")
            else:
                changes[key] = value
        return replace(base, **changes, autopilot_parameters=tuple(own.items()))
    except VehicleError as error:
        raise VehicleError(f"{where}: {error}") from None


def _part(key: str, value: object, base: VehicleSpec) -> object:
    """Return the battery, power model, airframe or published endurance that a table describes."""
    types = {
        "battery": BatterySpec,
        "published": PublishedEndurance,
        "power": base.vehicle_kind.power,
        "airframe": base.vehicle_kind.airframe,
    }
    kind = types[key]
    if kind is None:
        raise VehicleError(f"a vehicle of kind {base.kind} has no [{key}]")
    if not isinstance(value, dict):
        raise VehicleError(f"{key} must be a table")
    known = {f.name: f.type for f in fields(kind)}
    for name, entry in value.items():
        if name not in known:
            raise VehicleError(f"[{key}]: {unknown('key', name, known)}")
        if isinstance(entry, bool) or isinstance(entry, str) != (known[name] in ("str", str)):
            raise VehicleError(f"[{key}] {name} {entry!r} has the wrong type")
    before = getattr(base, key)
    try:
        return kind(**value) if before is None else replace(before, **value)
    except TypeError as error:
        raise VehicleError(f"[{key}]: {error}") from None


def _parameters(
    key: str, value: object, base: tuple[tuple[str, float], ...]
) -> tuple[tuple[str, float], ...]:
    """Return the parameters of `base`, updated by the parameters in an autopilot's table."""
    if not isinstance(value, dict):
        raise VehicleError(f"{key} must be a table of parameters")
    for name, number in value.items():
        if not _PARAMETER.fullmatch(name):
            msg = f"[{key}] {name!r} is not a parameter name: use a capital, then 0 to 15 capitals, digits, _"
            raise VehicleError(msg)
        if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) < 1e9:
            raise VehicleError(f"[{key}] {name} {number!r} is not a number from -1e9 to 1e9")
    return tuple({**dict(base), **{name: float(number) for name, number in value.items()}}.items())
