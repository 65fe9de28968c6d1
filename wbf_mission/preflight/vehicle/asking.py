"""Asking the vehicle behind a link."""

from __future__ import annotations

from collections.abc import Callable

from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import StopReason
from wbf_mission.preflight.vehicle.inquiry import Inquiry
from wbf_mission.preflight.vehicle.snapshot import VehicleSnapshot

__all__ = ["ask_vehicle"]


def _silent(_text: str) -> None:
    """Tell nobody."""


def ask_vehicle(
    url: str,
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    note: Callable[[str], None] = _silent,
) -> VehicleSnapshot:
    """Wait for the vehicle behind a link, and ask it for what a plan assumes.

    Nothing is changed on the vehicle.

    Parameters
    ----------
    url : str
        ``udpin:``, ``udpout:``, ``tcp:`` or ``tcpin:HOST:PORT``, or ``serial:DEVICE:BAUD``.
    wait_s : float
        How long to wait for its heartbeat.
    system_id : int, optional
        Of the vehicle; by default the first one that is heard.
    note : callable
        Takes lines for the operator.

    Raises
    ------
    LinkError
        If there is no link.
    NoVehicleError
        If nobody is heard.
    KeyboardInterrupt
        At Ctrl-C.
    """
    inquiry = Inquiry(system_id=system_id)
    with Server([inquiry], [url]) as server:
        name = server.urls[0]
        note(f"asking the vehicle on {name}")
        reason = server.run(until=lambda _now_s: inquiry.vehicle is not None, limit_s=wait_s)
        if reason is StopReason.FINISHED:
            reason = server.run(until=lambda _now_s: inquiry.done)
    if reason is StopReason.STOPPED:
        raise KeyboardInterrupt
    if inquiry.vehicle is None:
        raise inquiry.search.failure(name, wait_s)
    return inquiry.snapshot()
