"""Packages whose public names are imported when they are first used (PEP 562).

Importing one light module of a package then does not import numpy or shapely for all the others. A package
names the modules twice: for the type checker, which sees plain imports, and for `attach`::

    if TYPE_CHECKING:
        from geo.farm import Farm as Farm
    else:
        __getattr__, __dir__, __all__ = attach(__name__, {"geo.farm": ("Farm",)})
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterable, Mapping


def attach(
    package: str, modules: Mapping[str, Iterable[str]]
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Make ``__getattr__``, ``__dir__`` and ``__all__`` of a package."""
    homes = {name: module for module, names in modules.items() for name in names}
    public = sorted(homes)

    def __getattr__(name: str) -> object:  # noqa: N807 (is put into the package)
        if name not in homes:
            msg = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(msg, name=name, obj=sys.modules[package])
        value = getattr(importlib.import_module(homes[name]), name)
        # The next use finds it without coming here.
        setattr(sys.modules[package], name, value)
        return value

    def __dir__() -> list[str]:  # noqa: N807
        return sorted({*vars(sys.modules[package]), *public})

    return __getattr__, __dir__, public
