"""Self-contained HTML pages; the page of a benchmark has a table that can be sorted and filtered.

A row of the table opens to show scores by seed. Without scripts the page shows the same tables, unsorted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from importlib import resources
from pathlib import Path

from geo.atomic import atomic_write
from wbf_mission.addons.base.markup import data_element, data_uri, html_document
from wbf_mission.addons.base.pages import Page, Table
from wbf_mission.addons.base.standings import SCORES, Scored, apart, scored, standing_table, standings_of
from wbf_mission.bench.rows import KEY_DIGITS, BenchRow

_NAMES = 3
_OF_TEXTS = 2
_EXACT = 2**53
_NUMBER = re.compile(r"[+-]?\d|-$")
# A line may break within a long name only after one of these characters, or after 24 other characters.
_PIECE = re.compile(r"[^\s/:,=-]{1,24}[/:,=-]*|[/:,=-]+|\s+")


def write_bench_page(path: Path, page: Page, folder: Path, rows: Sequence[BenchRow] = ()) -> None:
    """Write a page as one HTML file: the entry point ``bench`` (`wbf_mission.addons.base.pages`).

    Pictures in `folder` are embedded, and PDFs are linked. If `rows` are given, one table of all standings
    replaces the score tables of the sections.
    """
    groups = list(scored(apart(rows)))
    found = [(group, standings_of(group)) for group in groups]
    every = [standing for _, own in found for standing in own]
    body = "\n".join(_body(page, folder, standing_table("All standings", every, whole=True)))
    seeds = [_seeds(group, standing.planner, standing.estimator) for group, own in found for standing in own]
    data = data_element("seeds", seeds) if seeds else ""
    with atomic_write(path) as file:
        file.write(document(page.title, body, "bench", data))


def _seeds(group: Scored, planner: str, estimator: str) -> list[tuple[int | str, float, float, str, str]]:
    """Return (seed, score, final score, error, start of key) for each run of a planner and an estimator."""
    k = group.pairs.index((planner, estimator))
    scores, ends = group.scores[k].tolist(), group.final_scores[k].tolist()
    failed = [row.error or "" for row in group.rows[k]]
    # A JavaScript number cannot represent every 64-bit seed.
    seeds = [seed if seed < _EXACT else str(seed) for seed in group.seeds]
    keys = [row.key[:KEY_DIGITS] for row in group.rows[k]]
    return list(zip(seeds, scores, ends, failed, keys, strict=True))


def _body(page: Page, folder: Path, whole: Table) -> Iterator[str]:
    yield f'<main class="document"><h1>{escape(page.title)}</h1>\n<p>{escape(page.about)}</p>'
    if whole.rows:
        yield f"<h2>{escape(whole.title)}</h2>"
        yield from _table(replace(whole, texts=_NAMES), whole.title, name="standings")
    for section in page.sections:
        yield f"<h2>{escape(section.title)}</h2>"
        for picture in section.pictures:
            shows, path = escape(picture.shows), folder / picture.file
            if path.suffix == ".pdf":
                yield f'<p><a href="{escape(picture.file)}">{shows} (PDF)</a></p>'
            else:
                yield f'<p><img src="{data_uri(path.read_bytes())}" alt="{shows}"></p>'
        if section.text:
            yield f"<p>{escape(section.text)}</p>"
        for listing in section.listings:
            yield f'<h3>{escape(listing.title)}</h3><pre tabindex="0">{escape(listing.lines)}</pre>'
        for table in section.tables:
            if not (whole.rows and table.title == SCORES):
                yield f"<h3>{escape(table.title)}</h3>"
                yield from _table(table, f"{section.title}: {table.title}")
    yield "</main>"


def _table(table: Table, label: str, *, name: str = "") -> Iterator[str]:
    """Yield a scrollable table; names are in its first `table.texts` columns, or in both of two columns."""
    names = len(table.header) if len(table.header) == _OF_TEXTS else table.texts

    def cells(row: Sequence[str], tag: str) -> str:
        # A column of numbers may also contain the name of a planner.
        texts = [
            _numbers(cell) if k >= names and _NUMBER.match(cell) else _name(cell)
            for k, cell in enumerate(row)
        ]
        kinds = [' class="text"' if k < names else "" for k in range(len(row))]
        made = (f"<{tag}{kind}>{text}</{tag}>" for kind, text in zip(kinds, texts, strict=True))
        return f"<tr>{''.join(made)}</tr>"

    own = f' id="{name}"' if name else ""
    yield f'<div class="wide" tabindex="0" role="region" aria-label="{escape(label)}"><table{own}>'
    yield from ("<thead>", cells(table.header, "th"), "</thead><tbody>")
    yield from (cells(row, "td") for row in table.rows)
    yield "</tbody></table></div>"


def _name(text: str) -> str:
    """Return a text as HTML, with marks where a line may break."""
    return "<wbr>".join(map(escape, _PIECE.findall(text)))


def _numbers(text: str) -> str:
    """Return an interval as HTML that stays on one line; only before brackets the line may break."""
    return escape(text).replace(" to ", " to&nbsp;" if "(" in text else "&nbsp;to&nbsp;")


def document(title: str, body: str, script: str, data: str = "") -> str:
    """Return a page with a script of ``static``; see `html_document` for the other parameters."""
    static = resources.files("wbf_mission.addons.web") / "static"
    style, code = ((static / name).read_text(encoding="utf-8") for name in ("page.css", f"{script}.js"))
    return html_document(title, body, style=style, script=code, data=data)
