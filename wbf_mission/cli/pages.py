"""Pages in the browser, which an add-on brings: entry points of one group, by the names of the pages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from geo.imports import entry_points, load_entry
from wbf_mission.cli.options import TargetError

if TYPE_CHECKING:
    from wbf_mission.bench.page import Page
    from wbf_mission.bench.rows import BenchRow
    from wbf_mission.events import Event, EventStream
    from wbf_mission.progress import Progress
    from wbf_mission.run.orders import Orders
    from wbf_mission.run.record import RunRecord

GROUP = "wbf_mission.pages"


class LivePage(Protocol):
    """``live``: serves the page of a run; the context gives its address, and the listener that fills it."""

    def __call__(
        self, *, host: str, port: int, orders: Orders | None, tiles: Path | None
    ) -> AbstractContextManager[tuple[str, Callable[[Event], None]]]:
        """LinkError if the port is taken; a ValueError of ours if the tiles cannot be used."""


class RunPage(Protocol):
    """``run``: the page of one run that is flown now, with the acquisition map of each decision."""

    def __init__(self, events: EventStream, scored: int) -> None:
        """Listen to a run with this number of scored times."""

    def write(
        self, path: Path, record: RunRecord, *, log: Path | None, notes: Sequence[str], progress: Progress
    ) -> Sequence[str]:
        """Write the page; return the notes that it shows: those given, and what it leaves out."""


class BenchPage(Protocol):
    """``bench``: writes a report as one HTML file."""

    def __call__(self, path: Path, page: Page, folder: Path, rows: Sequence[BenchRow] = ()) -> None:
        """Replace the file at `path`; `folder` has the pictures, `rows` make one table of all standings."""


def live_page() -> LivePage:
    """Return the live page; TargetError if no add-on brings it, as for the others."""
    page: LivePage = _brought("live")
    return page


def run_page() -> type[RunPage]:
    """Return the page of a run."""
    page: type[RunPage] = _brought("run")
    return page


def bench_page() -> BenchPage:
    """Return the page of a benchmark."""
    page: BenchPage = _brought("bench")
    return page


def _brought(name: str) -> Any:
    entry = next((entry for entry in entry_points(GROUP) if entry.name == name), None)
    if entry is None:
        msg = f"no package that is installed brings the page '{name}' ({GROUP}): install wbf-mission anew"
        raise TargetError(msg)
    return load_entry(entry, f"the page {name}", TargetError)
