"""File locks between processes."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path

_UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
"""Error numbers of disks without locks, such as some network disks."""


def lock_file(descriptor: int, *, wait: bool) -> bool:
    """Lock an open file; return False if another process holds the lock and `wait` is false.

    On a disk without locks the result is always True, also for several processes at a time.
    """
    from filelock import lock_descriptor

    try:
        return lock_descriptor(descriptor, blocking=wait)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
        return True


def unlock_file(descriptor: int) -> None:
    """Unlock an open file, also for processes forked since it was locked."""
    from filelock import unlock_descriptor

    with contextlib.suppress(OSError):  # a disk without locks
        unlock_descriptor(descriptor)


@contextlib.contextmanager
def lock_held(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, which is removed at the end of the block.

    The system releases the lock when the process ends. BlockingIOError if another process holds the lock.
    """
    is_held = False
    while not is_held:
        with path.open("ab") as file:
            if not lock_file(file.fileno(), wait=False):
                raise BlockingIOError(errno.EWOULDBLOCK, "another process holds the lock", str(path))
            # If another process removed the file after it was opened here, a new file has to be locked.
            with contextlib.suppress(FileNotFoundError):
                is_held = os.path.samestat(path.stat(), os.fstat(file.fileno()))
            if is_held:
                try:
                    yield
                finally:
                    if sys.platform == "win32":  # Windows does not remove open files
                        file.close()
                    with contextlib.suppress(PermissionError):
                        path.unlink(missing_ok=True)


@contextlib.contextmanager
def made_by_one(path: Path) -> Iterator[None]:
    """Let one process make the file `path`; other processes wait for the lock, then find the file.

    The lock is on a file beside `path`. If the lock file cannot be written, processes do not wait.
    """
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(path.with_name(f"{path.name}.lock").open("ab"))
            lock_file(lock.fileno(), wait=True)
            # A process forked by another thread keeps the file open: closing it here would not unlock it.
            stack.callback(unlock_file, lock.fileno())
        yield
