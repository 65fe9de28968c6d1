"""A rich console for plain text, and a progress bar; imported only to print, as importing rich is slow."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING

from rich.console import Console

from geo.texts import printable

if TYPE_CHECKING:
    from rich.progress import TaskID

# With these widths a bar fits 80 columns. A terminal wraps a longer line, and rich erases only a part of it.
_DESCRIPTION, _BAR = 24, 20
_REFRESHES_S = 4.0


class PlainConsole(Console):
    """Console without markup, emoji codes and highlighting; by default as wide as the terminal."""

    def __init__(self, stream: IO[str], *, width: int | None = None, wrap: bool = True) -> None:
        super().__init__(
            file=stream, width=width, soft_wrap=not wrap, highlight=False, markup=False, emoji=False
        )

    def on_broken_pipe(self) -> None:
        """Raise the error; rich's own method would end the process."""
        raise


class Bars:
    """A progress bar of the present task, which disappears when the task is done."""

    def __init__(self, console: Console) -> None:
        from rich import progress  # Imported late, as most commands show no bar

        self._console = console
        columns = (
            progress.TextColumn(f"{{task.description:{_DESCRIPTION}}}", markup=False),
            progress.BarColumn(_BAR),
            progress.TaskProgressColumn(),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
            progress.TextColumn("left"),
        )
        self._progress = progress.Progress(*columns, console=console)
        self._tasks: dict[str, TaskID] = {}
        self.show(True)

    def update(self, what: str, done: float, total: float) -> None:
        """Show the progress of a task in the bar."""
        total = max(total, 1e-9)
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(printable(what), total=total)
        for name, task in self._tasks.items():
            if name != what:
                self._progress.update(task, visible=False)
        self._progress.update(self._tasks[what], completed=done, total=total, visible=done < total)

    def show(self, wanted: bool) -> None:
        """Show the bar, or hide it."""
        from rich.live import Live

        progress = self._progress
        if progress.live.is_started == wanted:
            return
        if not wanted:
            progress.stop()
            return
        # A stopped `Live` remembers its position and would erase text that was written there meanwhile.
        progress.live = Live(
            console=self._console,
            refresh_per_second=_REFRESHES_S,
            transient=True,
            get_renderable=progress.get_renderable,
        )
        progress.start()
