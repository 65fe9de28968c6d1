"""Makes field sets from names of fields and from field files.

A field file is TOML with one or more tables ``[[field]]``, which `field_from_table` describes. Named fields
are the benchmark's fields and each `sensors.fields.Field` that a package registers in the entry point group
``wbf_mission.fields``. The key ``kind`` is "disease", "continuous", "smooth", "measured" (the default) or the
`ContinuousDynamics.kind` of a class registered in the group ``wbf_mission.dynamics``.

>>> load_field_set(["soil", "tylcv"])
FieldSet(soil, tylcv)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import msgspec

from geo.errors import WbfMissionError
from geo.imports import entry_points, load_entry
from geo.reading import UnreadableError, misfit, read_toml
from geo.texts import unknown
from sensors.dynamics.continuous import ContinuousDynamics, Measured, SmoothParameters
from sensors.dynamics.epidemic import EpidemicParameters
from sensors.dynamics.soil import SoilParameters
from sensors.errors import FieldError
from sensors.fields import ALL_CROPS, PAPER_FIELDS, Dynamics, Field, FieldSet

ENTRY_POINT_GROUP = "wbf_mission.fields"
DYNAMICS_GROUP = "wbf_mission.dynamics"

_DYNAMICS: dict[str, type[Dynamics]] = {
    dynamics.kind: dynamics for dynamics in (EpidemicParameters, SoilParameters, SmoothParameters, Measured)
}
_REQUIRED = ("name", "kind", "crops", "default")
"""Keys that a simulated field needs; a field that is only measured needs only ``name``."""


class _Table(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """The table of a field, as plain values."""

    name: str
    kind: str = Measured.kind
    crops: tuple[str, ...] = (ALL_CROPS,)
    default: float | None = None
    weight: float = 1.0
    cost_above: float = 1.0
    cost_below: float = 1.0
    title: str = ""
    unit: str = ""
    colours: tuple[str, ...] = ()
    range: tuple[float, float] = (0.0, 1.0)
    dynamics: dict[str, Any] = {}


def load_field_set(names_or_paths: Iterable[str], folder: str | Path = ".") -> FieldSet:
    """Make a field set from names of fields and from field files.

    Parameters
    ----------
    names_or_paths : iterable of str
        Names of fields (`field_names`), and paths of field files, which end in ``.toml``.
    folder : path-like
        Folder to which relative paths refer.

    Raises
    ------
    FieldError
        If a name is unknown, a file cannot be used, or a field is given twice.
    """
    found: list[Field] = []
    for item in names_or_paths:
        named = not item.lower().endswith(".toml")
        found += (_registered(item),) if named else read_fields(Path(folder) / item)
    return FieldSet(tuple(found))


def field_names() -> tuple[str, ...]:
    """Return the names of all fields: the benchmark's fields, then registered fields, sorted."""
    others = {point.name for point in entry_points(group=ENTRY_POINT_GROUP)} - set(PAPER_FIELDS.names)
    return (*PAPER_FIELDS.names, *sorted(others))


def read_fields(path: str | Path) -> tuple[Field, ...]:
    """Read the fields of a field file.

    If the file or a field in it cannot be used, raise FieldError, which names the file and the field.
    """
    path = Path(path)
    try:
        table = read_toml(path)
    except UnreadableError as error:
        raise FieldError(f"{path}: cannot be read as a field file: {error}") from None
    wrong = [key for key in table if key != "field"]
    tables = table.get("field")
    if wrong or not isinstance(tables, list) or not tables:
        found = f"unknown key {wrong[0]!r}" if wrong else "no table [[field]]"
        raise FieldError(f"{path}: {found}; a field file has one [[field]] for each field")
    return tuple(field_from_table(given, f"{path}: field {number}") for number, given in enumerate(tables, 1))


def field_from_table(table: Mapping[str, Any], where: str) -> Field:
    """Make a field from plain values, such as a table of a TOML file.

    Parameters
    ----------
    table : mapping
        The keys ``name``, ``kind`` (of the dynamics), ``crops`` and ``default`` are required, but a field
        without ``kind`` is only measured and needs only ``name``. The keys ``weight``, ``cost_above``,
        ``cost_below``, ``title``, ``unit``, ``range`` and ``colours`` are optional and as in
        `sensors.fields.Field`. The table ``dynamics`` has the parameters of the dynamics, such as
        `sensors.dynamics.epidemic.EpidemicParameters` (a disease needs ``likelihood`` and ``duration_days``)
        or `sensors.dynamics.soil.SoilParameters`. ``default`` is in the field's unit; the middle of the range
        if missing.
    where : str
        File and position in the file, with which error texts begin.

    Raises
    ------
    FieldError
        If a key is unknown or missing, or a value cannot be used.

    Examples
    --------
    >>> rust = {"name": "rust", "kind": "disease", "crops": ["tomato"], "default": 1.0}
    >>> field_from_table({**rust, "dynamics": {"likelihood": 0.2, "duration_days": 8}}, "here").kind
    'disease'
    """
    if not isinstance(table, Mapping):
        raise FieldError(f"{where}: is not a table; a field is a table [[field]]")
    needed = ("name",) if table.get("kind", Measured.kind) == Measured.kind else _REQUIRED
    missing = [key for key in needed if key not in table]
    if missing:
        raise FieldError(f"{where}: {missing[0]} is missing; a field needs {', '.join(needed)}")
    try:
        plain = msgspec.convert(table, _Table)
        dynamics = _convert_dynamics(plain.kind, plain.dynamics)
        same = ("weight", "cost_above", "cost_below", "title", "unit", "colours", "range")
        rest = {name: getattr(plain, name) for name in same}
        return Field(plain.name, dynamics, plain.crops, _part(plain.default, plain.range), **rest)
    except msgspec.ValidationError as error:
        raise FieldError(f"{where}: {misfit(error)}") from None
    except WbfMissionError as error:
        raise FieldError(f"{where}: {error}") from None


def field_to_table(field: Field) -> dict[str, Any]:
    """Return a field as a table of plain values, which `field_from_table` reads.

    A parameter of the dynamics that is None is left out, as TOML has no null.
    """
    table = {key.name: getattr(field, key.name) for key in fields(field)}
    table["kind"] = field.dynamics.kind
    table["crops"], table["colours"] = list(field.crops), list(field.colours)
    # Rounding removes the error of the unit conversion, so that an equal field is read back.
    table["default"] = float(f"{field.to_unit(field.default):.12g}")
    table["range"] = list(field.range)
    if field.range == (0.0, 1.0):
        table["default"] = field.default
        del table["range"]
    table["dynamics"] = {key: value for key, value in asdict(field.dynamics).items() if value is not None}
    return table


def _part(default: float | None, limits: tuple[float, float]) -> float:
    """Convert a default value from the field's unit to a fraction of the field's range."""
    low, high = limits
    if default is None or not low < high:
        return 0.5
    if not low <= default <= high:
        raise FieldError(f"default {default:g} is not in {low:g}..{high:g}")
    return (default - low) / (high - low)


def _convert_dynamics(kind: str, given: dict[str, Any]) -> Dynamics:
    dynamics = _DYNAMICS[kind] if kind in _DYNAMICS else _registered_dynamics(kind)
    known = [parameter.name for parameter in fields(dynamics)]
    wrong = next((name for name in given if name not in known), None)
    if wrong is not None:
        raise FieldError(f"dynamics of a {kind} field: {unknown('parameter', wrong, known)}")
    try:
        return msgspec.convert(given, dynamics)
    except msgspec.ValidationError as error:
        raise FieldError(misfit(error, "dynamics")) from None


def _registered(name: str) -> Field:
    if name in PAPER_FIELDS:
        return PAPER_FIELDS[name]
    found, where = _load(ENTRY_POINT_GROUP, name, "field")
    if not where:
        raise FieldError(unknown("field", name, field_names(), ", or give a file (.toml)"))
    if not isinstance(found, Field) or found.name != name:
        raise FieldError(f"{where} is not a sensors.fields.Field with this name")
    return found


def _registered_dynamics(kind: str) -> type[Dynamics]:
    found, where = _load(DYNAMICS_GROUP, kind, "dynamics")
    if not where:
        others = {point.name for point in entry_points(group=DYNAMICS_GROUP)}
        raise FieldError(unknown("kind", kind, (*_DYNAMICS, *sorted(others))))
    good = isinstance(found, type) and issubclass(found, ContinuousDynamics) and is_dataclass(found)
    if not good or found.kind != kind:
        raise FieldError(f"{where} is not a dataclass of ContinuousDynamics of this kind")
    return found


def _load(group: str, name: str, what: str) -> tuple[Any, str]:
    """Return a registered object and its description for errors, or (None, "") if there is none."""
    points = [point for point in entry_points(group=group) if point.name == name]
    if not points:
        return None, ""
    if len({point.value for point in points}) > 1:
        raise FieldError(f"{what} {name!r} is registered twice: {points[0].value} and {points[1].value}")
    where = f"{what} {name!r}"
    return load_entry(points[0], where, FieldError), f"{where} ({points[0].value})"
