"""Whose code an error came from: an error of a user's planner, policy or estimator is told with its line."""

from __future__ import annotations

import sysconfig
import traceback
from functools import cache
from pathlib import Path

from geo.texts import one_line

__all__ = ["PACKAGES", "is_users_file", "told_error", "users_line"]

PACKAGES = ("geo", "mission", "sensors", "sim_vehicle", "wbf_mission")
"""What this program consists of."""


@cache
def is_users_file(file: str) -> bool:
    """Tell whether a source is a user's: neither of this program, nor installed, nor of Python itself."""
    path = Path(file).absolute()
    if file.startswith("<frozen") or {"site-packages", "dist-packages"} & set(path.parts):
        return False
    here = Path(__file__).absolute().parents[1]
    inside = [here / name for name in PACKAGES] + [Path(sysconfig.get_path("stdlib"))]
    return not any(path.is_relative_to(one) for one in inside)


def users_line(error: BaseException) -> str | None:
    """Return the file and line of a user's code that an error came through last; None if through none.

    Examples
    --------
    >>> try:
    ...     exec(compile("1 / 0", "mine.py", "exec"))
    ... except ZeroDivisionError as error:
    ...     users_line(error), told_error(error)
    ('mine.py, line 1', 'ZeroDivisionError: division by zero (mine.py, line 1)')
    """
    frames = [one for one in traceback.extract_tb(error.__traceback__) if is_users_file(one.filename)]
    return f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else None


def told_error(error: BaseException) -> str:
    """Return an error in one line: its class, its text, and the user's line where it came from one."""
    line = users_line(error)
    text = one_line(str(error))
    return type(error).__name__ + (f": {text}" if text else "") + (f" ({line})" if line else "")
