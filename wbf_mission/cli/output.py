"""How commands speak: one line of JSON or a readable table on stdout, progress and warnings on stderr."""

from __future__ import annotations

import contextlib
import errno
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from string import Formatter
from typing import TYPE_CHECKING, Any

from geo.texts import printable
from wbf_mission.events import EventStream, Found, Noted, Progressed
from wbf_mission.progress import Progress as ProgressCallback
from wbf_mission.progress import silent

if TYPE_CHECKING:
    from rich.table import Table

    from wbf_mission.cli.bars import Bars
    from wbf_mission.cli.console import PlainConsole

_LEARNING = "training the estimator"  # as sensors.estimators.base.LEARNING, which would load numpy
_TELL_AFTER_S = {_LEARNING: 0.0, "planning": 5.0}
_BEGINS = {_LEARNING: f"{_LEARNING} for this farm and day; what it learns is kept for later runs"}
_LEFT_EVERY_S = 10.0
_MANY = 10
"""So many steps are counted; fewer are told by their percentage."""
FILE_WIDTH = 140  # columns of a table that goes to a file or a pipe
_LEAST_NAME, _LONGEST_NAME = 8, 60
_LONGEST_WORD = 14
_BESIDE_A_CELL = 3


class StdoutError(Exception):
    """Results that cannot be printed, because of what stdout says."""

    def __init__(self, cause: OSError) -> None:
        super().__init__(cause.strerror or str(cause))
        self.reader_gone = cause.errno == errno.EPIPE


class Output:
    """Where a command's results, warnings and progress go.

    Everything is printed as text: names come from files and from vehicles, so markup in them is not obeyed
    and control characters are shown, not sent to the terminal. With `as_json` results are one JSON document
    on stdout, and nothing else is there; when `quiet` there is no progress and no note.
    """

    def __init__(self, *, as_json: bool = False, quiet: bool = False) -> None:
        from wbf_mission.cli.console import PlainConsole

        self.as_json = as_json
        self.quiet = quiet
        self.events = EventStream()  # Each line for the user is an event of it
        self.events.listen(self._show, Noted)
        self.events.listen(self._found, Found)
        self.events.listen(lambda event: self._advance(event.what, event.done, event.total), Progressed)
        self._advance: ProgressCallback = silent
        self._stderr = PlainConsole(sys.stderr, wrap=False)
        self._bars: Bars | None = None

    def note(self, text: str, *, tells: bool = True) -> None:
        """Say something that a script does not need; `tells` not where an event tells it already."""
        (self.events.tell if tells else self._show)(Noted(text))

    def notes(self, notes: Iterable[str], of: str = "") -> None:
        """Say how an input was understood, a line each; `of` names it."""
        for text in notes:
            self.note(f"note: {of}{': ' if of else ''}{text}")

    def warn(self, text: str) -> None:
        """Say something that went wrong but does not end the command."""
        self.events.warn(text)

    def _show(self, event: Noted) -> None:
        if event.warns:
            self._say(f"warning: {event.text}", style="yellow")
        elif not self.quiet:
            self._say(event.text)

    def _found(self, event: Found) -> None:
        """Say errors and warnings, and notes unless they are not wanted.

        The error that ends the command is told at its end and not here, too.
        """
        label = "preflight error" if event.severity == "error" else "preflight"
        if not event.refuses:
            (self.note if event.severity == "note" else self.warn)(f"{event.vehicle}{label}: {event.text}")

    def _say(self, text: str, style: str | None = None) -> None:
        with contextlib.suppress(OSError):  # a note that cannot be shown does not end the command
            self._stderr.print(printable(text), style=style)

    def result(
        self, values: Mapping[str, Any], rows: Mapping[str, str] | None = None, title: str = ""
    ) -> None:
        """Print the command's result: ``values`` as JSON, or ``rows`` (name, text) as a table."""
        if self.as_json:
            self.raw_json(values)
            return
        table = _new_table(title, show_header=False)
        table.add_column(style="cyan", no_wrap=True)
        table.add_column(overflow="fold")
        for name, text in (rows or {key: str(value) for key, value in values.items()}).items():
            table.add_row(printable(name), printable(text))
        _print_table(table)

    def table(
        self,
        values: Any,
        header: list[str],
        rows: list[list[str]],
        title: str = "",
        *,
        left: bool = False,
        lines: bool = False,
    ) -> None:
        """Print several results: ``values`` as JSON, or a table with a header; numbers to the right.

        With ``lines`` the cells have several lines, and the rows are parted by a rule.
        """
        if self.as_json:
            self.raw_json(values)
            return
        table = _new_table(title, show_lines=lines)
        # Words and numbers are not broken: what is too wide is the name's, or is told in more lines.
        least = [_longest_word([name, *(row[k] for row in rows)]) for k, name in enumerate(header)]
        room = _stdout_console().width - sum(least[1:]) - _BESIDE_A_CELL * len(header) - 1
        longest = max((len(row[0]) for row in rows), default=0)
        short = longest <= min(room, _LONGEST_NAME)
        for column, name in enumerate(header):
            table.add_column(
                name,
                justify="left" if left or column == 0 else "right",
                no_wrap=column == 0 and short,
                min_width=least[column] if column else min(longest, _LEAST_NAME),
                max_width=None if column or short else max(min(room, _LONGEST_NAME), _LEAST_NAME),
                overflow="fold",
            )
        for row in rows:
            table.add_row(*map(printable, row))
        _print_table(table)

    def raw_json(self, values: Any) -> None:
        """Print ``values`` as one JSON document."""
        import msgspec

        try:
            encoded = msgspec.json.encode(values)
        except UnicodeEncodeError:  # a file name that is no UTF-8
            encoded = msgspec.json.encode(_encodable(values))
        with to_stdout():
            sys.stdout.write(msgspec.json.format(encoded).decode() + "\n")

    @contextmanager
    def progress(self, every_s: float | None = None) -> Iterator[ProgressCallback]:
        """Show a bar with the time left of the progress that events tell; the callback tells it.

        Without a terminal, only what may take a minute is told, in a line: training when it begins, planning
        when it is not over after some seconds; with `every_s` a line after each so many seconds instead.
        """
        try:
            self._advance = self._shown_progress(every_s)
            yield self.events.progress
        finally:
            self._advance = silent
            self.show_bars(False)
            self._bars = None

    def _shown_progress(self, every_s: float | None) -> ProgressCallback:
        if self.quiet:
            return silent
        if not self._stderr.is_terminal and every_s is not None:
            return _Lines(self.note, every_s)
        if not self._stderr.is_terminal:
            due_s: dict[str, float] = {}
            left = _Lines(self.note, _LEFT_EVERY_S)

            def announce(what: str, done: float, total: float) -> None:
                if what not in _TELL_AFTER_S or done >= total:
                    return
                now_s = time.monotonic()
                if now_s >= due_s.setdefault(what, now_s + _TELL_AFTER_S[what]):
                    due_s[what] = math.inf
                    self.note(f"{_BEGINS.get(what, what)} ...")
                if what == _LEARNING:
                    left(what, done, total)

            return announce
        from wbf_mission.cli.bars import Bars

        self._bars = Bars(self._stderr)
        return self._bars.update

    def show_bars(self, wanted: bool) -> None:
        """Show the bar, or take it away while somebody is asked something on the same terminal."""
        if self._bars is not None:
            self._bars.show(wanted)


class _Lines:
    """Tells from time to time how far something is, and how long it will take if it goes on so."""

    def __init__(self, note: Callable[[str], None], every_s: float) -> None:
        self._note = note
        self._every_s = every_s
        self._begun: tuple[float, float] | None = None
        self._told_s = 0.0

    def __call__(self, what: str, done: float, total: float) -> None:
        now_s = time.monotonic()
        if self._begun is None:
            # What was done before the first call tells nothing of how fast it goes.
            self._begun, self._told_s = (now_s, done), now_s
            return
        begun_s, before = self._begun
        if now_s - self._told_s < self._every_s or done <= before or done >= total:
            return
        self._told_s = now_s
        left_s = (now_s - begun_s) / (done - before) * (total - done)
        so_far = f"{done:.0f} of {total:.0f}" if total >= _MANY else f"{done / total:.0%}"
        self._note(f"{what}: {so_far}, about {timedelta(seconds=round(left_s))} left")


def _encodable(value: Any) -> Any:
    """Plain values with every text as `printable` gives it."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Mapping):
        return {_encodable(key): _encodable(entry) for key, entry in value.items()}
    return [_encodable(entry) for entry in value] if isinstance(value, list | tuple) else value


def _new_table(title: str, **how: Any) -> Table:
    from rich.table import Table

    return Table(title=printable(title) or None, title_justify="left", title_style="bold", **how)


def _print_table(table: Table) -> None:
    with to_stdout():
        _stdout_console().print(table)


def _stdout_console() -> PlainConsole:
    from wbf_mission.cli.console import PlainConsole

    return PlainConsole(sys.stdout, width=None if sys.stdout.isatty() else FILE_WIDTH)


def _longest_word(texts: list[str]) -> int:
    """Return how wide the longest word is that is not broken in a table: numbers and short words."""
    words = (len(word) for text in texts for word in text.split())
    return max((width for width in words if width <= _LONGEST_WORD), default=1)


@contextmanager
def to_stdout() -> Iterator[None]:
    """Write to stdout, and flush it; raise StdoutError if it takes no more."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        raise StdoutError(error) from error


def told(form: str, values: Mapping[str, Any]) -> str:
    """Return values in words; a dash if one of them is not known.

    >>> told("{mass_kg:g} kg", {"mass_kg": 2.5}), told("{mass_kg:g} kg", {"mass_kg": None})
    ('2.5 kg', '-')
    """
    names = [name for _, name, _, _ in Formatter().parse(form) if name]
    return "-" if any(values[name] is None for name in names) else form.format_map(values)
