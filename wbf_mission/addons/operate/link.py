"""Runs with vehicles behind links: discovery, preflight, battery change."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from geo.errors import WbfMissionError
from geo.system import steady_s
from mission.ground.arming_gate import FARTHEST_M, ArmingGate
from mission.ground.link import find_vehicles
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import FrameSink
from mission.model import GeoPoint
from mission.transfer import TransferMaker
from mission.transfer.vehicles import Vehicle as HeardVehicle
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.host.injection import AnyFault
from wbf_mission.addons.base.inquiry import VehicleSnapshot, ask_vehicle
from wbf_mission.addons.base.links import Heard, LinkHost, LiveFlightError, Via, fitted_to, via_named
from wbf_mission.addons.operate.console import TerminalConsole
from wbf_mission.addons.operate.real_sorties import (
    REAL_FULL,
    BatteryWait,
    RealSorties,
    needed_fraction,
    risen_fraction,
)
from wbf_mission.addons.operate.riding_camera import RidingCamera
from wbf_mission.cli.output import Output
from wbf_mission.events import EventStream
from wbf_mission.planning import PlanResult
from wbf_mission.planning.builder import budget_left
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.planning.sorties import CHANGE_S, SortiePlan
from wbf_mission.preflight.finding import Concern, Finding, PreflightError, Report, Severity
from wbf_mission.preflight.run import check_mission, check_plans
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.run.campaign import Campaign
from wbf_mission.run.hosting import Hosting, tap_of
from wbf_mission.run.joint_flight import OperatorConsole
from wbf_mission.run.orders import Orders
from wbf_mission.run.record import FlightRecord
from wbf_mission.run.sortie import Sortie
from wbf_mission.scenario import Scenario, VehicleOptions
from wbf_mission.scenario.parts import MOST_VEHICLES
from wbf_mission.scenario.values import LAYERS

_NEAR_M = 5.0
_AUTOPILOT = int(m.MAV_COMP_ID_AUTOPILOT1)


def _in_a_layer(finding: Finding) -> Finding:
    """Return the finding; if it is about the return altitude, as a warning about altitude layers."""
    if finding.code != "other-return":
        return finding
    text = "the vehicle would not return at the height of its layer: other vehicles may fly there"
    return replace(
        finding, severity=Severity.WARNING, text=text, fix="set the parameter to the planned height"
    )


def require_single_flight(scenario: Scenario) -> None:
    """Raise LiveFlightError if a run has several flights, or the paper's ideal robots."""
    if scenario.farm.days * scenario.farm.flights_per_day > 1:
        msg = "--connect cannot change batteries and flies only one flight; leave out days and flights"
        raise LiveFlightError(msg)
    for name in scenario.vehicle.fleet:
        if get_vehicle(name).is_ideal:
            msg = f"vehicle {name} is not a real vehicle: name the vehicle that flies, such as quad"
            raise LiveFlightError(msg)


def wanted_vehicles(
    urls: Sequence[str], system_ids: Sequence[int], named: int
) -> tuple[tuple[str, int | None], ...]:
    """Return the link and the system id of each vehicle; a system id of None accepts any vehicle.

    A single link is used for all vehicles, and so is a single vehicle name in the scenario. Raises
    LiveFlightError if the counts do not match, or a vehicle is named twice.

    >>> wanted_vehicles(["tcp:a:1"], [3, 5], 1), wanted_vehicles(["tcp:a:1", "tcp:b:1"], [], 2)
    ((('tcp:a:1', 3), ('tcp:a:1', 5)), (('tcp:a:1', None), ('tcp:b:1', None)))
    """
    count = max(len(urls), len(system_ids), named)
    if len(urls) not in (1, count) or len(system_ids) not in (0, count) or named not in (1, count):
        raise LiveFlightError(
            f"{named} vehicles, {len(urls)} links and {len(system_ids)} system ids do not match: give "
            f"--connect once or once for each vehicle, and --system-id once for each vehicle or never"
        )
    if count > MOST_VEHICLES:
        raise LiveFlightError(f"{count} vehicles: at most {MOST_VEHICLES} fly together")
    links = list(urls) if len(urls) > 1 else [*urls] * count
    ids: Sequence[int | None] = system_ids or [None] * count
    found = tuple(zip(links, ids, strict=True))
    for url, system_id in found:
        if system_id is not None and found.count((url, system_id)) > 1:
            raise LiveFlightError(f"{url}: system {system_id} is named twice; name each vehicle once")
    return found


@dataclass(slots=True)
class LiveLink:
    """Vehicles behind one or several links, and the operator of the flight.

    Parameters
    ----------
    urls : str or sequence of str
        ``udpin:``, ``udpout:``, ``tcp:`` or ``tcpin:HOST:PORT``, or ``serial:DEVICE:BAUD``: one per vehicle,
        or one for all.
    system_ids : sequence of int
        System id of each vehicle; by default the first vehicles that are heard.
    force : bool
        Fly a plan despite errors of the preflight check, also if the autopilot would refuse it.
    change_s : float
        With `agreed`: timeout of a battery change between two sorties (s).
    tlog : Path, optional
        File for every MAVLink frame of the run.
    orders : Orders, optional
        Orders of a watcher.
    """

    urls: str | Sequence[str]
    console: OperatorConsole
    agreed: bool = False
    wait_s: float = 10.0
    system_ids: Sequence[int] = ()
    force: bool = False
    via: Via = field(default_factory=Via)
    change_s: float = CHANGE_S
    tlog: Path | None = None
    orders: Orders | None = None
    _events: EventStream = field(default_factory=EventStream, init=False)
    _heard: dict[int, tuple[str, HeardVehicle]] = field(default_factory=dict, init=False)
    # Vehicle options of the plans before the vehicles were queried
    _assumed: dict[int, VehicleOptions] = field(default_factory=dict, init=False)

    full: ClassVar[float] = REAL_FULL
    faults: ClassVar[tuple[()]] = ()

    def sorties(self, cut: SortiePlan, vehicle: Vehicle, footprint: int) -> RealSorties:
        """Return a tracker of a vehicle's sorties, in which the operator confirms battery changes."""
        return RealSorties(cut, vehicle, footprint, self.change_battery)

    def note(self, text: str) -> None:
        """Send a line to the operator."""
        self._events.note(text)

    def fitted(self, scenario: Scenario, events: EventStream) -> Scenario:
        """Wait for the vehicles, and return the scenario with the rules of their autopilots.

        Raises LiveFlightError if the run is not possible with these vehicles, LinkError without a link, and
        NoVehicleError without a vehicle.
        """
        self._events = events
        require_single_flight(scenario)
        urls = (self.urls,) if isinstance(self.urls, str) else tuple(self.urls)
        wanted = wanted_vehicles(urls, tuple(self.system_ids), len(scenario.vehicle.fleet))
        self.via.check_count(len(wanted))
        found: dict[str, list[HeardVehicle]] = {}
        for url in dict.fromkeys(url for url, _ in wanted):
            ids = [system_id for other, system_id in wanted if other == url]
            found[url] = list(
                find_vehicles(url, ids, wait_s=self.wait_s, note=self.note, open_driver=self.via.driver)
            )
        heard = [(url, found[url].pop(0)) for url, _ in wanted]
        by_id: dict[int, tuple[str, HeardVehicle]] = {}
        for url, vehicle in heard:
            self.note(f"heard: system {vehicle.system_id}, {vehicle.profile.name}")
            if vehicle.system_id in by_id:
                raise LiveFlightError(
                    f"system {vehicle.system_id} is heard on {by_id[vehicle.system_id][0]} and on {url}: give"
                    " each vehicle its own system id (PX4: MAV_SYS_ID, ArduPilot: MAV_SYSID or"
                    " SYSID_THISMAV)"
                )
            by_id[vehicle.system_id] = url, vehicle
            self.via.check(scenario, vehicle)
        self._heard = dict(sorted(by_id.items()))
        return fitted_to(scenario, *(vehicle for _, vehicle in heard))

    def numbered(self, vehicles: Sequence[Vehicle]) -> tuple[Vehicle, ...]:
        """Return the run's vehicles, each with the system id and position of a vehicle that was heard.

        A vehicle starts and lands at its position, so its budget includes the flight to the first waypoint
        and back. The planned start is kept if the vehicle is within a few metres of it, or too far away to
        fly there.

        Raises WbfMissionError if the budget does not suit a vehicle at its position, or the vehicle is no
        longer heard.
        """
        return tuple(
            self._standing(replace(vehicle, task=replace(vehicle.task, system_id=number)))
            for vehicle, number in zip(vehicles, self._heard, strict=True)
        )

    def _standing(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle with its reported position and parameters."""
        task = vehicle.task
        snapshot, who = self._asked(task.system_id, placed=True), self._who(task.system_id)
        self._assumed[task.system_id], own = vehicle.vehicle, snapshot.as_set(vehicle.vehicle)
        if changed := {
            key: own.parameters[key]
            for key in own.parameters
            if own.parameters[key] != vehicle.vehicle.parameters.get(key)
        }:
            values = ", ".join(f"{name} {value:g}" for name, value in changed.items())
            self.note(f"{who}planned with the vehicle's parameters: {values}")
        home_m = self._start_of(vehicle, snapshot.position, who)
        if own is vehicle.vehicle and home_m == task.builder.home_m:
            return vehicle
        return replace(vehicle, vehicle=own).starting_at(home_m)

    def _start_of(self, vehicle: Vehicle, stands: GeoPoint | None, who: str) -> tuple[float, float]:
        """Return a vehicle's start position, in metres of the farm frame."""
        planned_m, frame = vehicle.task.builder.home_m, vehicle.task.builder.farm.frame
        if stands is None:
            self.note(f"{who}the vehicle reports no position: its plan begins at the start of the farm")
        if stands is None or vehicle.mission.file is not None:
            return planned_m
        x_m, y_m = map(float, frame.from_wgs84(stands.latitude_deg, stands.longitude_deg))
        away_m = math.dist((x_m, y_m), planned_m)
        if not _NEAR_M < away_m <= FARTHEST_M:
            return planned_m
        away = f"{away_m:.0f} m from the start of the farm"
        self.note(f"{who}the vehicle is {away}: its plan begins at its position")
        return x_m, y_m

    def _who(self, number: int) -> str:
        """Return the prefix of lines about a vehicle."""
        return f"vehicle {number}: " if len(self._heard) > 1 else ""

    def _asked(self, number: int, *, placed: bool = False) -> VehicleSnapshot:
        """Query a vehicle's state and settings (`placed`: see `Inquiry`)."""
        (url, _), who = self._heard[number], self._who(number)

        def note(text: str) -> None:
            self.note(who + text)

        return ask_vehicle(url, wait_s=self.wait_s, system_id=number, note=note, placed=placed)

    def check(self, campaign: Campaign, events: EventStream) -> None:
        """Check all plans before take-off, including plans of later sorties; refuse plans with errors."""
        planned, cut = campaign.planned, campaign.cut
        if cut is not None:
            self.note(cut.told())
            later = [(plan, planned[0][0]) for plan in campaign.sorties[1:]]
            check_plans(later, "nothing was sent", events, force=self.force)
        if not campaign.run.decider.steers:
            missions = [[plan] for _, plan in planned] if cut is None else [campaign.sorties]
            for left in filter(None, dict.fromkeys(map(budget_left, missions))):
                self.note(left)
        self.check_sent(planned)

    def check_sent(self, planned: Iterable[tuple[Vehicle, PlanResult]]) -> None:
        """Check plans before their upload, against the answers of each vehicle.

        A vehicle that cannot arm yet is not an error: the start waits until it can.

        All vehicles are queried before the first error is raised. Raises PreflightError if there are errors,
        unless `force` is true.
        """
        refusals = []
        for vehicle, plan in planned:
            number = vehicle.task.system_id
            who, snapshot = self._who(number), self._asked(number)
            given = Circumstances.of(vehicle, plan.farm, snapshot)
            layered = bool(who) and vehicle.vehicle.keeps.kind == LAYERS
            if layered:  # Predict the return at the layer's altitude, not at the one that the vehicle has set
                given = replace(given, vehicle=self._assumed.get(number, vehicle.vehicle))
            report = check_mission(plan.mission, given).report
            if layered:
                report = Report(tuple(map(_in_a_layer, report.findings)))
            counted = report.about(Concern.PLAN, Concern.PARAMETERS, Concern.STATE)
            refused = None if self.force else counted.refusal("nothing was sent")
            report.tell(self._events, refused, who)
            if refused is not None:
                refusals.append(PreflightError(f"{who}{refused}", refused.finding))
        if refusals:
            raise refusals[0]

    def change_battery(self, vehicle: Vehicle, plan: PlanResult, *, last: FlightRecord, which: str) -> str:
        """Wait for the battery change, and check the next sortie.

        Return the reason why the sortie cannot be flown; empty if it can. With `agreed`, no operator has to
        confirm the change; instead, the battery reading has to rise within `change_s`.
        """
        number = vehicle.task.system_id
        url, _ = self._heard[number]
        question = f"{which}: change the battery of the vehicle, then press Enter (q ends)"
        if self.agreed:
            self.note(f"{which}: waiting for another battery")
        why = BatteryWait(
            needed_fraction(plan),
            None if self.agreed else partial(self.console.goes_on, question),
            risen_fraction(*last.battery_readings),
            self.change_s,
            self.note,
        ).wait(url, number)
        if why:
            return why
        try:
            self.check_sent([(vehicle, plan)])
        except WbfMissionError as error:
            return str(error)
        return ""

    def hosting(self, faults: Sequence[AnyFault]) -> Hosting:  # noqa: ARG002
        """Return the host that flies these vehicles over their links."""
        heard = tuple(self._heard.values())
        return LinkHosting(link=self, heard=heard, tlog=self.tlog, force=self.force, orders=self.orders)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkHosting(Hosting):
    """Hosts vehicles behind links: this program runs their ground stations and leaf cameras."""

    link: LiveLink
    heard: Sequence[Heard]
    waits_for_decisions: ClassVar[bool] = False

    @property
    def transfers(self) -> TransferMaker:
        """Factory of mission transfers."""
        return self.link.via.transfers

    def arming_gate(self, system_id: int) -> ArmingGate:
        """Return the gate before arming: the vehicle's pre-arm checks and the operator's confirmation."""
        return ArmingGate((system_id, _AUTOPILOT), agreed=self.link.agreed, clock=steady_s)

    def open(
        self, sorties: Sequence[Sortie], writer: FrameSink | None, **_of_a_simulation: object
    ) -> LinkHost:
        """Open the links; raise LinkError if an address is wrong, in use or unreachable."""
        cameras = [riding_camera(sortie) for sortie in sorties]
        tap = tap_of(writer, lambda _now_s: time.time())
        grounds = [sortie.ground for sortie in sorties]
        return self.link.via.serve(self.heard, cameras, grounds, tap, self.link.note)


def riding_camera(sortie: Sortie) -> RidingCamera:
    """Return the leaf camera that follows the telemetry of a sortie's vehicle."""
    camera = LeafCameraComponent(sortie.leaf_camera, sortie.plan.farm, system_id=sortie.system_id)
    riding = RidingCamera(camera, sortie.held_mission, sortie.is_changing, sortie.follow)
    sortie.images_missed = lambda: riding.missed
    return riding


def connect(output: Output, urls: Sequence[str], *, via: str, **options: Any) -> LiveLink:
    """Return the vehicles behind links; their operator uses the terminal of the command."""
    return LiveLink(urls, TerminalConsole(output, options["orders"]), via=via_named(via), **options)
