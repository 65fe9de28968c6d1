"""Provenance of a row: program versions and commit, the machine, and parameters of users' objects.

A worker with a different program would produce different rows, so `unlike` compares two programs.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.metadata
import inspect
import os
import platform
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil
from threadpoolctl import threadpool_info

from geo.errors import PACKAGES
from geo.texts import one_line
from wbf_mission.version import __version__

_ROOT = Path(__file__).resolve().parents[2]
_GIT_S = 10.0
_CPUS = Path("/proc/cpuinfo")
_MOST_SHOWN = 200
_CHANGES = "+changes"
_LIBRARIES = ("numpy", "scipy", "numba", "shapely")
_SOURCES = frozenset({".py", ".csv", ".npz", ".toml", ".geojson"})
_CODE = "code of wbf-mission"
KERNELS = "kernels"
"""Key of the linear algebra kernels in the `hardware` of a row."""


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
    if "wbf-mission" in keys and _CODE in keys:
        keys.remove(_CODE)  # Another version of wbf-mission always has other sources
    texts = [f"{key} {ours.get(key, 'unknown')} in place of {theirs.get(key, 'unknown')}" for key in keys]
    return f"it has {', '.join(texts)}; install the same versions, and restart the worker" if texts else ""


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of wbf-mission, Python and numpy, and the ``commit`` if known.

    In a git checkout, ``commit`` is HEAD, followed by ``+changes`` if files of the packages differ from it.
    For an installed package, it is the commit of the source repository.
    """
    found = {"wbf-mission": __version__, "python": platform.python_version(), "numpy": np.__version__}
    if not (_ROOT / ".git").exists():
        commit = _installed()
    elif commit := _git("rev-parse", "HEAD").strip():
        commit += _CHANGES if _git("status", "--porcelain", "--", *PACKAGES) else ""
    return found | {"commit": commit} if commit else found


def _git(*arguments: str) -> str:
    """Return the output of a git command in the project folder; empty without git or if the command fails."""
    git = shutil.which("git")
    if git is None:
        return ""
    command = [git, "--no-optional-locks", "-C", str(_ROOT), *arguments]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_S, check=True)  # noqa: S603 (no user input)
    except (OSError, subprocess.SubprocessError):
        return ""
    return ended.stdout


def _installed() -> str:
    """Return the commit recorded by the installer (PEP 610); empty if none."""
    text = importlib.metadata.distribution("wbf-mission").read_text("direct_url.json")
    origin = msgspec.json.decode(text) if text else {}
    return str(origin.get("vcs_info", {}).get("commit_id", ""))


@functools.cache
def hardware() -> dict[str, str]:
    """Return the processor model, number of cores, memory (GB), system and linear algebra kernels.

    The kernels may change the last bits of the results of numpy's linear algebra.
    """
    found = {
        "processor": _processor(),
        "cores": str(os.cpu_count() or ""),
        "memory_gb": f"{psutil.virtual_memory().total / 1e9:.1f}",
        "system": f"{platform.system()} {platform.release()}".strip(),
        KERNELS: ", ".join(
            sorted({pool["architecture"] for pool in threadpool_info() if "architecture" in pool})
        ),
    }
    return {key: value for key, value in found.items() if value}


def _processor() -> str:
    if _CPUS.is_file():
        for line in _CPUS.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return one_line(value)
    return platform.processor() or platform.machine()


def in_words(made: Any) -> str:
    """Return a description of a planner, policy or estimator given as an object, with its parameters.

    The parameters of an object are the attributes named after the parameters of its class (``beta`` or
    ``_beta``); if there are none, its public attributes. A function's parameters are the variables in its
    closure.

    Examples
    --------
    >>> class UCB:
    ...     def __init__(self, beta): self.beta = beta
    >>> in_words(UCB(9.0)), in_words(len)
    ('UCB(beta=9.0)', 'len')
    """
    if isinstance(made, functools.partial):
        return _call(in_words(made.func), {**dict(enumerate(made.args)), **made.keywords})
    if inspect.isroutine(made):
        function = inspect.unwrap(made)
        held = inspect.getclosurevars(function).nonlocals if inspect.isfunction(function) else {}
        return _call(made.__name__, held) if held else made.__name__
    return _call(type(made).__name__, _parameters(made))


def _parameters(made: Any) -> Mapping[str, Any]:
    held = getattr(made, "__dict__", {})
    try:
        taken = list(inspect.signature(type(made)).parameters)
    except (TypeError, ValueError):  # a class of a C extension has no signature
        taken = []
    named = {name: f"_{name}" if f"_{name}" in held else name for name in taken}
    found = {name: getattr(made, where) for name, where in named.items() if hasattr(made, where)}
    return found or {name: value for name, value in held.items() if not name.startswith("_")}


def _call(name: str, values: Mapping[Any, Any]) -> str:
    arguments = (
        _shown(value) if isinstance(key, int) else f"{key}={_shown(value)}" for key, value in values.items()
    )
    return one_line(f"{name}({', '.join(arguments)})", _MOST_SHOWN)


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array of {' x '.join(map(str, value.shape))}"
    if isinstance(value, np.generic):
        return repr(value.item())
    if value is None or isinstance(value, (bool, int, float, str, tuple, list)):
        return repr(value)
    return getattr(value, "__name__", type(value).__name__)
