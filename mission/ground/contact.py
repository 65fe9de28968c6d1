"""One vehicle as a ground station knows it."""

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
    """A vehicle's address, its last telemetry, its texts, and the quality of the link to it.

    Orders and transfers go by the round trip and the losses of a real link; to a simulated vehicle, whose
    link is not measured, `round_trip` is None. `ground` is our own address; `maker` carries the plans.
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
        """What is known of its autopilot."""
        return self.monitor.profile

    def receive(self, message: Message, now_s: float) -> None:
        """Take any message of its autopilot."""
        self.link.receive(message, now_s)
        self.monitor.receive(message, now_s)
        if isinstance(message, m.MAVLink_statustext_message):
            self.texts.on_text(message, now_s)

    @property
    def clears(self) -> bool:
        """Whether a plan is cleared by our own transfers; MAVSDK answers a clear in ways of its own."""
        return self._maker is OWN_TRANSFERS

    def order(self, command: int, *params: float, **options: Any) -> Order:
        """Return a command to it; the options are those of `Order`."""
        return Order(self.vehicle, int(command), *params, round_trip=self.round_trip, **options)

    def upload(self, *plan: Any, **options: Any) -> VerifiedUpload:
        """Return an upload to it: the items, their MissionType, and what else `VerifiedUpload` takes."""
        return self._maker.upload(*plan, **self._way, **options)

    def download(self, *plan: Any, **options: Any) -> Transfer:
        """Return a reading of a plan (MissionType) of it."""
        return self._maker.download(*plan, **self._way, **options)

    @property
    def _way(self) -> dict[str, Any]:
        return {"target": self.vehicle, "source": self.ground, "profile": self.profile}


class Heartbeat:
    """The HEARTBEAT of a ground station, each second."""

    def __init__(self) -> None:
        self.due_s = -math.inf

    def poll(self, now_s: float) -> list[Message]:
        """Return it when it is due."""
        if now_s < self.due_s:
            return []
        self.due_s = now_s + _HEARTBEAT_S
        return [ground_heartbeat()]
