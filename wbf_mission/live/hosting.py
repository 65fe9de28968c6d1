"""Flights of vehicles behind links, in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from geo.system import Closing, steady_s
from mission.ground.arming_gate import ArmingGate
from mission.ground.link import own_driver
from mission.ground.station import GroundStation
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import FrameSink
from mission.transfer import OWN_TRANSFERS, TransferMaker
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.component import NEVER, Component
from sim_vehicle.host.server import Server, ServerUrl
from sim_vehicle.host.simulation import StopReason
from wbf_mission.live.riding_camera import RidingCamera
from wbf_mission.run.hosting import Hosting, tap_of
from wbf_mission.run.sortie import Sortie
from wbf_mission.scenario import Scenario

__all__ = ["Heard", "LinkHost", "LinkHosting", "Note", "Tap", "Via", "links_of"]

Tap = Callable[[bytes, float], None]
Note = Callable[[str], None]
Heard = tuple[str, Vehicle]
"""A vehicle with its link."""
_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
_NAMED = 4  # Largest number of named senders in a line about dropped datagrams


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkHosting(Hosting):
    """Hosting of vehicles behind links: this program is their ground stations and leaf cameras."""

    heard: Sequence[Heard]
    agreed: bool  # Whether the operator confirmed the start in advance
    note: Note  # Receives lines for the operator
    via: Via
    waits_for_decisions: ClassVar[bool] = False

    @property
    def transfers(self) -> TransferMaker:
        """Makes the mission transfers."""
        return self.via.transfers

    def arming_gate(self, system_id: int) -> ArmingGate:
        """Return the gate before arming: the vehicle's pre-arm checks and the operator's confirmation."""
        return ArmingGate((system_id, _AUTOPILOT), agreed=self.agreed, clock=steady_s)

    def open(
        self,
        sorties: Sequence[Sortie],
        writer: FrameSink | None,
        **_of_a_simulation: object,
    ) -> LinkHost:
        """Open the links; LinkError if an address is wrong, in use or unreachable."""
        cameras = [riding_camera(sortie) for sortie in sorties]
        tap = tap_of(writer, lambda _now_s: time.time())
        return self.via.serve(self.heard, cameras, [sortie.ground for sortie in sorties], tap, self.note)


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


def riding_camera(sortie: Sortie) -> RidingCamera:
    """Return the leaf camera that follows the telemetry of a sortie's vehicle."""
    camera = LeafCameraComponent(sortie.leaf_camera, sortie.plan.farm, system_id=sortie.system_id)
    riding = RidingCamera(camera, sortie.held_mission, sortie.is_changing, sortie.follow)
    sortie.images_missed = lambda: riding.missed
    return riding
