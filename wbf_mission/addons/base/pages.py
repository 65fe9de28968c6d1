"""Interfaces of pages that add-ons provide to each other: entry points of the group `wbf_mission.pages`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from wbf_mission.cli.command import provided

if TYPE_CHECKING:
    from sim_vehicle.component import Component
    from wbf_mission.addons.base.page import Page
    from wbf_mission.addons.base.simulator import Simulated
    from wbf_mission.events import EventStream
    from wbf_mission.progress import Progress
    from wbf_mission.run.orders import Orders
    from wbf_mission.run.record import RunRecord
    from wbf_mission.scenario import Scenario


class FollowedSimulation(Protocol):
    """Entry point ``live.simulation``: shows simulated vehicles on the live page, and obeys its orders.

    Attributes
    ----------
    components : sequence of Component
        Components that run beside the vehicles.
    """

    components: Sequence[Component]

    def __init__(
        self, simulated: Simulated, scenario: Scenario, events: EventStream, orders: Orders | None
    ) -> None:
        """Follow the vehicles; without `orders`, the page cannot command them."""

    def begin(self) -> Callable[[float], bool]:
        """Publish the first events; call this when the page listens. Return the callback for later steps."""


class RunPage(Protocol):
    """Entry point ``run``: page of a run, filled during the run, with an acquisition map per decision."""

    def __init__(self, events: EventStream, scored: int) -> None:
        """Listen to the events of a run that has `scored` scored times."""

    def write(
        self, path: Path, record: RunRecord, *, log: Path | None, notes: Sequence[str], progress: Progress
    ) -> Sequence[str]:
        """Write the page; return its notes: `notes`, and notes about data that the page leaves out."""


def followed_simulation() -> type[FollowedSimulation]:
    """Return the part of the live page that follows a simulation; TargetError if no add-on provides it."""
    followed: type[FollowedSimulation] = provided("live.simulation")
    return followed


def run_page() -> type[RunPage]:
    """Return the page of a run; TargetError if no add-on provides one."""
    page: type[RunPage] = provided("run")
    return page


def bench_page() -> Callable[..., None]:
    """Return the writer of a report as one HTML file; TargetError if no add-on provides it.

    The arguments of the writer are the file, the `Page` and the folder of the page's pictures. If the rows of
    a benchmark follow, the file has a table of all standings.
    """
    page: Callable[..., None] = provided("bench")
    return page


def bench_report() -> Callable[..., Page]:
    """Return the maker of a benchmark's report; TargetError if no add-on provides it.

    Its arguments are the rows, the folder for pictures, ``title``, and the requests to list as ``asked``.
    """
    report: Callable[..., Page] = provided("bench.report")
    return report
