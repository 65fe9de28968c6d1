"""A rich console that prints text as it is; imported only when something is printed (rich takes a while)."""

from __future__ import annotations

from typing import IO

from rich.console import Console


class PlainConsole(Console):
    """A console without markup, emoji codes and highlighting, as wide as the terminal unless told."""

    def __init__(self, stream: IO[str], *, width: int | None = None, wrap: bool = True) -> None:
        super().__init__(
            file=stream, width=width, soft_wrap=not wrap, highlight=False, markup=False, emoji=False
        )

    def on_broken_pipe(self) -> None:
        """Let the caller decide what it means that nobody reads (rich would end the process)."""
        raise
