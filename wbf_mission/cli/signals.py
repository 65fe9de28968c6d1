"""Handling of SIGINT (Ctrl-C), SIGTERM and SIGHUP: all interrupt a command, each with its own exit code."""

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

    After the first signal, a command closes its files and prints its results. The second signal stops this
    too, and the third ends the process at once. A signal within a second of another is ignored as a repeat.
    """
    _received.clear()
    _repeats[0] = Repeats()
    defer(False)
    # Shells ignore SIGINT for background commands, and nohup ignores SIGHUP; ignored signals stay ignored.
    for number in INTERRUPTS:
        handler = signal.getsignal(number)
        if handler is not signal.SIG_IGN and handler is not None:
            _before[number] = handler
            signal.signal(number, _interrupt)


def restore() -> None:
    """Restore the handlers from before `install`."""
    for number, handler in _before.items():
        signal.signal(number, handler)  # type: ignore[arg-type]
    _before.clear()
    forget()


def defer(wanted: bool) -> None:
    """Only record the first signal (`came`), during work that must not be interrupted at any point."""
    _deferred[0] = wanted


def came() -> bool:
    """Return whether a signal was received."""
    return bool(_received)


def forget() -> None:
    """Clear the received signals once they are handled, so that the command continues."""
    _received.clear()


def exit_code(otherwise: int) -> int:
    """Return 128 plus the number of the first received signal; `otherwise` if there was none."""
    return 128 + _received[0] if _received else otherwise


@contextlib.contextmanager
def announcing(text: str, when: Callable[[], bool] = lambda: True) -> Iterator[None]:
    """Print `text` on stderr as soon as a signal comes, if `when()` holds: shutting down may be slow."""
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
            # os.write, because the signal may have interrupted sys.stderr in the middle of a line.
            os.write(2, ("\n" * os.isatty(2) + text + "\n").encode(errors="backslashreplace"))
    if len(_received) > 1:
        for other in _before:
            signal.signal(other, signal.SIG_DFL)
    raise KeyboardInterrupt
