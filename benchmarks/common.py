"""What the benchmarks share: options, tables, times, and folders that vanish when a benchmark ends."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

__all__ = ["cpu_seconds", "end_on_signals", "options_of", "print_table", "scratch_folder"]

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


def options_of(text: str | None) -> argparse.ArgumentParser:
    """Return a parser of options whose help is the text of a script's first lines."""
    return argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the processor seconds of this process that the work takes, all threads together."""
    begin_s = time.process_time()
    work()
    return time.process_time() - begin_s


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """Print a table in Markdown whose columns line up; nothing if it has no rows."""
    if not rows:
        return
    widths = [max(3, *map(len, column)) for column in zip(heads, *rows, strict=True)]
    if title:
        print(f"\n### {title}\n")
    for row in (heads, ["-" * width for width in widths], *rows):
        print("| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |")
    sys.stdout.flush()


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
