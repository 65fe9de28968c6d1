"""Tables that the site makes of the code: a line ``<!-- table: NAME -->`` of a page stands for a table."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mission.transfer.client_table import CLIENT_TABLE
from mission.transfer.server_table import SERVER_TABLE
from sim_vehicle.faults.fault import KINDS

_DOCS = Path(__file__).parent
_MARK = re.compile(r"^<!-- table: ([\w-]+) -->$", re.MULTILINE)


def with_tables(page: str) -> str:
    """Return the text of a page with its tables."""
    return _MARK.sub(lambda found: "\n".join(TABLES[found[1]]()), page)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    head = list(head)
    for row in (head, ["---"] * len(head), *rows):
        yield f"| {' | '.join(row)} |"


def _checks() -> Iterator[str]:
    from wbf_mission.addons.check.runner import all_checks  # the other tables need no add-on

    rows = ((f"`{check.id}`", check.text, check.required_of, check.suffers) for check in all_checks())
    return _table(("id", "requirement", "required of", "otherwise trouble for"), rows)


def _faults() -> Iterator[str]:
    rows = []
    for name, kind in KINDS.items():
        value = "" if kind.value == "none" else kind.value
        default = "" if kind.default is None else f" ({kind.default:g})"
        rows.append((kind.group, f"`{name}`", value + default, kind.text))
    return _table(("affects", "kind", "value (default)", "effect"), rows)


def _transitions(table: dict[Any, Any]) -> Iterator[str]:
    rows = (
        (state.value, found.value, action, "-" if then is state else then.value)
        for (state, found), (action, then) in table.items()
    )
    return _table(("state", "on", "does", "then"), rows)


def rows_of(name: str) -> list[dict[str, str]]:
    """Return the rows of a CSV file beside the pages."""
    with (_DOCS / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _conformance() -> Iterator[str]:
    parts: dict[str, list[dict[str, str]]] = {}
    for row in rows_of("conformance.csv"):
        parts.setdefault(row.pop("part"), []).append(row)
    for part, rows in parts.items():
        columns = [name for name in rows[0] if any(row[name] for row in rows)]
        yield from (f"## {part}", "")
        yield from _table(columns, ([row[name] for name in columns] for row in rows))
        yield ""


def _real_autopilots() -> Iterator[str]:
    rows = rows_of("real-autopilots.csv")
    return _table(rows[0], (row.values() for row in rows))


TABLES: dict[str, Callable[[], Iterator[str]]] = {
    "checks": _checks,
    "conformance": _conformance,
    "real-autopilots": _real_autopilots,
    "faults": _faults,
    "ground-station": partial(_transitions, CLIENT_TABLE),
    "vehicle": partial(_transitions, SERVER_TABLE),
}
"""Tables by their names."""
