"""A benchmark's report as one HTML file: a table to sort and filter, whose rows open to the scores by seed.

Without scripts the same tables are there, unsorted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, TypeAlias

from geo.atomic import atomic_write
from wbf_mission.bench.page import Page, Picture, Table
from wbf_mission.bench.report import SCORES, standing_table
from wbf_mission.bench.rows import KEY_DIGITS, BenchRow
from wbf_mission.bench.standings import apart, standings
from wbf_mission.maps.html_page import data_element, data_uri
from wbf_mission.web.document import document

_NAMES = 3
_OF_TEXTS = 2
_EXACT = 2**53


def write_bench_page(path: Path, page: Page, folder: Path, rows: Sequence[BenchRow] = ()) -> None:
    """Write a page.

    Parameters
    ----------
    path : Path
        Of the HTML file, which is whole in itself; an existing one is replaced.
    page : Page
        Its texts, tables and pictures.
    folder : Path
        Of the pictures; a PDF is linked to where it is.
    rows : sequence of BenchRow, optional
        Runs that make one table of all standings, in place of those of the sections.
    """
    found = standings(apart(rows)) if rows else []
    body = "\n".join(_body(page, folder, standing_table("All standings", found, whole=True)))
    data = data_element("seeds", _seeds(rows, found)) if found else ""
    with atomic_write(path) as file:
        file.write(document(page.title, body, "bench", data))


_Seed: TypeAlias = tuple[int | str, float | None, float | None, str, str]


def _seeds(rows: Sequence[BenchRow], found: Sequence[Any]) -> list[list[_Seed]]:
    """Return seed, both scores, what failed and how the key begins, for the runs of each standing."""
    of: dict[tuple[str, str, str], list[_Seed]] = {}
    for row in apart(rows):
        key = (row.scenario, row.planner, row.estimator)
        # A number of JavaScript does not hold all digits of a seed of 64 bits.
        seed = row.seed if row.seed < _EXACT else str(row.seed)
        told = seed, row.score, row.final_score, row.error or "", row.key[:KEY_DIGITS]
        of.setdefault(key, []).append(told)
    return [
        sorted(of[one.scenario, one.planner, one.estimator], key=lambda run: int(run[0])) for one in found
    ]


def _body(page: Page, folder: Path, whole: Table) -> Iterator[str]:
    yield f'<main class="document"><h1>{escape(page.title)}</h1>\n<p>{escape(page.about)}</p>'
    if whole.rows:
        yield f"<h2>{escape(whole.title)}</h2>"
        yield from _table(replace(whole, texts=_NAMES), whole.title, name="standings")
    for section in page.sections:
        yield f"<h2>{escape(section.title)}</h2>"
        for picture in section.pictures:
            yield _picture(picture, folder)
        if section.text:
            yield f"<p>{escape(section.text)}</p>"
        for table in section.tables:
            if not (whole.rows and table.title == SCORES):
                yield f"<h3>{escape(table.title)}</h3>"
                yield from _table(table, f"{section.title}: {table.title}")
    yield "</main>"


def _picture(picture: Picture, folder: Path) -> str:
    shows = escape(picture.shows)
    if Path(picture.file).suffix == ".pdf":
        return f'<p><a href="{escape(picture.file)}">{shows} (PDF)</a></p>'
    return f'<p><img src="{data_uri((folder / picture.file).read_bytes())}" alt="{shows}"></p>'


def _table(table: Table, label: str, *, name: str = "") -> Iterator[str]:
    """Write a table, which scrolls if it is wide; its first columns are names, of two both hold text."""
    names = len(table.header) if len(table.header) == _OF_TEXTS else table.texts

    def cells(row: Sequence[str], tag: str) -> str:
        kinds = [' class="text"' if k < names else "" for k in range(len(row))]
        return (
            "<tr>"
            + "".join(f"<{tag}{k}>{escape(c)}</{tag}>" for k, c in zip(kinds, row, strict=True))
            + "</tr>"
        )

    own = f' id="{name}"' if name else ""
    yield f'<div class="wide" tabindex="0" role="region" aria-label="{escape(label)}"><table{own}>'
    yield from ("<thead>", cells(table.header, "th"), "</thead><tbody>")
    yield from (cells(row, "td") for row in table.rows)
    yield "</tbody></table></div>"
