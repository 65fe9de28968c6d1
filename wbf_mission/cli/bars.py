"""Progress bar on a terminal; imported only when a bar is shown, because importing rich is slow."""

from __future__ import annotations

from rich.console import Console
from rich.live import Live
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from geo.texts import printable

# Widths for one line of 80 columns. A terminal wraps a longer line, and rich would not erase the rest.
_DESCRIPTION, _BAR = 24, 20
_REFRESHES_S = 4.0


class Bars:
    """A single bar for the current task, removed when the task is done."""

    def __init__(self, console: Console) -> None:
        self._console = console
        columns = (
            TextColumn(f"{{task.description:{_DESCRIPTION}}}", markup=False),
            BarColumn(_BAR),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
        )
        self._progress = Progress(*columns, console=console)
        self._tasks: dict[str, TaskID] = {}
        self.show(True)

    def update(self, what: str, done: float, total: float) -> None:
        """Show the progress of a task."""
        total = max(total, 1e-9)
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(printable(what), total=total)
        for name, task in self._tasks.items():
            if name != what:
                self._progress.update(task, visible=False)
        self._progress.update(self._tasks[what], completed=done, total=total, visible=done < total)

    def show(self, wanted: bool) -> None:
        """Show the bar, or hide it."""
        progress = self._progress
        if progress.live.is_started == wanted:
            return
        if not wanted:
            progress.stop()
            return
        # A stopped `Live` remembers its position, and would erase text written there since.
        progress.live = Live(
            console=self._console,
            refresh_per_second=_REFRESHES_S,
            transient=True,
            get_renderable=progress.get_renderable,
        )
        progress.start()
