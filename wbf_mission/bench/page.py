"""A page of captions, pictures and tables, and its Markdown file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from geo.atomic import atomic_write

_FENCE = "```"


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; the first `texts` columns hold words, the others numbers."""

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
    """A page with a title, an introduction and sections; all texts are plain."""

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


# Names come from other people's files: their markup and links are escaped.
_ESCAPED = str.maketrans({"|": "\\|", "<": "&lt;", "[": "\\["})


def _markdown_table(table: Table) -> Iterator[str]:
    def cells(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.translate(_ESCAPED) for cell in row) + " |"

    yield cells(table.header)
    yield "|---" * table.texts + "|--:" * (len(table.header) - table.texts) + "|"
    yield from map(cells, table.rows)
