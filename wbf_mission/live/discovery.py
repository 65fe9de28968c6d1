"""Vehicles behind links: the scenario fitted to them, and checked uploads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from geo.errors import WbfMissionError
from mission.ground.link import DriverMaker, TransferReport, own_driver, upload
from mission.model import Mission
from mission.transfer.vehicles import Vehicle
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import get_kind, kind_of_type
from sim_vehicle.autopilot import name_of_number
from wbf_mission.events import EventStream
from wbf_mission.preflight.finding import Concern, Report
from wbf_mission.preflight.inquiry import VehicleSnapshot, ask_vehicle
from wbf_mission.preflight.run import check_mission
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.scenario import Scenario, scenario_with

__all__ = [
    "LiveFlightError",
    "fitted_to",
    "typical_vehicle",
    "upload_checked",
]


class LiveFlightError(WbfMissionError, ValueError):
    """A run that is not possible with a vehicle behind a link."""


def fitted_to(scenario: Scenario, *vehicles: Vehicle) -> Scenario:
    """Return the scenario with the vehicles that were heard, and the rules of their autopilots.

    For an unknown autopilot the scenario's rules are kept.

    `vehicles` are in the order of the scenario's; the returned scenario orders them by system id. Raises
    LiveFlightError if a vehicle is of another kind.
    """
    options = scenario.vehicle if len(vehicles) == 1 else replace(scenario.vehicle, vehicles=len(vehicles))
    fitted = []
    for name, planned_for, heard in zip(options.fleet, options.autopilots, vehicles, strict=True):
        planned, kind = get_vehicle(name).kind, kind_of_type(heard.vehicle_type)
        if planned != kind:
            which = "" if len(vehicles) == 1 else f" as system {heard.system_id}"
            does = f"a {kind} is heard{which}; name one of its kind with --vehicle"
            msg = f"vehicle {name} is a {planned}, but {does}"
            raise LiveFlightError(msg)
        fitted.append((heard.system_id, name, name_of_number(heard.autopilot) or planned_for))
    _, names, autopilots = zip(*sorted(fitted), strict=True)
    if len(vehicles) == 1:
        return scenario_with(scenario, {"autopilot": autopilots[0]})
    changes = {"vehicle": _for_each(names), "autopilot": _for_each(autopilots), "vehicles": len(vehicles)}
    return scenario_with(scenario, changes)


def _for_each(names: Sequence[str]) -> str:
    """Return the names of all vehicles for a scenario, a single name if all are equal."""
    return names[0] if len(set(names)) == 1 else ",".join(names)


def typical_vehicle(vehicle: Vehicle) -> str:
    """Return the default vehicle of the kind that was heard, for a run without a vehicle name.

    Examples
    --------
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
    """Query a vehicle, check a mission for it, upload and read back; return transfer and findings.

    `around` returns the circumstances of the check for the vehicle's answers. The other parameters and errors
    are those of `mission.ground.link.upload`. Raises PreflightError if the check finds errors, unless
    `force`.
    """
    snapshot = ask_vehicle(link, wait_s=wait_s, system_id=system_id, note=events.note)
    # The vehicle's present state matters only for a start.
    found = check_mission(mission, around(snapshot)).report.about(Concern.PLAN, Concern.PARAMETERS)
    found.require_no_errors("nothing was sent", events, force=force)
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
    return report, found
