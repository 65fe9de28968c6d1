"""Access to vehicles behind links by MAVLink, and the flights with them that an add-on provides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from geo.closing import Closing
from geo.imports import entry_named, load_entry, load_named
from mission.errors import LinkError
from mission.ground.link import own_driver
from mission.ground.station import GroundStation
from mission.link.codec.dialect import Message
from mission.transfer import OWN_TRANSFERS, TransferMaker
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from sim_vehicle.component import NEVER, Component
from sim_vehicle.host.server import Server, ServerUrl
from sim_vehicle.host.simulation import StopReason
from wbf_mission.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Protocol

    from wbf_mission.flight import Way
    from wbf_mission.run.joint_flight import OperatorConsole
    from wbf_mission.run.orders import Orders

__all__ = ["Heard", "LinkHost", "Note", "Tap", "Via", "connection", "links_of", "via_named"]

GROUP = "wbf_mission.connections"
"""Group of entry points: ``LiveLink``, ``fly`` and ``resume`` (`connection`)."""
Tap = Callable[[bytes, float], None]
Note = Callable[[str], None]
Heard = tuple[str, Vehicle]
"""A vehicle with its link."""
_NAMED = 4  # Largest number of named senders in a line about dropped datagrams


def links_of(heard: Iterable[Heard]) -> tuple[ServerUrl, ...]:
    """Return the links of vehicles that were heard; each of several links carries only its own vehicles."""
    systems: dict[str, set[int]] = {}
    for url, vehicle in heard:
        systems.setdefault(url, set()).add(vehicle.system_id)
    if len(systems) == 1:
        return (ServerUrl(next(iter(systems))),)
    return tuple(ServerUrl(url, frozenset(ids)) for url, ids in systems.items())


def _as_it_is(messages: Iterable[Message], _now_s: float) -> Iterable[Message]:
    """Return the messages unchanged."""
    return messages


class LinkHost(Closing):
    """Host of real links; Ctrl-C raises KeyboardInterrupt in the caller.

    ``through`` maps the messages of a component, and the time, to the messages that are sent directly.
    """

    def __init__(
        self,
        server: Server,
        through: Callable[[Iterable[Message], float], Iterable[Message]] = _as_it_is,
        note: Note = lambda _text: None,
    ) -> None:
        self._server = server
        self._through = through
        self._note = note

    @property
    def now_s(self) -> float:
        """Seconds since the link was opened."""
        return self._server.now_s

    @property
    def frames(self) -> int:
        """Number of MAVLink frames sent."""
        return self._server.frames

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Serve until a condition holds or time is up; a KeyboardInterrupt leaves the link open."""
        reason = self._server.run(until=until, limit_s=limit_s)
        if reason is StopReason.STOPPED:
            raise KeyboardInterrupt
        return reason

    def send(self, component: Component, messages: Iterable[Message]) -> None:
        """Send messages of a component at the current time."""
        self._server.send(component, self._through(messages, self._server.now_s))

    def close(self) -> None:
        """Close the server."""
        if dropped := self._server.dropped.most_common(_NAMED):
            named = ", ".join(f"{sender} ({count})" for sender, count in dropped)
            self._note(f"datagrams of {named} were dropped: this program was too busy to take them")
        self._server.close()


class Via:
    """Access to vehicles by MAVLink; add-ons override it for other libraries."""

    @property
    def transfers(self) -> TransferMaker:
        """Makes the mission transfers."""
        return OWN_TRANSFERS

    def serve(
        self,
        heard: Sequence[Heard],
        cameras: Sequence[Component],
        grounds: Sequence[GroundStation],
        tap: Tap | None,
        note: Note,
    ) -> LinkHost:
        """Open the links of ground stations and their cameras; LinkError if a link cannot be opened."""
        pairs = zip(cameras, grounds, strict=True)
        components: list[Component] = [part for pair in pairs for part in pair]
        return LinkHost(Server(components, links_of(heard), tap=tap, at_once=True), note=note)

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Open a link, and return its transfer driver; LinkError if the link cannot be opened."""
        return own_driver(url, on_event, on_text)

    def check_count(self, vehicles: int) -> None:
        """Raise LiveFlightError for more vehicles than this access supports."""

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Raise LiveFlightError if a vehicle that was heard cannot fly the scenario by this access."""


def via_named(name: str) -> Via:
    """Return the `Via` of a name: ``own``, or the name of an entry point, which is loaded on demand."""
    entry = entry_named("wbf_mission.vias", name)
    if entry is None:
        return Via()
    way: Via = load_entry(entry, f"the way {name}", LinkError)()
    return way


if TYPE_CHECKING:

    class _LiveLink(Protocol):
        """Class of flights of real vehicles; its own docstring lists the parameters."""

        def __call__(
            self,
            urls: str | Sequence[str],
            console: OperatorConsole,
            *,
            agreed: bool = ...,
            wait_s: float = ...,
            system_ids: Sequence[int] = ...,
            force: bool = ...,
            via: Via = ...,
            change_s: float = ...,
            tlog: Path | None = ...,
            orders: Orders | None = ...,
        ) -> Way: ...

    LiveLink: _LiveLink

else:

    def __getattr__(name: str) -> object:
        if name != "LiveLink":
            msg = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(msg)
        return connection(name)


def connection(name: str) -> Any:
    """Return a part of the flights of real vehicles; LinkError if no add-on provides it.

    ``LiveLink`` is the class of `wbf_mission.LiveLink`. ``fly`` makes one with the operator at the terminal,
    from links, an `Output` and the class's options. ``resume`` finds the place where a mission is resumed, by
    the text of ``plan --resume`` and the mission's `Course`.
    """
    return load_named(GROUP, name, "connects to real vehicles with", "the connection", LinkError)
