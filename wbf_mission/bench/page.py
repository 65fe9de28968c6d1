"""A page of captions, pictures and tables beside its pictures, as Markdown and as HTML."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from geo.atomic import atomic_write


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; all columns but the first hold numbers, of two columns both hold text."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture beside the page."""

    file: str
    """Its name; a PDF is linked to, as no browser shows it as a picture."""
    shows: str
    """For those who do not see it."""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page."""

    title: str
    text: str = ""
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True, slots=True)
class Page:
    """A page: what it is about, and its sections. All texts are plain."""

    title: str
    about: str
    sections: tuple[Section, ...]

    def write(self, folder: Path, name: str) -> tuple[Path, Path]:
        """Write ``NAME.md`` and ``NAME.html`` into the folder of the pictures; return the files."""
        markdown, page = folder / f"{name}.md", folder / f"{name}.html"
        for path, lines in ((markdown, self._markdown()), (page, self._html())):
            with atomic_write(path) as file:
                file.writelines(f"{line}\n" for line in lines)
        return markdown, page

    def _markdown(self) -> Iterator[str]:
        yield from (f"# {self.title}", "", self.about)
        for section in self.sections:
            yield from ("", f"## {section.title}")
            for picture in section.pictures:
                yield from ("", f"![{picture.shows}]({picture.file})")
            if section.text:
                yield from ("", section.text)
            for table in section.tables:
                yield from ("", f"### {table.title}", "", *_markdown_table(table))

    def _html(self) -> Iterator[str]:
        title = html.escape(self.title)
        yield from ("<!doctype html>", '<html lang="en"><head><meta charset="utf-8">')
        yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
        yield f"<title>{title}</title><style>{_STYLE}</style></head><body>"
        yield from (f"<h1>{title}</h1>", f"<p>{html.escape(self.about)}</p>")
        for section in self.sections:
            yield f"<h2>{html.escape(section.title)}</h2>"
            yield from map(_html_picture, section.pictures)
            if section.text:
                yield f"<p>{html.escape(section.text)}</p>"
            for table in section.tables:
                yield from _html_table(table)
        yield "</body></html>"


def _markdown_table(table: Table) -> Iterator[str]:
    def cells(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"

    yield cells(table.header)
    yield "|---" + "|--:" * (len(table.header) - 1) + "|"
    yield from map(cells, table.rows)


_STYLE = (
    ":root{color-scheme:light dark;--text:#222;--page:#fff;--line:#ddd;--soft:#f5f5f3}"
    "@media (prefers-color-scheme:dark){:root{--text:#ddd;--page:#16181b;--line:#3a3d42;--soft:#202327}}"
    "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:92em;padding:0 1em;"
    "color:var(--text);background:var(--page);overflow-wrap:break-word}"
    "p{max-width:60em}"
    ".wide{overflow-x:auto}"
    "table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
    "th,td{padding:.25em .7em;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}"
    "th:first-child,td:first-child{text-align:left;position:sticky;left:0;background:var(--page)}"
    "tbody tr:hover td{background:var(--soft)}"
    "@media (max-width:40em){th:first-child,td:first-child{white-space:normal;min-width:8em;"
    "max-width:11em;overflow-wrap:anywhere}}"
    ".text td:last-child,.text th:last-child{text-align:left;white-space:normal}"
    "img{max-width:100%;background:#fff;border-radius:4px}"
)


def _html_picture(picture: Picture) -> str:
    file, shows = html.escape(picture.file), html.escape(picture.shows)
    if Path(picture.file).suffix == ".pdf":
        return f'<p><a href="{file}">{shows} (PDF)</a></p>'
    return f'<p><img src="{file}" alt="{shows}"></p>'


def _html_table(table: Table) -> Iterator[str]:
    def cells(row: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row) + "</tr>"

    kind = "wide text" if len(table.header) == 2 else "wide"
    yield from (f"<h3>{html.escape(table.title)}</h3>", f'<div class="{kind}"><table>')
    yield from ("<thead>", cells(table.header, "th"), "</thead><tbody>")
    yield from (cells(row, "td") for row in table.rows)
    yield "</tbody></table></div>"
