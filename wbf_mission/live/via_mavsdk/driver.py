"""Transfers over a link that MAVSDK keeps, for the command line."""

from __future__ import annotations

from mission.ground.station import GROUND_COMPONENT_ID, GROUND_SYSTEM_ID
from mission.link import MavlinkEndpoint
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from wbf_mission.live.via_mavsdk.link import MavsdkLink
from wbf_mission.live.via_mavsdk.transfers import MavsdkTransfers

__all__ = ["mavsdk_driver"]


def mavsdk_driver(url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
    """Let MAVSDK open a link; return what transfers plans with a vehicle there, by MAVSDK.

    Raises
    ------
    LinkError
        If the address is wrong, or MAVSDK cannot open it.
    """
    link = MavsdkLink(url)
    endpoint = MavlinkEndpoint(link, GROUND_SYSTEM_ID, GROUND_COMPONENT_ID, wanted=())
    transfers = MavsdkTransfers(lambda: link)
    return TransferDriver(endpoint, on_event=on_event, on_text=on_text, maker=transfers, heartbeat=False)
