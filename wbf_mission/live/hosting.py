"""Vehicles behind links: the way to them, and their flights on the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from geo.closing import Closing
from geo.system import steady_s
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
from wbf_mission.run.hosting import tap_of
from wbf_mission.run.orders import Orders
from wbf_mission.run.sortie import Sortie
from wbf_mission.scenario import Scenario

__all__ = ["Heard", "LinkHost", "LinkHosting", "Note", "Tap", "Via", "links_of"]

Tap = Callable[[bytes, float], None]
Note = Callable[[str], None]
Heard = tuple[str, Vehicle]
"""A vehicle with its link."""
_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)
_NAMED = 4  # Senders whose datagrams were dropped, in a line


@dataclass(frozen=True, slots=True)
class LinkHosting:
    """Vehicles behind links: ours are the ground stations, and the leaf cameras that ride along."""

    heard: Sequence[Heard]
    tlog: Path | None  # Where every MAVLink frame is written that is heard and sent here
    agreed: bool  # The operator agrees to the start beforehand
    force: bool  # Send also what the autopilot would refuse or not fly
    note: Note  # Takes lines for the operator
    via: Via
    orders: Orders | None = None

    @property
    def pace(self) -> None:
        """The vehicles decide."""
        return

    @property
    def waits_for_decisions(self) -> bool:
        """Real vehicles fly on."""
        return False

    @property
    def transfers(self) -> TransferMaker:
        """Who carries the plans up to the vehicles."""
        return self.via.transfers

    def arming_gate(self, system_id: int) -> ArmingGate:
        """Return what has to hold before the motors start: the vehicle's own checks, and the operator."""
        return ArmingGate((system_id, _AUTOPILOT), agreed=self.agreed, clock=steady_s)

    def open(
        self,
        sorties: Sequence[Sortie],
        writer: FrameSink | None,
        **_of_a_simulation: object,
    ) -> LinkHost:
        """Open the links; LinkError if an address is wrong, in use or not reachable."""
        cameras = [riding_camera(one) for one in sorties]
        tap = tap_of(writer, lambda _now_s: time.time())
        return self.via.serve(self.heard, cameras, [one.ground for one in sorties], tap, self.note)


def links_of(heard: Iterable[Heard]) -> tuple[ServerUrl, ...]:
    """Return the links of vehicles that were heard; of several each carries its own vehicles only."""
    systems: dict[str, set[int]] = {}
    for url, vehicle in heard:
        systems.setdefault(url, set()).add(vehicle.system_id)
    if len(systems) == 1:
        return (ServerUrl(next(iter(systems))),)
    return tuple(ServerUrl(url, frozenset(ids)) for url, ids in systems.items())


def _as_it_is(messages: Iterable[Message], _now_s: float) -> Iterable[Message]:
    """Send everything."""
    return messages


class LinkHost(Closing):
    """A server whose Ctrl-C is the caller's.

    ``through`` takes what a component sends by itself, and the time; it returns what is sent as it is.
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
        """How many MAVLink frames were sent."""
        return self._server.frames

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Serve until a condition holds or time is up; the link stays open at KeyboardInterrupt."""
        reason = self._server.run(until=until, limit_s=limit_s)
        if reason is StopReason.STOPPED:
            raise KeyboardInterrupt
        return reason

    def send(self, component: Component, messages: Iterable[Message]) -> None:
        """Send messages of a component now."""
        self._server.send(component, self._through(messages, self._server.now_s))

    def close(self) -> None:
        """Close what it stands on."""
        if dropped := self._server.dropped.most_common(_NAMED):
            named = ", ".join(f"{sender} ({count})" for sender, count in dropped)
            self._note(f"datagrams of {named} were dropped: this program was too busy to take them")
        self._server.close()


class Via:
    """A way to a vehicle: our own transfers and orders; another way says where it differs."""

    @property
    def transfers(self) -> TransferMaker:
        """Who carries the plans up to the vehicles."""
        return OWN_TRANSFERS

    def serve(
        self,
        heard: Sequence[Heard],
        cameras: Sequence[Component],
        grounds: Sequence[GroundStation],
        tap: Tap | None,
        note: Note,
    ) -> LinkHost:
        """Open the links of ground stations, and of the cameras beside them; LinkError if one cannot be."""
        pairs = zip(cameras, grounds, strict=True)
        components: list[Component] = [part for pair in pairs for part in pair]
        return LinkHost(Server(components, links_of(heard), tap=tap, at_once=True), note=note)

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Open a link; return what transfers plans over it. LinkError if the link cannot be opened."""
        return own_driver(url, on_event, on_text)

    def check_count(self, vehicles: int) -> None:
        """Refuse more vehicles than can be flown together in this way, with LiveFlightError."""

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Refuse what cannot be done in this way with a vehicle that was heard, with LiveFlightError."""


def riding_camera(sortie: Sortie) -> RidingCamera:
    """Return the leaf camera that rides beside the vehicle of a sortie."""
    camera = LeafCameraComponent(sortie.leaf_camera, sortie.plan.farm, system_id=sortie.system_id)
    riding = RidingCamera(camera, sortie.held_mission, sortie.is_changing, sortie.follow)
    sortie.images_missed = lambda: riding.missed
    return riding
