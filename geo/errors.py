"""The root of the project's errors, the errors of farms, and whose code an error came from.

Every error that a user can mend derives from `WbfMissionError`. A package has its errors in ``errors.py``, or
beside the code that raises them.
"""

from __future__ import annotations

import sysconfig
import traceback
from functools import cache
from pathlib import Path

from geo.texts import one_line


class WbfMissionError(Exception):
    """An error that a user can mend; its one line says what was wrong, where, and what to do."""


class GroundError(WbfMissionError, ValueError):
    """A raster of the ground's heights that cannot be read or does not cover the flight."""


class FarmError(WbfMissionError, ValueError):
    """A farm that does not exist, or a farm file whose geometry or properties cannot be used."""


PACKAGES = ("geo", "mission", "sensors", "sim_vehicle", "wbf_mission")
"""The packages of this project."""
_CYTHON = frozenset({".pyx", ".pxi", ".pxd"})


@cache
def is_users_file(file: str) -> bool:
    """Return whether a source is a user's: not this project's, nor an installed package's, nor Python's."""
    path = Path(file).absolute()
    if file.startswith("<frozen") or {"site-packages", "dist-packages"} & set(path.parts):
        return False
    if path.suffix in _CYTHON:  # compiled libraries name their sources without their folder
        return False
    here = Path(__file__).absolute().parents[1]
    inside = [here / name for name in PACKAGES] + [Path(sysconfig.get_path("stdlib"))]
    return not any(path.is_relative_to(folder) for folder in inside)


def users_line(error: BaseException) -> str | None:
    """Return the last file and line of a user's code in an error's traceback; None if there is none.

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
    """Return an error in one line: its class, its text, and the user's line where it came from one."""
    line = users_line(error)
    text = one_line(str(error))
    return type(error).__name__ + (f": {text}" if text else "") + (f" ({line})" if line else "")
