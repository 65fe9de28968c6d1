"""Files that appear complete or not at all.

What is written goes to a temporary neighbour in the same folder. When the ``with`` block ends well, the
neighbour is brought to the disk (``fsync``) and takes the place of the target in one step (``os.replace``),
which is brought to the disk too: even a power cut leaves the old file or the new one. When the block ends
with an exception, Ctrl-C included, the neighbour is removed and an older target stays as it was.

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
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Literal, TextIO, overload

# What a write reports without naming the file.
DISK_ERRORS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})


def _neighbour(target: Path) -> Path:
    # The suffix stays, because libraries choose the format by it; the stem is cut to stay under 255 bytes.
    return target.with_name(f".{target.stem[:40]}-{secrets.token_hex(6)}{target.suffix[:20]}")


@contextlib.contextmanager
def disk_errors_named(path: Path, temporary: Path | None = None) -> Iterator[None]:
    """Make an OSError name the target: where the disk is full, and in place of a temporary neighbour."""
    try:
        yield
    except OSError as error:
        nameless = error.filename is None and error.errno in DISK_ERRORS
        if nameless or (error.filename is not None and Path(str(error.filename)) == temporary):
            error.filename, error.filename2 = str(path), None
        raise


def to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some file systems cannot do it for folders, or at all.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path with the same suffix, for writers that open files by name.

    A symbolic link stays and its target is replaced; permissions of an older file are kept. A target that is
    no regular file (a pipe, ``/dev/stdout``) is given as it is. The block has to create this file.
    """
    target = Path(path).resolve()
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if target.exists() and not target.is_file():
        yield Path(path)
        return
    temporary = _neighbour(target)
    with disk_errors_named(Path(path), temporary):
        try:
            yield temporary
            if target.exists():
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            to_disk(temporary)
            temporary.replace(target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        to_disk(target.parent)


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

    The mode is "w" (UTF-8) or "wb"; the ``filename`` of an OSError is the target.
    """
    with atomic_path(path) as temporary:
        if mode == "wb":
            with temporary.open("wb") as binary:
                yield binary
        else:
            with temporary.open("w", encoding="utf-8", newline=newline) as text:
                yield text
