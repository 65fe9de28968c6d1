"""Missions up to and down from a vehicle behind a link, for the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from mission.link import MavlinkEndpoint, open_link
from mission.model import Mission, MissionType
from mission.transfer import Event, Progress, TransferStatistics, count_warning
from mission.transfer.driver import TransferDriver, Vehicle
from wbf_mission.ground.station import GROUND_COMPONENT_ID, GROUND_SYSTEM_ID

ProgressCallback = Callable[[str, float, float], None]
Note = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TransferReport:
    """What a transfer did.

    Parameters
    ----------
    system_id, component_id, autopilot : int
        The vehicle, and its MAV_AUTOPILOT.
    items : dict
        Items of each plan, by its name.
    verified : bool
        Every plan was read back and found equal.
    messages_sent, messages_received, retries : int
    duration_s : float
    """

    system_id: int
    component_id: int
    autopilot: int
    items: dict[str, int]
    verified: bool
    messages_sent: int
    messages_received: int
    retries: int
    duration_s: float

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


def _silent(*_: object) -> None:
    """Take what nobody wants to hear."""


def upload(
    mission: Mission,
    url: str,
    *,
    wait_s: float = 10.0,
    progress: ProgressCallback = _silent,
    note: Note = _silent,
) -> TransferReport:
    """Send a mission to the vehicle behind ``url``, read it back and compare.

    Raises
    ------
    LinkError
        If the link cannot be opened or breaks.
    TransferError
        If no vehicle is heard, it refuses, or it holds something else afterwards.
    """
    with _driver(url, progress, "uploading") as driver:
        vehicle = _find(driver, wait_s, note)
        for kind in MissionType:
            warning = count_warning(vehicle.profile, kind, len(mission.plan(kind)))
            if warning:
                note(f"warning: {warning}")
        return _report(vehicle, driver.upload(mission))


def download(
    url: str, *, wait_s: float = 10.0, progress: ProgressCallback = _silent, note: Note = _silent
) -> tuple[Mission, TransferReport]:
    """Read mission, fence and rally points of the vehicle behind ``url``; errors as in `upload`."""
    with _driver(url, progress, "downloading") as driver:
        vehicle = _find(driver, wait_s, note)
        mission, costs = driver.download()
        counts = {kind.name.lower(): len(mission.plan(kind)) for kind in MissionType}
        return mission, replace(_report(vehicle, costs), items=counts)


def find_vehicle(
    url: str, *, wait_s: float = 10.0, system_id: int | None = None, note: Note = _silent
) -> Vehicle:
    """Wait for the heartbeat of a vehicle behind ``url``.

    Raises
    ------
    LinkError
        If the link cannot be opened or breaks.
    NoVehicleError
        If none is heard.
    """
    with _driver(url, _silent, "") as driver:
        return _find(driver, wait_s, note, system_id)


def _driver(url: str, progress: ProgressCallback, what: str) -> TransferDriver:
    def on_event(event: Event) -> None:
        if isinstance(event, Progress):
            progress(f"{what} {event.mission_type.name.lower()}", event.done, event.total)

    endpoint = MavlinkEndpoint(open_link(url), GROUND_SYSTEM_ID, GROUND_COMPONENT_ID)
    return TransferDriver(endpoint, on_event=on_event)


def _find(driver: TransferDriver, wait_s: float, note: Note, system_id: int | None = None) -> Vehicle:
    note(f"waiting for a vehicle on {driver.endpoint.link.name}")
    return driver.wait_for_vehicle(wait_s, system_id=system_id)


def _report(vehicle: Vehicle, costs: Iterable[TransferStatistics]) -> TransferReport:
    parts = list(costs)
    return TransferReport(
        vehicle.system_id,
        vehicle.component_id,
        vehicle.autopilot,
        {part.mission_type.name.lower(): part.items for part in parts},
        all(part.verified for part in parts),
        sum(part.messages_sent for part in parts),
        sum(part.messages_received for part in parts),
        sum(part.retries for part in parts),
        sum(part.duration_s for part in parts),
    )
