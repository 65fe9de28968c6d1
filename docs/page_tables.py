"""Tables that the site makes of the code: a line ``<!-- table: NAME -->`` of a page stands for a table."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import typer.main

from mission.transfer.client_table import CLIENT_TABLE
from mission.transfer.server_table import SERVER_TABLE
from sim_vehicle.faults.fault import KINDS
from wbf_mission.cli.app import app
from wbf_mission.scenario.scenario import all_options

_DOCS = Path(__file__).parent
_MARK = re.compile(r"^<!-- table: ([\w-]+) -->$", re.MULTILINE)
_REFUSALS = re.compile(r" \((?:not|only) with [^)]*\)")
_ON_THE_PAGE = {"--help-all", "--json", "--quiet"}
_PARTS = {
    "--wind": ("wind_speed_m_s", "wind_direction_deg", "wind_gust_m_s"),
    "--wind-shear": ("wind_shear", "wind_roughness_m", "wind_exponent", "wind_height_m"),
}
"""Keys of the parts of an option's value."""
_DEFAULT = re.compile(r"  \[default: .*\]$")


def with_tables(page: str) -> str:
    """Return the text of a page with its tables."""
    return _MARK.sub(lambda found: "\n".join(TABLES[found[1]]()), page)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    head = list(head)
    for row in (head, ["---"] * len(head), *rows):
        yield f"| {' | '.join(row)} |"


def commands() -> dict[str, Any]:
    """Return the commands by their names, such as ``farm show``."""
    found: dict[str, Any] = {}
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        inner = getattr(command, "commands", None)
        found |= {name: command} if inner is None else {f"{name} {part}": of for part, of in inner.items()}
    return found


def options() -> Iterator[tuple[str, str, str, list[str]]]:
    """Yield flags, meaning, key in a scenario file, and commands; a row for each meaning of an option."""
    texts: dict[tuple[str, str], dict[str, list[str]]] = {}
    for name, command in commands().items():
        for param in command.params:
            if param.param_type_name == "option" and not _ON_THE_PAGE & {*param.opts}:
                flags = ", ".join(f"`{flag}`" for flag in (*param.opts, *param.secondary_opts))
                text = _REFUSALS.sub("", param.help or "")
                meaning = _DEFAULT.sub("", text)
                texts.setdefault((flags, meaning), {}).setdefault(text, []).append(name)
    keys = {option.flag: (key,) for key, (_, _, option) in all_options().items()} | _PARTS
    for (flags, meaning), names in sorted(texts.items()):
        # A default is told where all commands have the same.
        meaning = next(iter(names)) if len(names) == 1 else meaning
        where = sorted(name for each in names.values() for name in each)
        first = flags.split(",")[0].strip("`")
        yield flags, meaning, ", ".join(f"`{key}`" for key in keys.get(first, ())), where


def _options() -> Iterator[str]:
    rows = (
        (flags, meaning.replace("|", "\\|"), key, ", ".join(f"`{name}`" for name in where))
        for flags, meaning, key, where in options()
    )
    return _table(("option", "meaning", "key in a scenario file", "commands"), rows)


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
    "options": _options,
    "checks": _checks,
    "conformance": _conformance,
    "real-autopilots": _real_autopilots,
    "faults": _faults,
    "ground-station": partial(_transitions, CLIENT_TABLE),
    "vehicle": partial(_transitions, SERVER_TABLE),
}
"""Tables by their names."""
