"""Files and folders that appear complete or not at all, and locks.

A file is written to a temporary neighbour in the same folder. When the ``with`` block ends well, the
neighbour is brought to the disk (``fsync``), takes the target's place in one step (``os.replace``), and the
folder is brought to the disk too: even a power cut leaves the old file or the new one. When the block ends
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
import hashlib
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Literal, Self, TextIO, overload

from geo.errors import WbfMissionError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

DISK_ERRORS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})
"""Errors of a write whose OSError names no file."""


@contextlib.contextmanager
def disk_errors_named(path: Path, temporary: Path | None = None) -> Iterator[None]:
    """Make an OSError of a full disk, or of the temporary neighbour, name the target."""
    try:
        yield
    except OSError as error:
        nameless = error.filename is None and error.errno in DISK_ERRORS
        if nameless or (error.filename is not None and Path(str(error.filename)) == temporary):
            error.filename, error.filename2 = str(path), None
        raise


def to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    if sys.platform == "win32" and path.is_dir():  # Windows opens no folders
        return
    descriptor = os.open(path, os.O_RDWR if sys.platform == "win32" else os.O_RDONLY)
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
    no regular file (a pipe, ``/dev/stdout``) is yielded itself. The block has to create the file.
    """
    target = Path(path).resolve()
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if target.exists() and not target.is_file():
        yield Path(path)
        return
    # The suffix stays, because libraries choose the format by it; the stem is cut to stay under 255 bytes.
    name = f".{target.stem[:40]}-{secrets.token_hex(6)}{target.suffix[:20]}"
    temporary = target.with_name(name)
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

    Text is UTF-8; the ``filename`` of an OSError is the target.
    """
    with atomic_path(path) as temporary:
        if mode == "wb":
            with temporary.open("wb") as binary:
                yield binary
        else:
            with temporary.open("w", encoding="utf-8", newline=newline) as text:
                yield text


def lock_file(descriptor: int, *, wait: bool) -> bool:
    """Lock an open file for this process; False if another process has it and `wait` is false.

    OSError if the file system has no locks.
    """
    if sys.platform == "win32":
        while True:
            try:
                msvcrt.locking(descriptor, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
            except PermissionError:
                return False
            except OSError as error:  # LK_LOCK gives up after ten seconds
                if error.errno != errno.EDEADLK:
                    raise
            else:
                return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def unlock_file(descriptor: int) -> None:
    """Unlock an open file, also for processes that were forked meanwhile."""
    if sys.platform == "win32":
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)
    else:
        fcntl.flock(descriptor, fcntl.LOCK_UN)


_LONGEST_NAME = 240  # Leaves room for the hidden folders' names: file systems allow 255 bytes


class FolderError(WbfMissionError, ValueError):
    """A folder that cannot be written now; the text is the reason, without the folder's name."""


class AtomicFolder:
    """A folder whose content one process replaces as a whole.

    New content is filled into a hidden folder beside the target. `commit` renames that to a name for complete
    content and puts it in place by renames: the older content goes aside, the new one in, then the older one
    is removed. A process killed anywhere leaves one of them whole; the next process that opens the folder, or
    `settle`, completes what was committed.

    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "result"
    >>> with AtomicFolder(target, "mark", lambda name: True) as folder:
    ...     _ = (folder.filled / "mark").write_text("whole")
    ...     folder.commit()
    >>> [path.name for path in target.parent.iterdir()], (target / "mark").read_text()
    (['result'], 'whole')

    Within the ``with`` block no other process can enter one for the same folder; the lock ends with the
    process, however it ends.

    Parameters
    ----------
    path : Path
        The folder. It and its parents may be missing. A mount, or this process's working folder, stays, and
        only its content is replaced.
    mark : str
        A file that whole content holds.
    is_part : callable
        Whether a name belongs to the content that is replaced.
    rescue : callable
        Called on entering, before remains of a killed process in `filled` are removed.

    Raises
    ------
    FolderError
        On entering, if another process has the folder, or it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        mark: str,
        is_part: Callable[[str], bool],
        *,
        rescue: Callable[[], None] = lambda: None,
    ) -> None:
        self.target = path.resolve()
        self._rescue = rescue
        self._mark, self._is_part = mark, is_part
        name = self.target.name
        if len(os.fsencode(name)) > _LONGEST_NAME:
            name = hashlib.sha256(os.fsencode(name)).hexdigest()
        hidden = self.target if self.target.is_mount() else self.target.parent
        self.filled = hidden / f".{name}.partial"
        """Where the new content is written."""
        self._ready, self._older = hidden / f".{name}.ready", hidden / f".{name}.older"
        self._lock_path = hidden / f".{name}.lock"
        self._lock: int | None = None
        self._made: list[Path] = []

    @property
    def is_unsettled(self) -> bool:
        """Whether a process was killed while it put new content in place."""
        return self._ready.is_dir() or self._older.is_dir()

    @property
    def hidden_names(self) -> frozenset[str]:
        """Names of the entries that are neither old nor new content."""
        return frozenset(path.name for path in (self.filled, self._ready, self._older, self._lock_path))

    def __enter__(self) -> Self:
        try:
            parent = self._lock_path.parent
            self._made = [folder for folder in (parent, *parent.parents) if not folder.exists()]
            parent.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self.settle()
            if self.filled.is_dir():
                self._rescue()
            shutil.rmtree(self.filled, ignore_errors=True)
            self.filled.mkdir()
        except OSError as error:
            self._release()
            raise FolderError(f"it cannot be written: {(error.strerror or str(error)).lower()}") from error
        except BaseException:
            self._release()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.filled, ignore_errors=True)
        self._release()

    def commit(self, filled: Path | None = None) -> None:
        """Put new content in the folder's place; `filled` is its folder, if elsewhere on the disk."""
        filled = filled or self.filled
        for entry in filled.iterdir():
            to_disk(entry)
        to_disk(filled)
        filled.replace(self._ready)
        try:
            self.settle()
        except OSError:
            self._undo()
            raise

    def settle(self) -> None:
        """Complete what was committed, at whatever step it stopped; only with the lock."""
        target, ready, older = self.target, self._ready, self._older
        if ready.is_dir():
            none_placed = (ready / self._mark).is_file()
            in_use = target.is_mount() or _works_in(target)
            if target.exists() and (in_use or older.exists() or not none_placed):
                # A folder in use cannot be exchanged, but its content can. The mark goes in first: while it
                # is in `ready`, none of the new content is in place.
                if none_placed:
                    older.mkdir(exist_ok=True)
                    for entry in [entry for entry in target.iterdir() if self._is_part(entry.name)]:
                        entry.replace(older / entry.name)
                    (ready / self._mark).replace(target / self._mark)
                for entry in list(ready.iterdir()):
                    entry.replace(target / entry.name)
                ready.rmdir()
            else:
                if target.exists():
                    ready.chmod(stat.S_IMODE(target.stat().st_mode))
                    target.replace(older)
                ready.replace(target)
        if older.is_dir():
            if not target.exists():
                older.replace(target)
            else:
                for entry in list(older.iterdir()):
                    if not self._is_part(entry.name) and not (target / entry.name).exists():
                        entry.replace(target / entry.name)
                shutil.rmtree(older, ignore_errors=True)
        if target.is_dir():
            to_disk(target)
        to_disk(self._lock_path.parent)

    def _undo(self) -> None:
        """Put back the older content, while none of the new content is in place."""
        if not (self._ready / self._mark).is_file():
            return
        if self._older.is_dir():
            if self.target.exists():
                for entry in list(self._older.iterdir()):
                    entry.replace(self.target / entry.name)
                self._older.rmdir()
            else:
                self._older.replace(self.target)
        shutil.rmtree(self._ready, ignore_errors=True)

    def _take_lock(self) -> None:
        while self._lock is None:
            lock = os.open(self._lock_path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                if not lock_file(lock, wait=False):
                    raise FolderError("another run writes into this folder; wait for it, or give another one")
                # The process that had the lock may have removed its file in the meantime.
                if self._lock_path.stat().st_ino == os.fstat(lock).st_ino:
                    self._lock = lock
            except FileNotFoundError:
                pass
            except OSError as error:
                # Some network disks have no locks; there several processes may write.
                if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):
                    raise
                self._lock = lock
            finally:
                if self._lock is None:
                    os.close(lock)

    def _release(self) -> None:
        if self._lock is not None:
            if sys.platform == "win32":  # It removes no open file
                os.close(self._lock)
                with contextlib.suppress(PermissionError):
                    self._lock_path.unlink(missing_ok=True)
            else:
                self._lock_path.unlink(missing_ok=True)
                os.close(self._lock)
            self._lock = None
        for parent in self._made:
            with contextlib.suppress(OSError):  # it is not empty
                parent.rmdir()


def _works_in(folder: Path) -> bool:
    try:
        return Path.cwd().is_relative_to(folder)
    except FileNotFoundError:  # the working folder was removed
        return False


def settle(path: Path, mark: str, is_part: Callable[[str], bool]) -> None:
    """Complete what a killed process committed to a folder; FolderError while another process writes it.

    Parameters are those of `AtomicFolder`.
    """
    folder = AtomicFolder(path, mark, is_part)
    if folder.is_unsettled:
        with folder:
            pass
