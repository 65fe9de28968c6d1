"""Lazy imports of public names of packages (PEP 562), of entry points and of optional libraries.

Because of this, importing a light module of a package imports neither numpy nor shapely. A package lists its
public names for the type checker, one per line, and `attach` reads these lines::

    if TYPE_CHECKING:
        from geo.farm import Farm as Farm
    else:
        __getattr__, __dir__, __all__ = attach(__name__)
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable, Collection
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib import metadata


_PUBLIC = re.compile(r"^    from ([\w.]+) import (\w+) as \2$", re.MULTILINE)


def attach(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package for the public names that it lists."""
    source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    homes = {name: module for module, name in _PUBLIC.findall(source)}
    public = sorted(homes)

    def load(name: str) -> object:
        value = getattr(importlib.import_module(homes[name]), name)
        # Once the name is set, Python does not call __getattr__ for it again.
        setattr(sys.modules[package], name, value)
        return value

    def __dir__() -> list[str]:  # noqa: N807
        return sorted({*vars(sys.modules[package]), *public})

    return loader_of(package, homes, load), __dir__, public


def loader_of(module: str, names: Collection[str], load: Callable[[str], object]) -> Callable[[str], object]:
    """Return ``__getattr__`` of a module (PEP 562), which loads each of `names` at its first use."""

    def __getattr__(name: str) -> object:  # noqa: N807 (assigned in the module)
        if name not in names:
            msg = f"module {module!r} has no attribute {name!r}"
            raise AttributeError(msg, name=name, obj=sys.modules[module])
        return load(name)

    return __getattr__


def entry_points(group: str) -> metadata.EntryPoints:
    """Return the entry points of a group; they are cached until ``sys.path`` or a folder in it changes.

    Examples
    --------
    >>> "spiral" in entry_points("wbf_mission.planners").names
    True
    """
    return _entry_points(group, tuple((folder, _changed_ns(folder)) for folder in sys.path))


def entry_named(group: str, name: str) -> metadata.EntryPoint | None:
    """Return the group's entry point with this name, or None if no installed package has it."""
    return next((entry for entry in entry_points(group) if entry.name == name), None)


def load_extra(module: str, extra: str, what: str, error: type[Exception]) -> Any:
    """Import an optional library, or raise `error` with a text that begins with `what` ("maps need").

    Examples
    --------
    >>> load_extra("no_such_library.part", "gis", "maps need", ValueError)
    Traceback (most recent call last):
    ...
    ValueError: maps need no_such_library; install it with: pip install "wbf-mission[gis]"
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        name = module.partition(".")[0]
        raise error(f'{what} {name}; install it with: pip install "wbf-mission[{extra}]"') from None


def load_entry(entry: metadata.EntryPoint, what: str, error: type[Exception]) -> Any:
    """Return an entry point's object, or raise `error` with a text that begins with `what`."""
    try:
        return entry.load()
    except Exception as problem:  # Imported code may raise any exception
        raise error(f"{what} ({entry.value}) cannot be loaded: {problem}") from problem


@lru_cache(maxsize=16)
def _entry_points(group: str, _path: tuple[tuple[str, int], ...]) -> metadata.EntryPoints:
    # The import is here because it takes longer than importing the rest of this module.
    from importlib import metadata

    return metadata.entry_points(group=group)


def _changed_ns(folder: str) -> int:
    try:
        return Path(folder).stat().st_mtime_ns
    except OSError:
        return 0


def load_named(group: str, name: str, verb: str, what: str, error: type[Exception]) -> Any:
    """Return the object of the entry point `name`, or raise `error` if it is missing or importing fails.

    Examples
    --------
    >>> load_named("wbf_mission.pages", "none", "brings the page", "the page", ValueError)
    Traceback (most recent call last):
    ...
    ValueError: no installed package brings the page 'none' (wbf_mission.pages): install...
    """
    entry = entry_named(group, name)
    if entry is None:
        raise error(f"no installed package {verb} '{name}' ({group}): install wbf-mission again")
    return load_entry(entry, f"{what} {name}", error)
