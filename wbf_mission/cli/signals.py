"""Handles SIGINT (Ctrl-C), SIGTERM and SIGHUP. Each signal interrupts a command and has its own exit code."""

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
    work too, and the third ends the process at once. A signal within a second of another is ignored.
    """
    _received.clear()
    _repeats[0] = Repeats()
    defer(False)
    # Ignored signals stay ignored: shells ignore SIGINT for background commands, and nohup ignores SIGHUP.
    for number in INTERRUPTS:
        handler = signal.getsignal(number)
        if handler is not signal.SIG_IGN and handler is not None:
            _before[number] = handler
            signal.signal(number, _interrupt)


def restore() -> None:
    """Restore the signal handlers that `install` replaced."""
    for number, handler in _before.items():
        signal.signal(number, handler)  # type: ignore[arg-type]
    _before.clear()
    forget()


def defer(wanted: bool) -> None:
    """If `wanted`, the first signal does not interrupt the work, but is only recorded (`came`)."""
    _deferred[0] = wanted


def came() -> bool:
    """Return whether any signal was received."""
    return bool(_received)


def forget() -> None:
    """Forget the received signals after they are handled, so that the command continues."""
    _received.clear()


def exit_code(otherwise: int) -> int:
    """Return 128 plus the number of the first received signal, or `otherwise` if none came."""
    return 128 + _received[0] if _received else otherwise


@contextlib.contextmanager
def announcing(text: str, when: Callable[[], bool] = lambda: True) -> Iterator[None]:
    """Print `text` on stderr at the first signal, if `when()` is true; shutting down may be slow."""
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
            # os.write is used, because the signal may have interrupted sys.stderr in the middle of a line.
            os.write(2, ("\n" * os.isatty(2) + text + "\n").encode(errors="backslashreplace"))
    if len(_received) > 1:
        for other in _before:
            signal.signal(other, signal.SIG_DFL)
    raise KeyboardInterrupt
