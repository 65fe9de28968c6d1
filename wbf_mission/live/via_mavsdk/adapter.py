"""MAVSDK as a way to a vehicle: it keeps the link, uploads, arms, starts and orders; we look on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from mission.ground.station import GroundStation
from mission.link import MavlinkEndpoint
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.transfer import TransferMaker
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from mission.transfer.wire import GROUND_STATION
from sim_vehicle.host.server import Server
from wbf_mission.live.discovery import LiveFlightError
from wbf_mission.live.hosting import LinkHost, LinkHosting, Tap, Via
from wbf_mission.live.riding_camera import RidingCamera
from wbf_mission.live.via_mavsdk.link import MavsdkLink
from wbf_mission.live.via_mavsdk.orders import MavsdkOrders
from wbf_mission.live.via_mavsdk.transfers import mavsdk_transfers
from wbf_mission.run.sortie import Sortie
from wbf_mission.scenario import Scenario

__all__ = ["MavsdkHosting", "MavsdkVia"]

_POLL_S = 0.02


@dataclass
class MavsdkHosting(LinkHosting):
    """A vehicle behind a link that MAVSDK keeps; station, camera and estimate are those of the own way.

    ``note`` takes a line for the operator when MAVSDK tells of a refusal. The tlog has what MAVSDK hands on;
    what it sends by itself is not in it.
    """

    _link: MavsdkLink | None = field(default=None, init=False)

    @property
    def transfers(self) -> TransferMaker:
        """Who carries the plans up to the vehicle."""
        return mavsdk_transfers(self._opened)

    def _serve(self, sorties: Sequence[Sortie], cameras: Sequence[RidingCamera], tap: Tap | None) -> LinkHost:
        """Let MAVSDK open the link, for one vehicle; LinkError if it cannot."""
        ((url, vehicle),), (sortie,) = self.heard, sorties
        link = self._link = MavsdkLink(url)
        orders = MavsdkOrders(link, vehicle.system_id, vehicle.autopilot, vehicle.vehicle_type, self.note)
        ground = _GroundByMavsdk(sortie.ground, orders)
        return LinkHost(Server([*cameras, ground], [], tap=tap, links=[link]), ground.hand_on)

    def _opened(self) -> MavsdkLink:
        assert self._link is not None
        return self._link


class _GroundByMavsdk:
    """A ground station whose orders MAVSDK carries out, as a component of the host."""

    def __init__(self, ground: GroundStation, orders: MavsdkOrders) -> None:
        self.system_id, self.component_id = ground.system_id, ground.component_id
        self.wanted = ground.wanted
        self._ground, self._orders = ground, orders
        self._due_s = math.inf

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take a message; MAVSDK alone tells what became of an order."""
        return [] if is_a(message, m.MAVLink_command_ack_message) else self._hear(message, now_s)

    def _hear(self, message: Message, now_s: float) -> list[Message]:
        return self.hand_on(self._ground.receive(message, now_s), now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Take MAVSDK's answers, and send what is due."""
        out: list[Message] = []
        for answer in self._orders.answers(now_s):
            out += self._hear(answer, now_s)
        self._due_s = now_s + _POLL_S
        return out + self.hand_on(self._ground.poll(now_s), now_s)

    def next_deadline(self) -> float:
        """When `poll` has something to do."""
        return min(self._ground.next_deadline(), self._due_s if self._orders.waiting else math.inf)

    def hand_on(self, messages: Iterable[Message], now_s: float) -> list[Message]:
        """Give MAVSDK the orders; return the rest. MAVSDK sends the heartbeat itself."""
        rest: list[Message] = []
        for message in messages:
            if self._orders.takes(message):
                for answer in self._orders.carry_out(message):
                    rest += self._hear(answer, now_s)
            elif not is_a(message, m.MAVLink_heartbeat_message):
                rest.append(message)
        self._due_s = min(self._due_s, now_s + _POLL_S)
        return rest


class MavsdkVia(Via):
    """MAVSDK keeps the link, carries the plans and gives the orders; all else is as in the own way."""

    hosting = MavsdkHosting

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Let MAVSDK open a link; LinkError if the address is wrong, or MAVSDK cannot open it."""
        link = MavsdkLink(url)
        endpoint = MavlinkEndpoint(link, *GROUND_STATION, wanted=())
        transfers = mavsdk_transfers(lambda: link)
        return TransferDriver(endpoint, on_event=on_event, on_text=on_text, maker=transfers, heartbeat=False)

    def check_count(self, vehicles: int) -> None:
        """Refuse several vehicles."""
        if vehicles > 1:
            msg = f"--via mavsdk flies one vehicle, not {vehicles}: leave out --via mavsdk, or fly one"
            raise LiveFlightError(msg)

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Refuse a policy for a vehicle that leaves its mission while that is changed."""
        policy = scenario.mission.policy
        if policy is not None and vehicle.vehicle_type in (vehicle.profile.change_modes or {}):
            msg = (
                f"policy {policy} changes the mission in flight, which --via mavsdk does not do with "
                f"{vehicle.profile.name}: leave out --via mavsdk, or give a planner"
            )
            raise LiveFlightError(msg)
