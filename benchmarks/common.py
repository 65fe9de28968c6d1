"""Common parts of the benchmarks: options, tables, times, memory and temporary folders."""

from __future__ import annotations

import argparse
import resource
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


def options_of(text: str | None) -> argparse.ArgumentParser:
    """Return an option parser with a script's docstring as help."""
    return argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )


def seconds_of(work: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    """Return the time of a call (s), by default the processor time of all threads of this process."""
    begin_s = clock()
    work()
    return clock() - begin_s


def peak_mb() -> float:
    """Return the peak memory of this process (MB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def print_table(rows: Sequence[Mapping[str, str]], title: str = "") -> None:
    """Print rows, cells by heading, as a Markdown table with aligned columns; print nothing without rows."""
    if not rows:
        return
    heads = list(rows[0])
    lines = [heads, *([row[head] for head in heads] for row in rows)]
    widths = [max(3, *map(len, column)) for column in zip(*lines, strict=True)]
    if title:
        print(f"\n### {title}\n")
    for row in (heads, ["-" * width for width in widths], *lines[1:]):
        print("| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |")
    sys.stdout.flush()


@contextmanager
def scratch_folder(directory: str | Path | None = None) -> Iterator[Path]:
    """Make a temporary folder, removed at the end and on Ctrl-C, SIGTERM and SIGHUP.

    Parameters
    ----------
    directory : path-like, optional
        Parent folder, by default the system's folder of temporary files.

    Examples
    --------
    >>> with scratch_folder() as folder:
    ...     _ = (folder / "flight.tlog").write_bytes(b"frames")
    >>> folder.exists()
    False
    """
    end_on_signals()
    # A child process that is being ended may still add a file during the removal.
    with tempfile.TemporaryDirectory(dir=directory, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def end_on_signals() -> None:
    """Make SIGTERM and SIGHUP end the program through `sys.exit`, with the signal's exit code.

    The default action would end the program without cleanup. Other handlers and ignored signals are kept.
    """
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _exit)


def _exit(number: int, _frame: FrameType | None) -> None:
    # A second signal ends the program at once.
    signal.signal(number, signal.SIG_DFL)
    sys.exit(128 + number)
