"""Imports at first use: public names of packages (PEP 562), entry points, and libraries of extras.

Importing a light module of a package then imports neither numpy nor shapely. A package names its public names
once, one a line, for the type checker, and `attach` reads these lines::

    if TYPE_CHECKING:
        from geo.farm import Farm as Farm
    else:
        __getattr__, __dir__, __all__ = attach(__name__)
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib import metadata


_PUBLIC = re.compile(r"^    from ([\w.]+) import (\w+) as \2$", re.MULTILINE)


def attach(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Make ``__getattr__``, ``__dir__`` and ``__all__`` of a package from the names in its source."""
    source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    homes = {name: module for module, name in _PUBLIC.findall(source)}
    public = sorted(homes)

    def __getattr__(name: str) -> object:  # noqa: N807 (is put into the package)
        if name not in homes:
            msg = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(msg, name=name, obj=sys.modules[package])
        value = getattr(importlib.import_module(homes[name]), name)
        # The next use finds it without this function.
        setattr(sys.modules[package], name, value)
        return value

    def __dir__() -> list[str]:  # noqa: N807
        return sorted({*vars(sys.modules[package]), *public})

    return __getattr__, __dir__, public


def entry_points(group: str) -> metadata.EntryPoints:
    """Return the entry points of a group; kept until ``sys.path`` or one of its folders changes.

    Examples
    --------
    >>> "spiral" in entry_points("wbf_mission.planners").names
    True
    """
    return _entry_points(group, tuple((folder, _changed_ns(folder)) for folder in sys.path))


def load_extra(module: str, extra: str, what: str, error: type[Exception]) -> Any:
    """Import a library of an extra; `error` if it is not installed, with `what` ("maps need") and the remedy.

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
    """Return the object of an entry point, named `what`; `error` if it cannot be imported."""
    try:
        return entry.load()
    except Exception as problem:  # code of others runs
        raise error(f"{what} ({entry.value}) cannot be loaded: {problem}") from problem


@lru_cache(maxsize=16)
def _entry_points(group: str, _path: tuple[tuple[str, int], ...]) -> metadata.EntryPoints:
    # Its import takes longer than all else here.
    from importlib import metadata

    return metadata.entry_points(group=group)


def _changed_ns(folder: str) -> int:
    try:
        return Path(folder).stat().st_mtime_ns
    except OSError:
        return 0
