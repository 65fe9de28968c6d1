"""Browser pages provided by add-ons: entry points of one group, by page name."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from geo.imports import load_named
from wbf_mission.cli.options import TargetError

if TYPE_CHECKING:
    from wbf_mission.events import Event
    from wbf_mission.run.orders import Orders

GROUP = "wbf_mission.pages"


class LivePage(Protocol):
    """``live``: context that serves the page of a run, and gives the page's address and its listener."""

    def __call__(
        self, *, host: str, port: int, orders: Orders | None, tiles: Path | None
    ) -> AbstractContextManager[tuple[str, Callable[[Event], None]]]:
        """LinkError if the port is in use; a WbfMissionError if the tiles cannot be used."""


def live_page() -> LivePage:
    """Return the live page; TargetError if no add-on provides one."""
    page: LivePage = provided("live")
    return page


def provided(name: str) -> Any:
    """Return the page of a name; TargetError if no add-on provides it."""
    return load_named(GROUP, name, "brings the page", "the page", TargetError)
