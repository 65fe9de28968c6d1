"""Folders for what a benchmark leaves nowhere: they vanish when it ends, however it is ended."""

from __future__ import annotations

import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

__all__ = ["end_on_signals", "scratch_folder"]

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


@contextmanager
def scratch_folder(directory: str | Path | None = None) -> Iterator[Path]:
    """Make a folder, and remove it with all that is in it: at the end, on Ctrl-C, SIGTERM and SIGHUP.

    Parameters
    ----------
    directory : path-like, optional
        Where it is made; without, where temporary files are.

    Examples
    --------
    >>> with scratch_folder() as folder:
    ...     _ = (folder / "flight.tlog").write_bytes(b"frames")
    >>> folder.exists()
    False
    """
    end_on_signals()
    # A process that is ended while it writes may add a file meanwhile.
    with tempfile.TemporaryDirectory(dir=directory, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def end_on_signals() -> None:
    """Let SIGTERM and SIGHUP end the program as `sys.exit` does, with the exit code of the signal.

    By default they end it on the spot. Handlers that somebody else has set stay, and so does a signal that is
    ignored.
    """
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _exit)


def _exit(number: int, _frame: FrameType | None) -> None:
    # The second signal ends it on the spot.
    signal.signal(number, signal.SIG_DFL)
    sys.exit(128 + number)
