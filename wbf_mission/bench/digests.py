"""Digests of scenarios, and of a user's planners, policies and estimators.

The digest of a user's object covers its state, its classes and functions, the user code that these refer to,
and the source files of all of them. Notebook code has no source file, so only its bytecode is covered.
"""

from __future__ import annotations

import dataclasses
import dis
import hashlib
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path, PurePath
from types import CellType, CodeType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import msgspec
import numpy as np
import shapely

from geo import Crop, Farm, Obstacle, Patch
from geo.errors import PACKAGES, is_users_file
from sensors.field_files import field_to_table, load_field_set
from sensors.fields import Field
from sim_vehicle.airframe.catalog import get_vehicle
from wbf_mission.own_code import below_own_code, digest_beside
from wbf_mission.scenario import Scenario

_ROWS = ("planner", "policy", "estimator", "seed")
# The digest covers the contents of these files and objects, not their names.
_FILES = ("farm", "crop", "farm_crs", "repair", "fields", "vehicle", "world")
_LABELS = ("title", "unit", "colours")  # Keys of a field's table on which no score depends


def meaning_of(scenario: Scenario) -> str:
    """Return the digest of a scenario: its farm, fields, vehicles, and options other than the defaults.

    Since defaults are left out, a new option changes no existing digest. A farm, field, world or vehicle file
    counts by its contents, not by its name.

    WbfMissionError if the farm, a field or a vehicle is unknown.
    """
    defaults = Scenario().to_dict()
    options = {
        key: value
        for key, value in scenario.to_dict().items()
        if key not in (*_ROWS, *_FILES) and value != defaults[key]
    }
    fields, world = load_field_set(scenario.farm.fields), scenario.farm.load_world()
    return digest(
        {
            "options": options,
            "farm": _farm(scenario.farm.load()),
            "fields": [_field(field) for field in fields],
            "vehicles": [_vehicle(name) for name in scenario.vehicle.fleet],
            **({} if world is None else {"world": world.to_table()}),
        }
    )


def digest(values: Any) -> str:
    """Return the first 96 bits of a SHA-256 over plain values, as hexadecimal digits."""
    text = msgspec.json.encode(values, order="deterministic", enc_hook=str)
    return hashlib.sha256(text).hexdigest()[:24]


def own_digest(made: Any) -> str:
    """Return the digest of a user's function or object, from its code and its state.

    Examples
    --------
    >>> own_digest(lambda: 1) == own_digest(lambda: 1), own_digest([1.0]) == own_digest([9.0])
    (True, False)
    """
    return digest(_Plain().of(made))


def is_own(module: str | None) -> bool:
    """Return whether a module is user code, and not part of this program, Python or an installed package."""
    name = module or "builtins"
    top = name.partition(".")[0]
    if name in ("__main__", "__mp_main__"):
        return True
    if top in PACKAGES or top in sys.stdlib_module_names:
        return False
    file = _file_of(name)
    if file is None:
        return name in sys.modules
    return is_users_file(str(file))


def _file_of(module: str) -> Path | None:
    file = getattr(sys.modules.get(module), "__file__", None)
    return None if file is None else Path(file).absolute()


@cache
def _of_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


class _Plain:
    """Converts objects to plain values; in any process, equal code and state give equal values."""

    def __init__(self) -> None:
        self._open: set[int] = set()
        # Converted objects are kept alive, so that no other object gets their id.
        self._done: dict[int, tuple[Any, Any]] = {}
        # Cached: a file has many functions, and the files beside it do not change during the digest.
        self._beside = cache(digest_beside)

    def of(self, value: Any) -> Any:
        """Return the plain values of any object."""
        kind = type(value)
        if isinstance(value, str | PurePath) and PurePath(value).is_absolute():
            return [kind.__name__, below_own_code(str(value))]
        if value is None or kind in (bool, int, float, complex, str, bytes):
            return [kind.__name__, repr(value)]
        number = id(value)
        if number in self._open:
            return ["again"]
        if number not in self._done:
            self._open.add(number)
            self._done[number] = value, [kind.__qualname__, self._parts(value)]
            self._open.discard(number)
        return self._done[number][1]

    def _parts(self, value: Any) -> Any:
        if isinstance(value, np.ndarray) and not value.dtype.hasobject:
            return [value.dtype.str, list(value.shape), hashlib.sha256(value.tobytes()).hexdigest()]
        if isinstance(value, list | tuple) and type(value) in (list, tuple):
            return self._all(value)
        if type(value) in (dict, MappingProxyType):
            return [self._all(pair) for pair in value.items()]
        if isinstance(value, set | frozenset):
            return sorted(own_digest(item) for item in value)
        if isinstance(value, ModuleType):
            return self._where(value.__name__, value.__name__)
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, FunctionType):
            return self._function(value)
        if isinstance(value, CodeType):
            return [value.co_code.hex(), list(value.co_names), self._all(value.co_consts)]
        if isinstance(value, MethodType | staticmethod | classmethod):
            return self._all((value.__func__, getattr(value, "__self__", None)))
        if isinstance(value, property):
            return self._all((value.fget, value.fset, value.fdel))
        for wrapped in ("py_func", "__wrapped__"):  # attributes set by numba and by functools
            if callable(value) and isinstance(getattr(value, wrapped, None), FunctionType):
                return self.of(getattr(value, wrapped))
        return self._reduced(value)

    def _all(self, values: Iterable[Any]) -> list[Any]:
        return [self.of(value) for value in values]

    def _reduced(self, value: Any) -> Any:
        """Return the plain values of the parts that pickle would store."""
        try:
            reduced = value.__reduce_ex__(4)
        except Exception:  # the digest of an object that cannot be pickled covers only its class
            return self.of(type(value))
        if isinstance(reduced, str):
            return [self.of(type(value)), reduced]
        return [self._all(part) if isinstance(part, Iterator) else self.of(part) for part in reduced]

    def _where(self, module: str, name: str) -> list[str]:
        """Return the name of a class or function, and its file's digest (none in this program and Python)."""
        top = module.partition(".")[0]
        file = None if top in PACKAGES or top in sys.stdlib_module_names else _file_of(module)
        if not is_own(module):
            return [f"{module}.{name}", "" if file is None else _of_file(file)]
        # The digest of a user's module covers its file and the files beside it, but not its name, which
        # depends on the folder. For a script (``__main__``) the digest omits the files beside it, which the
        # script may have written.
        beside = "" if file is None or module in ("__main__", "__mp_main__") else self._beside(file)
        return [name, "" if file is None else _of_file(file), *([beside] if beside else [])]

    def _class(self, kind: type) -> Any:
        where = self._where(kind.__module__, kind.__qualname__)
        if not is_own(kind.__module__):
            return where
        held = {key: value for key, value in vars(kind).items() if key not in _NO_CODE}
        return [where, self._all(kind.__bases__), [[key, self.of(held[key])] for key in sorted(held)]]

    def _function(self, function: FunctionType) -> Any:
        module = function.__module__ or ""
        where = self._where(module, function.__qualname__)
        if not is_own(module):
            return where
        cells = [cell.cell_contents for cell in function.__closure__ or () if cell != CellType()]
        named = sorted(name for name in _global_names(function.__code__) if name in function.__globals__)
        used = [[name, self.of(function.__globals__[name])] for name in named]
        given = self._all((function.__defaults__, function.__kwdefaults__))
        return [where, self.of(function.__code__), given, self._all(cells), used]


_NO_CODE = frozenset(
    (
        "__dict__",
        "__weakref__",
        "__doc__",
        "__module__",
        "__annotations__",
        "__abstractmethods__",
        "_abc_impl",
    )
)


def _global_names(code: CodeType) -> set[str]:
    """Return the names of globals used by `code` and by functions nested in it."""
    names = {
        step.argval for step in dis.get_instructions(code) if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    return names.union(*(_global_names(const) for const in code.co_consts if isinstance(const, CodeType)))


def _field(field: Field) -> dict[str, Any]:
    chosen = _chosen(field)
    plain = field_to_table(field)
    table = {key: plain[key] for key in chosen if key in plain and key not in _LABELS}
    return {**table, "kind": plain["kind"], "dynamics": chosen["dynamics"]}


def _vehicle(name: str) -> dict[str, Any]:
    chosen = _chosen(get_vehicle(name))
    return {key: value for key, value in chosen.items() if key not in ("name", "description")}


def _chosen(value: Any) -> Any:
    """Return the fields of a dataclass that differ from their defaults, recursively."""
    if not dataclasses.is_dataclass(value):
        return value
    held = {item.name: (getattr(value, item.name), item.default) for item in dataclasses.fields(value)}
    return {name: _chosen(given) for name, (given, default) in held.items() if given != default}


def _farm(farm: Farm) -> dict[str, Any]:
    frame = farm.frame
    return {
        "cells": [farm.width_cells, farm.height_cells, farm.cell_size_m],
        "origin": [frame.latitude_deg, frame.longitude_deg, frame.altitude_m, frame.rotation_deg],
        "home": list(farm.home_m),
        "patches": [
            [shapely.to_wkt(each.polygon, rounding_precision=6), _crop(farm, each), each.owner == farm.owner]
            for each in farm.patches
        ],
        "obstacles": [_obstacle(obstacle) for obstacle in farm.obstacles],
    }


def _crop(farm: Farm, patch: Patch) -> int | str:
    """Return the number of a built-in crop, or the name of a user's crop."""
    number = farm.crops.index(patch.crop)
    return number if number < len(Crop) else patch.crop


def _obstacle(obstacle: Obstacle) -> Any:
    outline = shapely.to_wkt(obstacle.polygon, rounding_precision=6)
    height_m, margin_m = obstacle.height_m, obstacle.margin_m
    return outline if height_m is margin_m is None else [outline, height_m, margin_m]
