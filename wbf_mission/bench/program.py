"""Identity of the running program; a worker with another program would produce other rows."""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.metadata
import platform
from collections.abc import Mapping
from pathlib import Path

from geo.errors import PACKAGES
from wbf_mission.version import __version__

_LIBRARIES = ("numpy", "scipy", "numba", "shapely")
_SOURCES = frozenset({".py", ".csv", ".npz", ".toml", ".geojson"})
_CODE = "code of wbf-mission"


@functools.cache
def program() -> Mapping[str, str]:
    """Return the versions and the source digest on which rows depend."""
    return {"wbf-mission": __version__, **libraries(), _CODE: _sources()}


def libraries() -> dict[str, str]:
    """Return the versions of the interpreter and of the libraries that affect the last bits of a row."""
    return {
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "C library": " ".join(platform.libc_ver()),
        **{name: importlib.metadata.version(name) for name in _LIBRARIES},
    }


def _sources() -> str:
    digest = hashlib.sha256()
    for name in PACKAGES:
        (root,) = importlib.import_module(name).__path__
        for path in sorted(file for file in Path(root).rglob("*") if file.suffix in _SOURCES):
            content = path.read_bytes()
            digest.update(f"{name}/{path.relative_to(root).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()[:12]


def unlike(theirs: Mapping[str, str]) -> str:
    """Return the differences between this program and another, in words; empty if there are none.

    >>> unlike(program()), unlike({**program(), "numpy": "1.0"}).startswith("it has numpy ")
    ('', True)
    """
    ours = program()
    keys = [key for key in dict.fromkeys([*theirs, *ours]) if theirs.get(key) != ours.get(key)]
    if keys[1:] and keys[-1] == _CODE:
        del keys[-1]  # the source digest differs whenever a version does
    texts = [f"{key} {ours.get(key, 'unknown')} in place of {theirs.get(key, 'unknown')}" for key in keys]
    return f"it has {', '.join(texts)}; install the same there, and start the worker anew" if texts else ""
