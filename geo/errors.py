"""Base class of the project's errors, errors of farm files, and the user's line that raised an error.

Every error that a user can mend derives from `WbfMissionError`. A package defines its errors in its
``errors.py`` or beside the code that raises them.
"""

from __future__ import annotations

import sysconfig
import traceback
from functools import cache
from pathlib import Path

from geo.texts import one_line


class WbfMissionError(Exception):
    """An error that a user can mend. The error's text is one line: the fault, its place and the remedy."""


class GroundError(WbfMissionError, ValueError):
    """Error of an elevation raster that cannot be read or does not cover the flight."""


class FarmError(WbfMissionError, ValueError):
    """Error of a farm that does not exist, or of a farm file with unusable geometry or properties."""


PACKAGES = ("geo", "mission", "sensors", "sim_vehicle", "wbf_mission")
"""Names of this project's top-level packages."""
_CYTHON = frozenset({".pyx", ".pxi", ".pxd"})


@cache
def is_users_file(file: str) -> bool:
    """Return whether a source file belongs to the user, not to this project, a package or Python."""
    path = Path(file).absolute()
    if file.startswith(("<frozen", "<string>")) or {"site-packages", "dist-packages"} & set(path.parts):
        return False
    if path.suffix in _CYTHON:  # A compiled library's traceback names its source without a folder
        return False
    here = Path(__file__).absolute().parents[1]
    inside = [here / name for name in PACKAGES] + [Path(sysconfig.get_path("stdlib"))]
    return not any(path.is_relative_to(folder) for folder in inside)


def users_line(error: BaseException) -> str | None:
    """Return file and line of the innermost user code in an error's traceback, or None without user code.

    Examples
    --------
    >>> try:
    ...     exec(compile("1 / 0", "mine.py", "exec"))
    ... except ZeroDivisionError as error:
    ...     users_line(error), told_error(error)
    ('mine.py, line 1', 'ZeroDivisionError: division by zero (mine.py, line 1)')
    """
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if is_users_file(frame.filename)]
    return f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else None


def told_error(error: BaseException) -> str:
    """Return an error as one line: the error's class and text, and the line of user code that raised it."""
    line = users_line(error)
    text = one_line(str(error))
    return type(error).__name__ + (f": {text}" if text else "") + (f" ({line})" if line else "")
