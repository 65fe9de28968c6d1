"""State of one vehicle on the ground station, and orders and transfers to that vehicle."""

from __future__ import annotations

import math
from typing import Any

from mission.autopilots.profile import Profile
from mission.ground.link_state import LinkState
from mission.ground.orders import Order
from mission.ground.texts import TextLog
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.transfer import OWN_TRANSFERS, Transfer, TransferMaker, VerifiedUpload
from mission.transfer.wire import GROUND_STATION, ground_heartbeat

__all__ = ["Contact", "Heartbeat"]

_HEARTBEAT_S = 1.0


class Contact:
    """Ids, telemetry, texts and link quality of one vehicle; factory of orders and transfers to the vehicle.

    If ``is_real``, the timeouts of orders and transfers adapt to the measured round trip time and loss.
    """

    def __init__(
        self,
        vehicle: tuple[int, int] = (0, 0),
        ground: tuple[int, int] = GROUND_STATION,
        *,
        maker: TransferMaker = OWN_TRANSFERS,
        is_real: bool = True,
    ) -> None:
        self.vehicle, self.ground = vehicle, ground
        self.monitor, self.texts, self.link = VehicleMonitor(), TextLog(), LinkState()
        self.round_trip = self.link.round_trip if is_real else None
        self._maker = maker

    @property
    def profile(self) -> Profile:
        """Profile of the autopilot."""
        return self.monitor.profile

    def receive(self, message: Message, now_s: float) -> None:
        """Handle any message of the autopilot."""
        self.link.receive(message, now_s)
        self.monitor.receive(message, now_s)
        if isinstance(message, m.MAVLink_statustext_message):
            self.texts.on_text(message, now_s)

    @property
    def clears(self) -> bool:
        """Whether the transfers support clearing a plan; MAVSDK has its own handling of clears."""
        return self._maker is OWN_TRANSFERS

    def order(self, command: int, *params: float, **options: Any) -> Order:
        """Return an order to the vehicle; ``options`` are those of `Order`."""
        options |= {"round_trip": self.round_trip, "sender": self.ground[0]}
        return Order(self.vehicle, int(command), *params, **options)

    def upload(self, *plan: Any, **options: Any) -> VerifiedUpload:
        """Return an upload to the vehicle; the arguments are those of `VerifiedUpload`."""
        return self._maker.upload(*plan, **self._address, **options)

    def download(self, *plan: Any, **options: Any) -> Transfer:
        """Return a download from the vehicle; the arguments are those of `MissionDownload`."""
        return self._maker.download(*plan, **self._address, **options)

    @property
    def _address(self) -> dict[str, Any]:
        return {"target": self.vehicle, "source": self.ground, "profile": self.profile}


class Heartbeat:
    """Timer of the ground station's HEARTBEAT (1 Hz)."""

    def __init__(self) -> None:
        self.due_s = -math.inf

    def poll(self, now_s: float) -> list[Message]:
        """Return the HEARTBEAT if due."""
        if now_s < self.due_s:
            return []
        self.due_s = now_s + _HEARTBEAT_S
        return [ground_heartbeat()]
