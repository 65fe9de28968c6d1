"""How commands speak: one line of JSON or a readable table on stdout, progress and warnings on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

FILE_WIDTH = 140  # columns of a table that goes to a file or a pipe
ProgressCallback = Callable[[str, float, float], None]


class Output:
    """Where a command's results, warnings and progress go.

    Parameters
    ----------
    as_json : bool
        Print results as one JSON document on stdout and nothing else there.
    quiet : bool
        No progress and no notes; results and warnings only.
    """

    def __init__(self, *, as_json: bool = False, quiet: bool = False) -> None:
        self.as_json = as_json
        self.quiet = quiet
        self._stdout = Console(highlight=False, width=None if sys.stdout.isatty() else FILE_WIDTH)
        self._stderr = Console(stderr=True, highlight=False, soft_wrap=True)

    def note(self, text: str) -> None:
        """Say something that a script does not need."""
        if not self.quiet:
            self._stderr.print(text, markup=False)

    def warn(self, text: str) -> None:
        """Say something that went wrong but does not end the command."""
        self._stderr.print(f"warning: {text}", markup=False, style="yellow")

    def result(
        self, values: Mapping[str, Any], rows: Mapping[str, str] | None = None, title: str = ""
    ) -> None:
        """Print the command's result: ``values`` as JSON, or ``rows`` (name, text) as a table."""
        if self.as_json:
            self.raw_json(values)
            return
        table = Table(title=title or None, show_header=False, title_justify="left", title_style="bold")
        table.add_column(style="cyan", no_wrap=True)
        table.add_column(overflow="fold")
        for name, text in (rows or {key: str(value) for key, value in values.items()}).items():
            table.add_row(name, text)
        self._stdout.print(table)

    def table(
        self, values: Any, header: list[str], rows: list[list[str]], title: str = "", *, left: bool = False
    ) -> None:
        """Print several results: ``values`` as JSON, or a table with a header; numbers to the right."""
        if self.as_json:
            self.raw_json(values)
            return
        table = Table(title=title or None, title_justify="left", title_style="bold")
        for column, name in enumerate(header):
            table.add_column(name, justify="left" if left or column == 0 else "right", no_wrap=column == 0)
        for row in rows:
            table.add_row(*row)
        self._stdout.print(table)

    def raw_json(self, values: Any) -> None:
        """Print ``values`` as one JSON document."""
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(values)).decode() + "\n")

    @contextmanager
    def progress(self) -> Iterator[ProgressCallback]:
        """Show bars; the callback takes (what is being done, done, total)."""
        if self.quiet or not self._stderr.is_terminal:
            yield _ignore
            return
        columns = (
            TextColumn("{task.description:24}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
        )
        with Progress(*columns, console=self._stderr, transient=True) as bars:
            tasks: dict[str, Any] = {}

            def update(what: str, done: float, total: float) -> None:
                if what not in tasks:
                    tasks[what] = bars.add_task(what, total=max(total, 1e-9))
                bars.update(tasks[what], completed=done, total=max(total, 1e-9))

            yield update


def _ignore(_what: str, _done: float, _total: float) -> None:
    return None


def duration(seconds: float) -> str:
    """Seconds as people read them.

    >>> duration(75.4)
    '1 min 15 s'
    >>> duration(3.21)
    '3.2 s'
    """
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def distance(metres: float) -> str:
    """Metres as people read them.

    >>> distance(12345)
    '12.35 km'
    """
    return f"{metres / 1000:.2f} km" if metres >= 10_000 else f"{metres:.1f} m"
