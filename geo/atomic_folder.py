"""A folder whose content is replaced as a whole, by one process at a time.

What is new is filled into a hidden folder beside the target. `AtomicFolder.commit` gives it the name of one
that is complete, and brings it to its place by renames: the older content goes aside, the new one in, and
only then the older one goes. A process that is killed anywhere leaves one of them whole; the next one that
opens the folder, or `settle`, brings to an end what was committed.

>>> import tempfile
>>> target = Path(tempfile.mkdtemp()) / "result"
>>> with AtomicFolder(target, "mark", lambda name: True) as folder:
...     _ = (folder.filled / "mark").write_text("whole")
...     folder.commit()
>>> [path.name for path in target.parent.iterdir()], (target / "mark").read_text()
(['result'], 'whole')
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Self

from geo.atomic import to_disk
from geo.errors import WbfMissionError

__all__ = ["AtomicFolder", "FolderError", "settle"]

_LONGEST_NAME = 240


class FolderError(WbfMissionError, ValueError):
    """A folder that cannot be written now; the text is the reason, without the folder's name."""


class AtomicFolder:
    """A folder that one process fills anew.

    From entering the ``with`` block to its end no other process can enter one for the same folder; the lock
    goes with the process, however it ends.

    The folder may be missing, and so may its parents. One that is a mount, or in which this process works,
    stays, and its content is replaced. `mark` is a file that whole content holds; `is_part` tells whether a
    name belongs to what is replaced. FolderError on entering, if another process has the folder, or it cannot
    be written.
    """

    def __init__(self, path: Path, mark: str, is_part: Callable[[str], bool]) -> None:
        self.target = path.resolve()
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
        """Whether a process was killed while it brought new content to its place."""
        return self._ready.is_dir() or self._older.is_dir()

    @property
    def hidden_names(self) -> frozenset[str]:
        """Names of the entries that are neither old nor new content."""
        return frozenset(one.name for one in (self.filled, self._ready, self._older, self._lock_path))

    def __enter__(self) -> Self:
        try:
            parent = self._lock_path.parent
            self._made = [one for one in (parent, *parent.parents) if not one.exists()]
            parent.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self.settle()
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
        """Put what was filled in the folder's place; `filled` tells where, if elsewhere on the disk."""
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
        """Bring to an end what was committed, from wherever it stands; only with the lock."""
        target, ready, older = self.target, self._ready, self._older
        if ready.is_dir():
            none_placed = (ready / self._mark).is_file()
            in_use = target.is_mount() or _works_in(target)
            if target.exists() and (in_use or older.exists() or not none_placed):
                # A folder that somebody is in cannot be exchanged, but its content can. The mark goes in
                # first: without it the new content has no place yet.
                if none_placed:
                    older.mkdir(exist_ok=True)
                    for name in [one.name for one in target.iterdir() if self._is_part(one.name)]:
                        (target / name).replace(older / name)
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
        """Put back the older content, as long as nothing of the new one has its place."""
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
        while True:
            lock = os.open(self._lock_path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                os.close(lock)
                msg = "another run writes into this folder; wait for it, or give another one"
                raise FolderError(msg) from error
            except OSError as error:
                if error.errno not in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS):
                    os.close(lock)
                    raise  # some network disks have no locks; there nobody is kept out
            with contextlib.suppress(FileNotFoundError):
                # Whoever had the lock may have removed its file in the meantime.
                if self._lock_path.stat().st_ino == os.fstat(lock).st_ino:
                    self._lock = lock
                    return
            os.close(lock)

    def _release(self) -> None:
        if self._lock is not None:
            self._lock_path.unlink(missing_ok=True)
            os.close(self._lock)
            self._lock = None
        for parent in self._made:
            # Not ours any longer once something is in it.
            with contextlib.suppress(OSError):
                parent.rmdir()


def _works_in(folder: Path) -> bool:
    try:
        return Path.cwd().is_relative_to(folder)
    except FileNotFoundError:  # the working folder was removed
        return False


def settle(path: Path, mark: str, is_part: Callable[[str], bool]) -> None:
    """Bring a folder in order that a killed process left; nothing while another process writes it.

    Parameters are those of `AtomicFolder`.
    """
    folder = AtomicFolder(path, mark, is_part)
    if folder.is_unsettled:
        with folder:
            pass
