"""A page of captions, pictures and tables: what it holds, and as Markdown beside its pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from geo.atomic import atomic_write

_FENCE = "```"


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; all columns but the first hold numbers, of two columns both hold text."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: int = 1  # So many columns hold text, the first ones


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture beside the page."""

    file: str
    """Its name; a PDF is linked to, as no browser shows it as a picture."""
    shows: str
    """For those who do not see it."""


@dataclass(frozen=True, slots=True)
class Listing:
    """Lines to be copied, such as a command or a file."""

    title: str
    lines: str
    language: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page."""

    title: str
    text: str = ""
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    listings: tuple[Listing, ...] = ()


@dataclass(frozen=True, slots=True)
class Page:
    """A page: what it is about, and its sections. All texts are plain."""

    title: str
    about: str
    sections: tuple[Section, ...]

    def write(self, path: Path) -> None:
        """Write the page as Markdown, into the folder of its pictures."""
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
            for one in section.listings:
                fence = _FENCE * (one.lines.count(_FENCE) + 1)
                yield from ("", f"### {one.title}", "", f"{fence}{one.language}", one.lines, fence)
            for table in section.tables:
                yield from ("", f"### {table.title.translate(_ESCAPED)}", "", *_markdown_table(table))


# Names come from files of others: texts have no markup and no link of theirs.
_ESCAPED = str.maketrans({"|": "\\|", "<": "&lt;", "[": "\\["})


def _markdown_table(table: Table) -> Iterator[str]:
    def cells(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.translate(_ESCAPED) for cell in row) + " |"

    yield cells(table.header)
    yield "|---" * table.texts + "|--:" * (len(table.header) - table.texts) + "|"
    yield from map(cells, table.rows)
