"""Rich console for plain text; imported only to print, because importing rich is slow."""

from __future__ import annotations

from typing import IO

from rich.console import Console


class PlainConsole(Console):
    """Console without markup, emoji codes and highlighting; `width` defaults to that of the terminal."""

    def __init__(self, stream: IO[str], *, width: int | None = None, wrap: bool = True) -> None:
        super().__init__(
            file=stream, width=width, soft_wrap=not wrap, highlight=False, markup=False, emoji=False
        )

    def on_broken_pipe(self) -> None:
        """Raise the error to the caller, where rich would end the process."""
        raise
