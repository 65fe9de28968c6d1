"""Ctrl-C, SIGTERM and SIGHUP: each ends a command as Ctrl-C does, with its own exit code."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from types import FrameType

from geo.processes import INTERRUPTS, Repeats

_before: dict[int, object] = {}
_received: list[int] = []
_announced: list[tuple[str, Callable[[], bool]]] = []
_deferred: list[bool] = [False]
_repeats: list[Repeats] = [Repeats()]


def install() -> None:
    """Make the signals raise KeyboardInterrupt in the main thread.

    The first one lets a command close its files and tell what it has; the second ends that, too; the third
    ends the process on the spot. What comes within a second of another one repeats it.
    """
    _received.clear()
    _repeats[0] = Repeats()
    defer(False)
    # A command in the background of a script ignores SIGINT, one under nohup SIGHUP: those stay ignored.
    for number in INTERRUPTS:
        handler = signal.getsignal(number)
        if handler is not signal.SIG_IGN and handler is not None:
            _before[number] = handler
            signal.signal(number, _interrupt)


def restore() -> None:
    """Put back the handlers from before `install`."""
    for number, handler in _before.items():
        signal.signal(number, handler)  # type: ignore[arg-type]
    _before.clear()
    forget()


def defer(wanted: bool) -> None:
    """Let the first signal be noted only (`came`), for work that must not be broken off just anywhere."""
    _deferred[0] = wanted


def came() -> bool:
    """Whether a signal has come."""
    return bool(_received)


def forget() -> None:
    """Clear the received signals once they are handled, so that the command goes on."""
    _received.clear()


def exit_code(otherwise: int) -> int:
    """128 and the number of the first signal that came; `otherwise` when none came."""
    return 128 + _received[0] if _received else otherwise


@contextlib.contextmanager
def announcing(text: str, when: Callable[[], bool] = lambda: True) -> Iterator[None]:
    """Say a line on stderr at once when a signal comes, if it is true by then: what follows takes a while."""
    _announced.append((text, when))
    try:
        yield
    finally:
        _announced.pop()


def _interrupt(number: int, _frame: FrameType | None) -> None:
    if _repeats[0].is_repeat():
        return
    _received.append(number)
    if _deferred[0] and len(_received) == 1:
        return
    text, when = _announced[-1] if _announced else ("", lambda: False)
    if len(_received) == 1 and when():
        with contextlib.suppress(OSError):
            # Not through sys.stderr: it may be in the middle of a line.
            os.write(2, ("\n" * os.isatty(2) + text + "\n").encode(errors="backslashreplace"))
    if len(_received) > 1:
        for other in _before:
            signal.signal(other, signal.SIG_DFL)
    raise KeyboardInterrupt
