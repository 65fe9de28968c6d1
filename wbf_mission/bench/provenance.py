"""What a run was flown with, as its row tells it: versions and commit, the machine, parameters of objects."""

from __future__ import annotations

import functools
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
KERNELS = "kernels"
"""Under this name the `hardware` of a row has the kernels of linear algebra."""


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of wbf-mission, Python and numpy, and the commit if it is known.

    ``commit`` is that of the git checkout which holds the packages, with ``+changes`` behind it if their
    files differ from it; of an installed package that of the repository it was installed from.
    """
    found = {"wbf-mission": __version__, "python": platform.python_version(), "numpy": np.__version__}
    commit = _checked_out() if (_ROOT / ".git").exists() else _installed()
    return found | {"commit": commit} if commit else found


def _checked_out() -> str:
    head = _git("rev-parse", "HEAD").strip()
    return head + (_CHANGES if head and _git("status", "--porcelain", "--", *PACKAGES) else "")


def _git(*arguments: str) -> str:
    """Return what git tells of the folder of the packages; nothing without git, or if it refuses."""
    git = shutil.which("git")
    if git is None:
        return ""
    command = [git, "--no-optional-locks", "-C", str(_ROOT), *arguments]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_S, check=True)  # noqa: S603 (no argument is a user's)
    except (OSError, subprocess.SubprocessError):
        return ""
    return ended.stdout


def _installed() -> str:
    """Return the commit that an installer wrote down (PEP 610)."""
    text = importlib.metadata.distribution("wbf-mission").read_text("direct_url.json")
    told = msgspec.json.decode(text) if text else {}
    return str(told.get("vcs_info", {}).get("commit_id", ""))


@functools.cache
def hardware() -> dict[str, str]:
    """Return what is known of the machine, and of the kernels by which linear algebra is done on it.

    That is the processor's model, its cores, the memory in GB and the system. Results of code that calls
    numpy's linear algebra may depend on the kernels by the last bits of sums.
    """
    found = {
        "processor": _processor(),
        "cores": str(os.cpu_count() or ""),
        "memory_gb": f"{psutil.virtual_memory().total / 1e9:.1f}",
        "system": f"{platform.system()} {platform.release()}".strip(),
        KERNELS: ", ".join(
            sorted({one["architecture"] for one in threadpool_info() if "architecture" in one})
        ),
    }
    return {key: one for key, one in found.items() if one}


def _processor() -> str:
    if _CPUS.is_file():
        for line in _CPUS.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return one_line(value)
    return platform.processor() or platform.machine()


def in_words(made: Any) -> str:
    """Return a planner, policy or estimator that was given as an object, with its parameters.

    These are what its class takes, by the attributes of the same names (``beta`` or ``_beta``), else its
    public attributes; of a function what it holds of the function around it.

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
    except (TypeError, ValueError):  # a class of C
        taken = []
    named = {name: f"_{name}" if f"_{name}" in held else name for name in taken}
    found = {name: getattr(made, where) for name, where in named.items() if hasattr(made, where)}
    return found or {name: one for name, one in held.items() if not name.startswith("_")}


def _call(name: str, values: Mapping[Any, Any]) -> str:
    told = (_told(one) if isinstance(key, int) else f"{key}={_told(one)}" for key, one in values.items())
    return one_line(f"{name}({', '.join(told)})", _MOST_SHOWN)


def _told(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array of {' x '.join(map(str, value.shape))}"
    if isinstance(value, np.generic):
        return repr(value.item())
    if value is None or isinstance(value, (bool, int, float, str, tuple, list)):
        return repr(value)
    return getattr(value, "__name__", type(value).__name__)
