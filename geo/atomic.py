"""Atomic writes: files and folders that appear complete or not at all; file locks between processes.

A file is written under a temporary name in the target's folder. When the ``with`` block ends without an
exception, the temporary file is flushed to the disk (``fsync``) and renamed to the target (``os.replace``),
and the folder is flushed too: even a power cut leaves the old file or the new one. After an exception, Ctrl-C
included, the temporary file is removed and an older target is unchanged.

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
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Literal, Self, TextIO, overload

from geo.errors import WbfMissionError

_WAITS_S = (0.05, 0.1, 0.2, 0.65)
DISK_ERRORS = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})
"""Error numbers of a failed write for which the OSError names no file."""


@contextlib.contextmanager
def disk_errors_named(path: Path, temporary: Path | None = None) -> Iterator[None]:
    """Put the file name `path` into an OSError of a full disk, or of a fault of the file `temporary`."""
    try:
        yield
    except OSError as error:
        nameless = error.filename is None and error.errno in DISK_ERRORS
        if nameless or (error.filename is not None and Path(str(error.filename)) == temporary):
            error.filename, error.filename2 = str(path), None
        raise


def to_disk(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk."""
    if sys.platform == "win32" and path.is_dir():  # On Windows, folders cannot be opened
        return
    descriptor = os.open(path, os.O_RDWR if sys.platform == "win32" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some file systems have no fsync for folders, or none for files either.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def replace_file(source: Path, target: Path) -> None:
    """Rename the file or folder `source` to `target`, in place of an older file of that name.

    Windows refuses the rename while another program, such as a viewer, has the older file open. The rename is
    repeated for a second; then a PermissionError names the older file and the remedy.
    """
    for wait_s in (*_WAITS_S, None):
        try:
            source.replace(target)
            return
        except PermissionError as error:
            if wait_s is None:
                refusal = f"{os.strerror(errno.EACCES)}: close any program that has it open"
                older = target if target.exists() else source
                raise PermissionError(errno.EACCES, refusal, str(older)) from error
            time.sleep(wait_s)


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path with the suffix of `path`, for writers that open a file by its name.

    The ``with`` block has to create the file. If `path` is a symbolic link, the file that it points to is
    replaced. The permissions of an older file are kept. For a pipe or a device (``/dev/stdout``), `path`
    itself is yielded.
    """
    target = Path(path).resolve()
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if target.exists() and not target.is_file():
        yield Path(path)
        return
    # Libraries choose the format by the suffix. The stem is cut because file systems allow 255 bytes.
    name = f".{target.stem[:40]}-{secrets.token_hex(6)}{target.suffix[:20]}"
    temporary = target.with_name(name)
    with disk_errors_named(Path(path), temporary):
        try:
            yield temporary
            if target.exists():
                temporary.chmod(stat.S_IMODE(target.stat().st_mode))
            to_disk(temporary)
            replace_file(temporary, target)
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
    """Open a file for writing; the file appears under its name when the block ends without an exception.

    Text is encoded as UTF-8. An OSError names `path`, not the temporary file.
    """
    with atomic_path(path) as temporary:
        if mode == "wb":
            with temporary.open("wb") as binary:
                yield binary
        else:
            with temporary.open("w", encoding="utf-8", newline=newline) as text:
                yield text


_UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
"""Error numbers by which a disk says that it has no file locks, as some network disks do."""


def lock_file(descriptor: int, *, wait: bool) -> bool:
    """Lock an open file; return False if another process holds the lock and `wait` is false.

    On a disk that has no locks the result is always True, even if several processes "lock" the file.
    """
    from filelock import lock_descriptor

    try:
        return lock_descriptor(descriptor, blocking=wait)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
        return True


def unlock_file(descriptor: int) -> None:
    """Unlock an open file; processes that were forked while it was locked lose the lock too."""
    from filelock import unlock_descriptor

    with contextlib.suppress(OSError):  # The disk may have no locks
        unlock_descriptor(descriptor)


@contextlib.contextmanager
def lock_held(path: Path) -> Iterator[None]:
    """Hold a lock on the file `path`; the file is removed at the end of the block.

    Raise BlockingIOError if another process holds the lock. The system releases a lock when its process ends.
    """
    is_held = False
    while not is_held:
        with path.open("ab") as file:
            if not lock_file(file.fileno(), wait=False):
                raise BlockingIOError(errno.EWOULDBLOCK, "another process holds the lock", str(path))
            # Another process may have removed the file after it was opened here; then a new file is locked.
            with contextlib.suppress(FileNotFoundError):
                is_held = os.path.samestat(path.stat(), os.fstat(file.fileno()))
            if is_held:
                try:
                    yield
                finally:
                    if sys.platform == "win32":  # Windows cannot remove an open file
                        file.close()
                    with contextlib.suppress(PermissionError):
                        path.unlink(missing_ok=True)


@contextlib.contextmanager
def made_by_one(path: Path) -> Iterator[None]:
    """Let one process make the file `path`; other processes wait, then find the finished file.

    The lock is a file beside `path`. If the lock file cannot be written, no process waits for another.
    """
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(path.with_name(f"{path.name}.lock").open("ab"))
            lock_file(lock.fileno(), wait=True)
            # Closing is not enough: a process that another thread forked may still hold the file open.
            stack.callback(unlock_file, lock.fileno())
        yield


_LONGEST_NAME = 240  # File names have at most 255 bytes, suffixes included


class FolderError(WbfMissionError, ValueError):
    """Error of a folder that cannot be written now. The text gives the reason, without the folder's name."""


class AtomicFolder:
    """Replaces the content of a folder atomically; only one process at a time may do so.

    New content is written into a hidden folder beside the target. `commit` renames the hidden folder to mark
    it complete, moves the older content aside, moves the new content into place and removes the older
    content. If the process is killed at any step, either the older or the new content is complete. An
    interrupted commit is completed by the next process that opens the folder, or by `settle`.

    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "result"
    >>> with AtomicFolder(target, "mark", lambda name: True) as folder:
    ...     _ = (folder.filled / "mark").write_text("whole")
    ...     folder.commit()
    >>> [path.name for path in target.parent.iterdir()], (target / "mark").read_text()
    (['result'], 'whole')

    A lock keeps other processes from entering a ``with`` block for the same folder. The system releases the
    lock when the process ends, even if the process is killed.

    Parameters
    ----------
    path : Path
        The folder; missing parents are made. A mount point or this process's working folder is kept, and only
        its content is replaced.
    mark : str
        Name of a file that complete content always holds.
    is_part : callable
        Returns whether a file of this name belongs to the replaced content; other files are kept.
    rescue : callable
        Called on entering, before files that a killed process left in `filled` are removed.

    Raises
    ------
    FolderError
        On entering, if another process writes the folder, or the folder cannot be written.
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
        hidden = self.target if os.path.ismount(self.target) else self.target.parent
        self.filled = hidden / f".{name}.partial"
        """Folder into which the block writes the new content."""
        self._ready, self._older = hidden / f".{name}.ready", hidden / f".{name}.older"
        self._lock_path = hidden / f".{name}.lock"
        self._held = contextlib.ExitStack()

    @property
    def is_unsettled(self) -> bool:
        """Whether a process was killed in the middle of a commit."""
        return self._ready.is_dir() or self._older.is_dir()

    @property
    def hidden_names(self) -> frozenset[str]:
        """Names of the hidden folders and of the lock file."""
        return frozenset(path.name for path in (self.filled, self._ready, self._older, self._lock_path))

    def __enter__(self) -> Self:
        try:
            parent = self._lock_path.parent
            made = [folder for folder in (parent, *parent.parents) if not folder.exists()]
            self._held.callback(_remove_empty, made)
            parent.mkdir(parents=True, exist_ok=True)
            try:
                self._held.enter_context(lock_held(self._lock_path))
            except BlockingIOError:
                msg = "another run writes into this folder; wait for it, or give another folder"
                raise FolderError(msg) from None
            self.settle()
            if self.filled.is_dir():
                self._rescue()
            shutil.rmtree(self.filled, ignore_errors=True)
            self.filled.mkdir()
        except OSError as error:
            self._held.close()
            raise FolderError(f"it cannot be written: {(error.strerror or str(error)).lower()}") from error
        except BaseException:
            self._held.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.filled, ignore_errors=True)
        self._held.close()

    def commit(self, filled: Path | None = None) -> None:
        """Replace the content with that of `filled`, a folder on the same disk (default: `self.filled`)."""
        filled = filled or self.filled
        for entry in filled.iterdir():
            to_disk(entry)
        to_disk(filled)
        replace_file(filled, self._ready)
        try:
            self.settle()
        except OSError:
            self._undo()
            raise

    def settle(self) -> None:
        """Complete an interrupted commit from its first undone step on. The caller holds the lock."""
        target, ready, older = self.target, self._ready, self._older
        if ready.is_dir():
            none_placed = (ready / self._mark).is_file()
            in_use = os.path.ismount(target) or _holds_working_folder(target)
            if target.exists() and (in_use or older.exists() or not none_placed):
                # A folder in use cannot be renamed, but the entries in it can. The mark is moved first: while
                # the mark is in `ready`, none of the new content is in place.
                if none_placed:
                    older.mkdir(exist_ok=True)
                    for entry in [entry for entry in target.iterdir() if self._is_part(entry.name)]:
                        replace_file(entry, older / entry.name)
                    (ready / self._mark).replace(target / self._mark)
                for entry in list(ready.iterdir()):
                    replace_file(entry, target / entry.name)
                ready.rmdir()
            else:
                if target.exists():
                    ready.chmod(stat.S_IMODE(target.stat().st_mode))
                    replace_file(target, older)
                replace_file(ready, target)
        if older.is_dir():
            if not target.exists():
                replace_file(older, target)
            else:
                for entry in list(older.iterdir()):
                    if not self._is_part(entry.name) and not (target / entry.name).exists():
                        replace_file(entry, target / entry.name)
                shutil.rmtree(older, ignore_errors=True)
        if target.is_dir():
            to_disk(target)
        to_disk(self._lock_path.parent)

    def _undo(self) -> None:
        """Restore the older content after a failed commit, unless some of the new content is in place."""
        if not (self._ready / self._mark).is_file():
            return
        if self._older.is_dir():
            if self.target.exists():
                for entry in list(self._older.iterdir()):
                    replace_file(entry, self.target / entry.name)
                self._older.rmdir()
            else:
                replace_file(self._older, self.target)
        shutil.rmtree(self._ready, ignore_errors=True)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):  # The folder is not empty
            folder.rmdir()


def _holds_working_folder(folder: Path) -> bool:
    try:
        return Path.cwd().is_relative_to(folder)
    except FileNotFoundError:  # The working folder has been removed
        return False


def settle(path: Path, mark: str, is_part: Callable[[str], bool]) -> None:
    """Complete the commit of a process that was killed.

    Raise FolderError while another process writes the folder. Parameters as in `AtomicFolder`.
    """
    folder = AtomicFolder(path, mark, is_part)
    if folder.is_unsettled:
        with folder:
            pass
