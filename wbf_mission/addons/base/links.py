"""Connects to vehicles over MAVLink links, fits the scenario to them, and uploads checked missions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

from geo.errors import WbfMissionError
from geo.imports import entry_named, load_entry
from mission.errors import LinkError
from mission.ground.link import DriverMaker, TransferReport, own_driver, upload
from mission.ground.station import GroundStation
from mission.link.codec.dialect import Message
from mission.model import Mission
from mission.transfer import OWN_TRANSFERS, TransferMaker
from mission.transfer.driver import OnEvent, OnText, TransferDriver
from mission.transfer.vehicles import Vehicle
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import get_kind, kind_of_type
from sim_vehicle.autopilot import name_of_number
from sim_vehicle.component import NEVER, Component
from sim_vehicle.host.ports import ServerUrl
from sim_vehicle.host.server import Server
from sim_vehicle.host.simulation import StopReason
from wbf_mission.addons.base.inquiry import VehicleSnapshot, ask_vehicle
from wbf_mission.events import EventStream
from wbf_mission.preflight.finding import Concern, Report
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.scenario import Scenario, scenario_with

Tap = Callable[[bytes, float], None]
Note = Callable[[str], None]
Heard = tuple[str, Vehicle]
"""A vehicle with its link."""
_NAMED = 4  # Maximum number of senders in a note about dropped datagrams.


class LiveFlightError(WbfMissionError, ValueError):
    """The run is not possible with the vehicle at the other end of the link."""


def fitted_to(scenario: Scenario, *vehicles: Vehicle) -> Scenario:
    """Return the scenario with the vehicles that were heard, and with their autopilots.

    If a vehicle's autopilot is unknown, the scenario's autopilot is kept.

    `vehicles` are in the order of the scenario's vehicles; the returned scenario orders them by system id.
    Raises LiveFlightError if a vehicle is of another kind.
    """
    options = scenario.vehicle if len(vehicles) == 1 else replace(scenario.vehicle, vehicles=len(vehicles))
    fitted = []
    for name, planned_for, heard in zip(options.fleet, options.autopilots, vehicles, strict=True):
        planned, kind = get_vehicle(name).kind, kind_of_type(heard.vehicle_type)
        if planned != kind:
            which = "" if len(vehicles) == 1 else f" as system {heard.system_id}"
            does = f"a {kind} is heard{which}; name a {kind} with --vehicle"
            raise LiveFlightError(f"vehicle {name} is a {planned}, but {does}")
        fitted.append((heard.system_id, name, name_of_number(heard.autopilot) or planned_for))
    _, names, autopilots = zip(*sorted(fitted), strict=True)
    if len(vehicles) == 1:
        return scenario_with(scenario, {"autopilot": autopilots[0]})
    changes = {"vehicle": _for_each(names), "autopilot": _for_each(autopilots), "vehicles": len(vehicles)}
    return scenario_with(scenario, changes)


def _for_each(names: Sequence[str]) -> str:
    """Return a scenario's value for all vehicles: one name if all are equal, else a list with commas."""
    return names[0] if len(set(names)) == 1 else ",".join(names)


def typical_vehicle(vehicle: Vehicle) -> str:
    """Return the name of the default vehicle of the kind that was heard.

    >>> typical_vehicle(Vehicle(1, 1, 12, 2))
    'quad'
    """
    return get_kind(kind_of_type(vehicle.vehicle_type)).typical


def upload_checked(
    mission: Mission,
    link: str,
    around: Callable[[VehicleSnapshot], Circumstances],
    events: EventStream,
    *,
    wait_s: float = 10.0,
    system_id: int | None = None,
    force: bool = False,
    open_driver: DriverMaker = own_driver,
) -> tuple[TransferReport, Report]:
    """Query a vehicle, then check, upload and read back a mission; return the transfer and the findings.

    `around` receives the vehicle's answers, and returns the circumstances under which the mission is checked.
    The other parameters, and the errors, are described at `mission.ground.link.upload`. Raises PreflightError
    if the check finds errors and `force` is not set.
    """
    snapshot = ask_vehicle(link, wait_s=wait_s, system_id=system_id, note=events.note)
    # Findings about the vehicle's present state are left out, since they matter only before a take-off.
    found = check_mission(mission, around(snapshot)).report.about(Concern.PLAN, Concern.PARAMETERS)
    found.require_no_errors("nothing was sent", events, force=force)
    try:
        report = upload(
            mission,
            link,
            wait_s=wait_s,
            system_id=snapshot.system_id,
            progress=events.progress,
            note=events.note,
            force=force,
            parameters=snapshot.parameters,
            open_driver=open_driver,
        )
    except KeyboardInterrupt:
        held = "it may hold a mixture of the old mission and the new one; upload the mission again"
        events.warn(f"system {snapshot.system_id}: the upload is incomplete: {held}")
        raise
    return report, found


def links_of(heard: Iterable[Heard]) -> tuple[ServerUrl, ...]:
    """Return the links of the vehicles that were heard; of several, each accepts only its own vehicles."""
    systems: dict[str, set[int]] = {}
    for url, vehicle in heard:
        systems.setdefault(url, set()).add(vehicle.system_id)
    if len(systems) == 1:
        return (ServerUrl(next(iter(systems))),)
    return tuple(ServerUrl(url, frozenset(ids)) for url, ids in systems.items())


class LinkHost(Server):
    """Server of real links; Ctrl-C raises KeyboardInterrupt in the caller.

    ``through`` is a function that filters the messages of a component before `send` sends them: it receives
    the messages and the time, and returns the messages to send.
    """

    def __init__(
        self,
        components: Sequence[Component],
        urls: Sequence[str | ServerUrl],
        *,
        through: Callable[[Iterable[Message], float], Iterable[Message]] = lambda messages, _now_s: messages,
        note: Note = lambda _text: None,
        **options: Any,
    ) -> None:
        super().__init__(components, urls, **options)
        self._through = through
        self._note = note

    def run(self, until: Callable[[float], bool] | None = None, limit_s: float = NEVER) -> StopReason:
        """Serve until a condition holds or time is up; a KeyboardInterrupt leaves the links open."""
        reason = super().run(until=until, limit_s=limit_s)
        if reason is StopReason.STOPPED:
            raise KeyboardInterrupt
        return reason

    def send(self, component: Component, messages: Iterable[Message]) -> None:
        """Send the filtered messages of a component."""
        super().send(component, self._through(messages, self.now_s))

    def close(self) -> None:
        """Close the links."""
        if dropped := self.dropped.most_common(_NAMED):
            named = ", ".join(f"{sender} ({count})" for sender, count in dropped)
            self._note(f"datagrams of {named} were dropped: this program was too busy to receive them")
        super().close()


class Via:
    """Access to vehicles by this program's MAVLink code; subclasses in add-ons use other libraries."""

    @property
    def transfers(self) -> TransferMaker:
        """Factory that makes mission transfers."""
        return OWN_TRANSFERS

    def serve(
        self,
        heard: Sequence[Heard],
        cameras: Sequence[Component],
        grounds: Sequence[GroundStation],
        tap: Tap | None,
        note: Note,
    ) -> LinkHost:
        """Open the links that ground stations and their cameras use; LinkError if a link cannot be opened."""
        pairs = zip(cameras, grounds, strict=True)
        components: list[Component] = [part for pair in pairs for part in pair]
        return LinkHost(components, links_of(heard), tap=tap, at_once=True, note=note)

    def driver(self, url: str, on_event: OnEvent, on_text: OnText | None = None) -> TransferDriver:
        """Open a link, and return its transfer driver; LinkError if the link cannot be opened."""
        return own_driver(url, on_event, on_text)

    def check_count(self, vehicles: int) -> None:
        """Raise LiveFlightError if this access does not support this number of vehicles."""

    def check(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Raise LiveFlightError if a discovered vehicle cannot fly the scenario with this access."""


def via_named(name: str) -> Via:
    """Return the `Via` for a name: `Via` itself for ``own``, otherwise the class of this entry point."""
    entry = entry_named("wbf_mission.vias", name)
    if entry is None:
        return Via()
    return load_entry(entry, f"the way {name}", LinkError)()
