"""Output of commands: a JSON document or tables on stdout, progress and warnings on stderr."""

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
    from pathlib import Path

    from rich.table import Table

    from mission.files import Firmware
    from mission.files.formats import Loss
    from mission.model import Mission
    from wbf_mission.cli.console import Bars, PlainConsole

_LEARNING = "training the estimator"  # Copy of sensors.estimators.base.LEARNING: importing that loads numpy
_TELL_AFTER_S = {_LEARNING: 0.0, "planning": 5.0}
_BEGINS = {_LEARNING: f"{_LEARNING} for this farm and day; later runs reuse the training"}
_LEFT_EVERY_S = 10.0
_MANY = 10
"""From this number of steps on, progress is shown in steps; with fewer, as a percentage."""
FILE_WIDTH = 140  # Columns of a table that is written to a file or a pipe
_LEAST_NAME, _LONGEST_NAME = 8, 60
_LONGEST_WORD = 14
_BESIDE_A_CELL = 3


class StdoutError(Exception):
    """Raised if results cannot be printed because writing to stdout failed."""

    def __init__(self, cause: OSError) -> None:
        super().__init__(cause.strerror or str(cause))
        self.reader_gone = cause.errno == errno.EPIPE


class Output:
    """Prints a command's results, warnings and progress.

    Texts may contain names from files and vehicles. They are therefore printed literally: markup has no
    effect, and control characters are escaped. With `as_json` the result is one JSON document, alone on
    stdout. With `quiet` neither progress nor notes are printed.
    """

    def __init__(self, *, as_json: bool = False, quiet: bool = False) -> None:
        from wbf_mission.cli.console import PlainConsole

        self.as_json = as_json
        self.quiet = quiet
        self.events = EventStream()  # Each line for the user is an event of this stream
        self.events.listen(self._show, Noted)
        self.events.listen(self._found, Found)
        self.events.listen(lambda event: self._advance(event.what, event.done, event.total), Progressed)
        self._advance: ProgressCallback = silent
        self._stderr = PlainConsole(sys.stderr, wrap=False)
        self._bars: Bars | None = None

    def note(self, text: str, *, publish: bool = True) -> None:
        """Print a note; `publish` is False if another event already has the text."""
        (self.events.tell if publish else self._show)(Noted(text))

    def notes(self, notes: Iterable[str], of: str = "") -> None:
        """Print notes on an input, each on a line; `of` names the input."""
        for text in notes:
            self.note(f"note: {of}{': ' if of else ''}{text}")

    def warn(self, text: str) -> None:
        """Print a warning, after which the command continues."""
        self.events.warn(text)

    def _show(self, event: Noted) -> None:
        if event.warns:
            self._say(f"warning: {event.text}", style="yellow")
        elif not self.quiet:
            self._say(event.text)

    def _found(self, event: Found) -> None:
        """Print a preflight finding.

        The finding that refuses the plan is not printed, because the error at the end has the same text.
        """
        label = "preflight error" if event.severity == "error" else "preflight"
        if not event.refuses:
            (self.note if event.severity == "note" else self.warn)(f"{event.vehicle}{label}: {event.text}")

    def _say(self, text: str, style: str | None = None) -> None:
        with contextlib.suppress(OSError):  # The command goes on even if a note cannot be printed
            self._stderr.print(printable(text), style=style)

    def result(
        self, values: Mapping[str, Any], rows: Mapping[str, str] | None = None, title: str = ""
    ) -> None:
        """Print a result, `values` as JSON or `rows` (texts by label) as a table of two columns."""
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
        """Print several results, `values` as JSON or `rows` as a table with a header.

        All columns but the first are aligned to the right, unless `left`. `lines` draws rules between rows.
        """
        if self.as_json:
            self.raw_json(values)
            return
        table = _new_table(title, show_lines=lines)
        # Numbers and short words must not be broken. If the table is too wide, its first column is wrapped.
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
        """Print `values` as one JSON document."""
        import msgspec

        try:
            encoded = msgspec.json.encode(values)
        except UnicodeEncodeError:  # A file name may not be valid UTF-8
            encoded = msgspec.json.encode(_encodable(values))
        with to_stdout():
            sys.stdout.write(msgspec.json.format(encoded).decode() + "\n")

    @contextmanager
    def progress(self, every_s: float | None = None) -> Iterator[ProgressCallback]:
        """Show the command's progress in a bar with the remaining time; yield a progress callback.

        Without a terminal, print a line when training begins and when planning takes more than 5 s. With
        `every_s`, print a line at this interval (s) instead.
        """
        with contextlib.redirect_stdout(sys.stderr):  # The user's code may print; stdout is for the result
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
        from wbf_mission.cli.console import Bars

        self._bars = Bars(self._stderr)
        return self._bars.update

    def show_bars(self, wanted: bool) -> None:
        """Show the bar, or hide it while the terminal shows a question."""
        if self._bars is not None:
            self._bars.show(wanted)


class _Lines:
    """Prints progress in lines, at most one per `every_s`: steps done, and estimated remaining time."""

    def __init__(self, note: Callable[[str], None], every_s: float) -> None:
        self._note = note
        self._every_s = every_s
        self._begun: tuple[float, float] | None = None
        self._told_s = 0.0

    def __call__(self, what: str, done: float, total: float) -> None:
        now_s = time.monotonic()
        if self._begun is None:
            # Steps that were done before the first call do not count for the speed.
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
    """Return the same plain values, with all texts made printable."""
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
    """Return the width of the longest number or short word, which must not be broken."""
    words = (len(word) for text in texts for word in text.split())
    return max((width for width in words if width <= _LONGEST_WORD), default=1)


@contextmanager
def to_stdout() -> Iterator[None]:
    """Flush stdout after the block; raise StdoutError if writing fails."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        raise StdoutError(error) from error


def write_and_report(
    output: Output, mission: Mission, path: Path, firmware: Firmware
) -> tuple[Mission, list[Loss]]:
    """Write the part of a mission that the file's format can hold; return this part, and the losses.

    A loss that changes the flight is printed as a warning, any other loss as a note.
    """
    from mission.files import fitted, losses, write_mission

    lost = losses(mission, path, firmware=firmware)
    kept = fitted(mission, path)
    write_mission(kept, path, firmware=firmware)
    for loss in lost:
        if loss.changes_flight:
            output.warn(f"{path.name}: {loss.text}")
        else:
            output.note(f"note: {path.name}: {loss.text}")
    return kept, lost


def filled(form: str, values: Mapping[str, Any]) -> str:
    """Fill `form` with values; return a dash if a value that it names is None.

    >>> filled("{mass_kg:g} kg", {"mass_kg": 2.5}), filled("{mass_kg:g} kg", {"mass_kg": None})
    ('2.5 kg', '-')
    """
    names = [name for _, name, _, _ in Formatter().parse(form) if name]
    return "-" if any(values[name] is None for name in names) else form.format_map(values)
