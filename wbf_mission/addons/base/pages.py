"""Pages of captions, pictures and tables, written as Markdown; entry points for pages of other add-ons.

Entry points of the group `wbf_mission.pages` (`wbf_mission.cli.command.provided`):

- ``live.simulation``: `FollowedSimulation`; ``run``: `RunPage`.
- ``bench.report``: makes a benchmark's report, a `Page`. Its arguments are the rows, the folder for pictures,
  ``title``, and the requests to list as ``asked``.
- ``bench``: writes a report as one HTML file. Its arguments are the file, the `Page` and the folder of its
  pictures. If the rows of a benchmark follow, the file has a table of all standings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from geo.atomic import atomic_write

if TYPE_CHECKING:
    from sim_vehicle.component import Component
    from wbf_mission.addons.base.simulator import Simulated
    from wbf_mission.events import EventStream
    from wbf_mission.progress import Progress
    from wbf_mission.run.orders import Orders
    from wbf_mission.run.record import RunRecord
    from wbf_mission.scenario import Scenario

_FENCE = "```"


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; the first `texts` columns hold words, the other columns hold numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: int = 1


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture in the folder of the page."""

    file: str
    """File name; a PDF becomes a link, because browsers do not show a PDF as a picture."""
    shows: str
    """Alternative text."""


@dataclass(frozen=True, slots=True)
class Listing:
    """Preformatted lines, such as a command or a file."""

    title: str
    lines: str
    language: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a page, under its title."""

    title: str
    text: str = ""
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    listings: tuple[Listing, ...] = ()


@dataclass(frozen=True, slots=True)
class Page:
    """A page with a title, an introduction and sections; no text has markup."""

    title: str
    about: str
    sections: tuple[Section, ...]

    def write(self, path: Path) -> None:
        """Write the page as Markdown to `path`, which lies in the folder of its pictures."""
        with atomic_write(path) as file:
            file.writelines(f"{line}\n" for line in self._markdown())

    def _markdown(self) -> Iterator[str]:
        yield from (f"# {self.title}", "", self.about)
        for section in self.sections:
            yield from ("", f"## {section.title.translate(_ESCAPED)}")
            for picture in section.pictures:
                yield from ("", f"![{picture.shows}]({picture.file})")
            if section.text:
                yield from ("", section.text.translate(_ESCAPED))
            for listing in section.listings:
                fence = _FENCE * (listing.lines.count(_FENCE) + 1)
                yield from ("", f"### {listing.title}", "")
                yield from (f"{fence}{listing.language}", listing.lines, fence)
            for table in section.tables:
                yield from ("", f"### {table.title.translate(_ESCAPED)}", "", *_markdown_table(table))


# Names come from files of other people, so markup and links in names are escaped.
_ESCAPED = str.maketrans({"|": "\\|", "<": "&lt;", "[": "\\["})


def _markdown_table(table: Table) -> Iterator[str]:
    def cells(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.translate(_ESCAPED) for cell in row) + " |"

    yield cells(table.header)
    yield "|---" * table.texts + "|--:" * (len(table.header) - table.texts) + "|"
    yield from map(cells, table.rows)


class FollowedSimulation(Protocol):
    """Entry point ``live.simulation``: shows simulated vehicles on the live page, which can order them."""

    components: Sequence[Component]
    """Components that run beside the vehicles."""

    def __init__(
        self, simulated: Simulated, scenario: Scenario, events: EventStream, orders: Orders | None
    ) -> None:
        """Follow the vehicles; without `orders`, the page cannot command them."""

    def begin(self) -> Callable[[float], bool]:
        """Publish the first events, once the page listens. Return the callback for each later step."""


class RunPage(Protocol):
    """Entry point ``run``: page of a run, filled during the run, with an acquisition map per decision."""

    def __init__(self, events: EventStream, scored: int) -> None:
        """Listen to the events of a run that has `scored` scored times."""

    def write(
        self, path: Path, record: RunRecord, *, log: Path | None, notes: Sequence[str], progress: Progress
    ) -> Sequence[str]:
        """Write the page; return its notes: `notes`, and notes about data that the page leaves out."""
