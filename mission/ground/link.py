"""Upload and download of missions over a link, for the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mission.autopilots import profile_for
from mission.ground.texts import TextLog
from mission.link import MavlinkEndpoint, open_link
from mission.model import Mission, MissionType
from mission.transfer import Event, Progress, RemoteTransferError, TransferStatistics
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from mission.transfer.wire import GROUND_STATION

ProgressCallback = Callable[[str, float, float], None]
Note = Callable[[str], None]
DriverMaker = Callable[[str, OnEvent, OnText | None], TransferDriver]
"""Function that opens the link of an address and returns its `TransferDriver`."""


@dataclass(frozen=True, slots=True)
class TransferReport:
    """Result of an upload or download, for the command line.

    Parameters
    ----------
    system_id, component_id, autopilot : int
        Ids and MAV_AUTOPILOT of the vehicle.
    items : dict
        Number of items by plan name.
    verified : bool
        Whether every plan read back equals the plan sent, and the vehicle did not reject the mission.
    texts : list of str
        Warnings of the vehicle during the transfer (STATUSTEXT).
    remarks : list of dict
        Remarks on items that the autopilot refuses or changes (`mission.transfer.remarks.Remark`).
    accepted : bool or None
        Whether the vehicle finds its mission feasible, or None if the vehicle does not report that.
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
    texts: list[str] = field(default_factory=list)
    remarks: list[dict[str, Any]] = field(default_factory=list)
    accepted: bool | None = None

    @property
    def vehicle(self) -> str:
        """Ids and autopilot of the vehicle as text."""
        return f"system {self.system_id}, component {self.component_id} ({self._autopilot_name})"

    @property
    def _autopilot_name(self) -> str:
        return profile_for(self.autopilot).name

    def summary(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return {**values, "autopilot": self._autopilot_name}


_NO_MISSION = 1  # MISSION_STATE_NO_MISSION


def _silent(*_: object) -> None:
    """Do nothing: the default of callbacks."""


def own_driver(url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
    """Open a link in this process and return its `TransferDriver`."""
    endpoint = MavlinkEndpoint(open_link(url), *GROUND_STATION)
    return TransferDriver(endpoint, on_event=on_event, on_text=on_text)


def upload(
    mission: Mission,
    url: str,
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    progress: ProgressCallback = _silent,
    note: Note = _silent,
    force: bool = False,
    parameters: Mapping[str, float] | None = None,
    open_driver: DriverMaker = own_driver,
) -> TransferReport:
    """Upload a mission to the vehicle at ``url``, and verify it.

    The mission is converted for the vehicle's autopilot. A mission that the vehicle stores and then rejects
    (PX4 checks missions after storing) does not count as verified; see `TransferReport.accepted`.

    Parameters
    ----------
    wait_s : float
        Timeout for the first heartbeat of a vehicle (s).
    system_id : int, optional
        System id of the vehicle; default the first vehicle that is heard.
    progress : callable
        Called with a text, the number of items sent, and the number of items.
    note : callable
        Called with lines for the operator.
    force : bool
        Whether to send items that the autopilot would refuse or not fly.
    parameters : mapping of str to float, optional
        Known parameters of the vehicle. Some of them decide whether the autopilot refuses an item.
    open_driver : callable
        Opens the link.

    Raises
    ------
    LinkError
        If the link cannot be opened or fails.
    LocalTransferError
        If the autopilot would refuse an item or not fly the mission. Nothing has been sent in that case.
    RemoteTransferError
        If no vehicle is heard, the vehicle refuses, or it holds a different plan afterwards. The text names
        the item and quotes the vehicle.
    """
    texts = TextLog()
    with open_driver(url, _on_event(progress, "uploading"), texts.on_text) as driver:
        vehicle = driver.wait_for_vehicle(wait_s, system_id=system_id)
        note(f"uploading to {vehicle}")
        remarks = [remark.summary() for remark in driver.render(mission, parameters=parameters).remarks]
        try:
            costs = driver.upload(mission, force=force, parameters=parameters)
        except RemoteTransferError as error:
            raise RemoteTransferError(texts.explain(str(error)), error.failure) from error
        state = driver.mission_state() if mission.items else None
    accepted = None if state is None else state != _NO_MISSION
    said = texts.warnings()
    for text in said:
        note(f"the vehicle says: {text}")
    report = _report(vehicle, costs)
    verified = report.verified and accepted is not False
    return replace(report, texts=said, remarks=remarks, verified=verified, accepted=accepted)


def download(
    url: str,
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    progress: ProgressCallback = _silent,
    note: Note = _silent,
    open_driver: DriverMaker = own_driver,
) -> tuple[Mission, TransferReport]:
    """Download mission, fence and rally points of the vehicle at ``url``; raises the errors of `upload`."""
    with open_driver(url, _on_event(progress, "downloading"), None) as driver:
        note(f"waiting for a vehicle on {driver.endpoint.link.name}")
        vehicle = driver.wait_for_vehicle(wait_s, system_id=system_id)
        mission, costs = driver.download()
        counts = {kind.name.lower(): len(mission.plan(kind)) for kind in MissionType}
        return mission, replace(_report(vehicle, costs), items=counts)


def find_vehicles(
    url: str,
    system_ids: Sequence[int | None],
    *,
    wait_s: float = 10.0,
    note: Note = _silent,
    open_driver: DriverMaker = own_driver,
) -> tuple[Vehicle, ...]:
    """Wait for the heartbeats of several vehicles at ``url``.

    ``system_ids`` has an entry for each vehicle; None stands for any vehicle that has no entry and was not
    found yet. ``wait_s`` is the timeout for each vehicle. Raises NoVehicleError if a vehicle is not heard,
    and LinkError if the link cannot be opened or fails.
    """
    known = {system_id for system_id in system_ids if system_id is not None}
    found = []
    with open_driver(url, _silent, None) as driver:
        whom = "a vehicle" if len(system_ids) == 1 else f"{len(system_ids)} vehicles"
        note(f"waiting for {whom} on {driver.endpoint.link.name}")
        for system_id in system_ids:
            found.append(driver.wait_for_vehicle(wait_s, system_id=system_id, besides=known))
            known.add(found[-1].system_id)
    return tuple(found)


def _on_event(progress: ProgressCallback, what: str) -> OnEvent:
    def on_event(event: Event) -> None:
        if isinstance(event, Progress):
            progress(f"{what} {event.mission_type.name.lower()}", event.done, event.total)

    return on_event


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
