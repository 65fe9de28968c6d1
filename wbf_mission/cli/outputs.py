"""Files that a command writes: never over what it reads."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from geo.errors import WbfMissionError

__all__ = ["OverwriteError", "refuse_overwrite"]


class OverwriteError(WbfMissionError, ValueError):
    """A file that must not be written over."""


def refuse_overwrite(
    out: Path | None,
    inputs: Iterable[str | Path | None] = (),
    *,
    suffixes: Iterable[str] = (),
    force: bool = False,
) -> None:
    """Refuse to write over a file that the command reads, or over one of another kind.

    Parameters
    ----------
    out : Path or None
        What will be written; None: nothing.
    inputs : iterable of path
        What is read; names that are no files (of built-in farms, say) are left out of account.
    suffixes : iterable of str
        How names of the kind that is written end; none: an older file is not looked at.
    force : bool
        Whether the user means to write over a file of another kind. What is read stays protected.

    Raises
    ------
    OverwriteError
        If the file must not be written.

    Examples
    --------
    >>> refuse_overwrite(Path("rows.plan"), ["miniberry-30", None])
    """
    if out is None or not out.is_file():
        return
    for one in inputs:
        if one is not None and Path(one).is_file() and out.samefile(one):
            msg = f"{out}: is read as well; give another name for the output"
            raise OverwriteError(msg)
    endings = tuple(suffixes)
    if endings and not force and out.suffix.lower() not in endings:
        msg = (
            f"{out}: is there, and its name does not end in {' or '.join(endings)}; give another, or --force"
        )
        raise OverwriteError(msg)
