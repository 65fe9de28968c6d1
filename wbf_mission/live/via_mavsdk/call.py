"""A call of one of MAVSDK's functions, whose answer comes in another thread."""

from __future__ import annotations

from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

__all__ = ["Call"]


class Call:
    """A call under way.

    Parameters
    ----------
    begin : callable
        One of MAVSDK's ``..._async`` functions.
    *arguments
        What it takes before the callback.
    """

    def __init__(self, begin: Callable[..., None], *arguments: Any) -> None:
        self._answers: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
        begin(*arguments, self._on_answer)

    def _on_answer(self, *answer: Any) -> None:
        # The last one is MAVSDK's user data, of which there is none.
        self._answers.put(answer[:-1])

    def answer(self) -> tuple[Any, ...] | None:
        """Return what MAVSDK answered, its result first; None while it has not."""
        try:
            return self._answers.get_nowait()
        except Empty:
            return None
