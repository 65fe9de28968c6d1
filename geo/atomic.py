"""Files and folders that appear complete or not at all.

What is written goes to a temporary neighbour in the same folder, which takes the place of the target in one
step (``os.replace``) when the ``with`` block ends well. When it ends with an exception, Ctrl-C included, the
neighbour is removed and an older target stays as it was.

>>> import tempfile
>>> from pathlib import Path
>>> folder = Path(tempfile.mkdtemp())
>>> with atomic_write(folder / "note.txt") as file:
...     _ = file.write("all or nothing")
>>> [entry.name for entry in folder.iterdir()]
['note.txt']
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Literal, TextIO, overload


def _neighbour(target: Path) -> Path:
    # The suffix stays, because libraries choose the format by it; the stem is cut to stay under 255 bytes.
    return target.with_name(f".{target.stem[:40]}-{secrets.token_hex(6)}{target.suffix[:20]}")


@contextlib.contextmanager
def _named(path: Path, temporary: Path) -> Iterator[None]:
    """Make an OSError name the target instead of its temporary neighbour."""
    try:
        yield
    except OSError as error:
        if error.filename is not None and Path(str(error.filename)) == temporary:
            error.filename, error.filename2 = str(path), None
        raise


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path with the same suffix, for writers that open files by name.

    Parameters
    ----------
    path : path-like
        The file to make or replace. A symbolic link stays and its target is replaced; permissions of an older
        file are kept. A target that is no regular file (a pipe, ``/dev/stdout``) is given as it is.

    Yields
    ------
    pathlib.Path
        Where to write. The block has to create this file.

    Raises
    ------
    OSError
        If the folder does not exist or cannot be written to, or the target is a folder.
    """
    target = Path(path).resolve()
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if target.exists() and not target.is_file():
        yield Path(path)
        return
    temporary = _neighbour(target)
    with _named(Path(path), temporary):
        try:
            yield temporary
            if target.exists():
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            temporary.replace(target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@overload
def atomic_write(
    path: str | os.PathLike[str], mode: Literal["w"] = "w", *, newline: str | None = None
) -> contextlib.AbstractContextManager[TextIO]: ...


@overload
def atomic_write(
    path: str | os.PathLike[str], mode: Literal["wb"]
) -> contextlib.AbstractContextManager[IO[bytes]]: ...


@contextlib.contextmanager  # type: ignore[misc]
def atomic_write(
    path: str | os.PathLike[str], mode: Literal["w", "wb"] = "w", *, newline: str | None = None
) -> Iterator[IO[str] | IO[bytes]]:
    """Open a file for writing that appears under its name only when the block ends well.

    Parameters
    ----------
    path : path-like
        The file to make or replace (see `atomic_path`).
    mode : {"w", "wb"}
        UTF-8 text, or bytes.
    newline : str, optional
        As for `open`; text only.

    Yields
    ------
    file object

    Raises
    ------
    OSError
        If the file cannot be written; its ``filename`` is the target.
    """
    with atomic_path(path) as temporary:
        if mode == "wb":
            with temporary.open("wb") as binary:
                yield binary
        else:
            with temporary.open("w", encoding="utf-8", newline=newline) as text:
                yield text


@contextlib.contextmanager
def atomic_directory(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder that becomes the target, replacing an older one, when the block ends well.

    Parameters
    ----------
    path : path-like
        The folder to make or replace.

    Yields
    ------
    pathlib.Path
        An empty folder to fill.

    Raises
    ------
    OSError
        If the parent folder does not exist or cannot be written to, or the target is a file.
    """
    target = Path(path).resolve()
    if target.exists() and not target.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), os.fspath(path))
    temporary, older = _neighbour(target), _neighbour(target)
    with _named(Path(path), temporary):
        temporary.mkdir()
        try:
            yield temporary
            if target.exists():
                target.replace(older)
            temporary.replace(target)
        except BaseException:
            if older.exists() and not target.exists():
                older.replace(target)
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        shutil.rmtree(older, ignore_errors=True)
