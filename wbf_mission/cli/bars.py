"""The bar that shows on a terminal what is being done; imported only where one is shown."""

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

# All in one line of 80 columns: what is wider is wrapped by the terminal, and its rest is never removed.
_DESCRIPTION, _BAR = 24, 20
_REFRESHES_S = 4.0


class Bars:
    """Shows one bar, that of what is being done now; it is gone once that is done."""

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
        """Show how far something is."""
        total = max(total, 1e-9)
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(printable(what), total=total)
        for name, task in self._tasks.items():
            if name != what:
                self._progress.update(task, visible=False)
        self._progress.update(self._tasks[what], completed=done, total=total, visible=done < total)

    def show(self, wanted: bool) -> None:
        """Show the bar, or take it away."""
        progress = self._progress
        if progress.live.is_started == wanted:
            return
        if not wanted:
            progress.stop()
            return
        # One that was stopped remembers where it was, and would erase what was written there since.
        progress.live = Live(
            console=self._console,
            refresh_per_second=_REFRESHES_S,
            transient=True,
            get_renderable=progress.get_renderable,
        )
        progress.start()
