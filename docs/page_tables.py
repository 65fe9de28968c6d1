"""Parts of pages that the site makes from the code.

A line ``<!-- table: NAME -->`` is replaced by a table, and a block ``{reference}`` by the docstrings of the
names in it. ``<!-- contents -->`` is replaced by hidden toctrees: one for each table row that has links.
"""

from __future__ import annotations

import csv
import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import wbf_mission
from mission.link.codec.dialect import mavlink
from mission.transfer.client import CLIENT_TABLE
from mission.transfer.server_session import SERVER_TABLE
from sim_vehicle.autopilot.px4 import PX4
from sim_vehicle.autopilot.px4.firmware import SITL_LINKS

_DOCS = Path(__file__).parent
_CONTENTS = "<!-- contents -->"
_ROW = re.compile(r"^\| ([^|]+ \|.*\]\(.*) \|$", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)#]+)\.md\)")
_REFERENCE = re.compile(r"^```\{reference\}\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_MARK = re.compile(r"^<!-- table: ([\w-]+) -->$", re.MULTILINE)


def with_tables(page: str) -> str:
    """Return the text of a page, with its marks replaced by tables."""
    page = _REFERENCE.sub(lambda found: "\n".join(_reference(found[1].split())), page)
    page = page.replace(_CONTENTS, "\n".join(_contents(page)))
    return _MARK.sub(lambda found: "\n".join(TABLES[found[1]]()), page)


def _contents(page: str) -> Iterator[str]:
    for row in _ROW.findall(page):
        *about, pages = row.split(" | ")
        captions = [f":caption: {about[0]}"] if len(about) > 1 else []
        yield from ("```{toctree}", ":hidden:", *captions, "", *_LINK.findall(pages), "```", "")


def _reference(names: Iterable[str]) -> Iterator[str]:
    yield "```{eval-rst}"
    for name in names:
        found = getattr(wbf_mission, name)
        if inspect.isclass(found) and issubclass(found, Exception):
            yield from (f".. autoexception:: wbf_mission.{name}", "   :show-inheritance:")
        elif inspect.isclass(found):
            yield from (f".. autoclass:: wbf_mission.{name}", "   :members:")
        else:
            yield f".. auto{'function' if inspect.isfunction(found) else 'data'}:: wbf_mission.{name}"
        yield ""
    yield "```"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    head = list(head)
    for row in (head, ["---"] * len(head), *rows):
        yield f"| {' | '.join(row)} |"


def _checks() -> Iterator[str]:
    from wbf_mission.addons.check.runner import all_checks  # the other tables need no add-on

    rows = ((f"`{check.id}`", check.text, check.required_of, check.suffers) for check in all_checks())
    return _table(("id", "requirement", "required of", "affected if it fails"), rows)


def _training() -> Iterator[str]:
    from wbf_mission.addons.rl import interfaces

    yield from ("```text", *(str(interface) for interface in interfaces()), "```")


def _faults() -> Iterator[str]:
    from wbf_mission.addons.faults.fault import KINDS

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


def _file(name: str, **wanted: str) -> Iterator[str]:
    rows = [row for row in rows_of(name) if wanted.items() <= row.items()]
    columns = [column for column in rows[0] if column not in wanted]
    return _table(columns, ([row[column] for column in columns] for row in rows))


def _rates() -> Iterator[str]:
    links = {
        "default": PX4.for_vehicle("multirotor").mavlink.rates_hz,
        "PX4: ground station": SITL_LINKS["ground"],
        "API": SITL_LINKS[""],
        "payload": SITL_LINKS["payload"],
        "gimbal": SITL_LINKS["gimbal"],
    }
    names = {mavlink.mavlink_map[kind].msgname: kind for rates in links.values() for kind in rates}
    rows = (
        (name, *(f"{rates[kind]:.3g}" if kind in rates else "-" for rates in links.values()))
        for name, kind in sorted(names.items())
    )
    return _table(("message", *links), rows)


TABLES: dict[str, Callable[[], Iterator[str]]] = {
    "checks": _checks,
    "conformance": _conformance,
    "real-autopilots": partial(_file, "real-autopilots.csv"),
    "findings-in-the-plan": partial(_file, "preflight.csv", part="plan"),
    "findings-in-the-vehicle": partial(_file, "preflight.csv", part="vehicle"),
    "client-examples": partial(_file, "client-examples.csv"),
    "rates": _rates,
    "training": _training,
    "faults": _faults,
    "ground-station": partial(_transitions, CLIENT_TABLE),
    "vehicle": partial(_transitions, SERVER_TABLE),
}
"""Tables by their names."""
