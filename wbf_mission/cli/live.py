"""Options of the live page of a flight, and the code that serves the page."""

from __future__ import annotations

import contextlib
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from wbf_mission.cli import options
from wbf_mission.cli.command import live_page
from wbf_mission.cli.options import option
from wbf_mission.cli.output import Output
from wbf_mission.scenario import ScenarioError

if TYPE_CHECKING:
    from wbf_mission.events import EventStream
    from wbf_mission.run.orders import Orders

PANEL = "The live page"
SPEED = 20.0
"""Default pace of simulated flights with a live page, in simulated seconds per second of wall time."""


@dataclass(frozen=True, slots=True)
class LivePage:
    """Options of the live page."""

    live: Annotated[
        int | None,
        option(
            "Port of this machine for the live page; 0 takes any free port.",
            panel=PANEL,
            parser=options.whole_number_in(0, 65_535),
            metavar="PORT",
        ),
    ] = None
    live_host: Annotated[
        str,
        option(
            "Network address that serves the live page; other machines need the token in the printed URL.",
            panel=PANEL,
        ),
    ] = "127.0.0.1"
    open_page: Annotated[bool, option("Open the page in a browser.", "--open", panel=PANEL)] = False
    control: Annotated[
        bool,
        option("Allow the page to command the vehicles, not only to show them.", "--control", panel=PANEL),
    ] = False
    tiles: Annotated[
        Path | None,
        option("MBTiles or PMTiles file with a map to show behind the farm.", panel=PANEL),
    ] = None

    @property
    def wanted(self) -> bool:
        """Whether the live page is served."""
        return self.live is not None

    def check(self) -> None:
        """Raise ScenarioError if options of the page are given without ``--live``."""
        given = {
            "--open": self.open_page,
            "--control": self.control,
            "--tiles": self.tiles is not None,
            "--live-host": self.live_host != "127.0.0.1",
        }
        for flag, is_given in given.items():
            if is_given and not self.wanted:
                msg = f"{flag} has an effect only with --live PORT: give --live, too (0 is any free port)"
                raise ScenarioError(msg)

    def orders(self, output: Output) -> Orders | None:
        """Return the channel for orders from the page, or None if ``--control`` is not given."""
        self.check()
        if not self.control:
            return None
        from wbf_mission.run.orders import Orders

        return Orders(output.events)

    @contextmanager
    def serve(self, output: Output, events: EventStream, orders: Orders | None = None) -> Iterator[None]:
        """If ``--live`` is given, serve the page during the block; the page shows the event stream.

        With `orders` the page can command the vehicles. Raise LinkError if the port is in use, another
        WbfMissionError if no page is installed or the tiles cannot be used.
        """
        self.check()
        if self.live is None:
            yield
            return
        page = live_page()(host=self.live_host, port=self.live, orders=orders, tiles=self.tiles)
        with page as (url, take):
            output.note(f"live page: {url}")
            # The page listens only after this note, because the page must not show the token in the
            # note's address.
            events.listen(take)
            if self.open_page:
                webbrowser.open(url)
            yield

    def stay(self, output: Output) -> None:
        """Keep serving the page after the run until Ctrl-C; if no page is served, return at once."""
        if self.live is None:
            return
        output.note("the page stays; Ctrl-C ends it")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()
