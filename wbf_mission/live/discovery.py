"""Vehicles behind links, and the scenario fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from geo.errors import WbfMissionError
from mission.transfer.vehicles import Vehicle
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.kind import get_kind, kind_of_type
from sim_vehicle.autopilot import name_of_number
from wbf_mission.scenario import Scenario, scenario_with
from wbf_mission.scenario.parts import MOST_VEHICLES

__all__ = [
    "LiveFlightError",
    "fitted_to",
    "require_single_flight",
    "typical_vehicle",
    "wanted_vehicles",
]


class LiveFlightError(WbfMissionError, ValueError):
    """A run that is not possible with a vehicle behind a link."""


def require_single_flight(scenario: Scenario) -> None:
    """Raise LiveFlightError for a run of several flights, and for the paper's ideal robots."""
    if scenario.farm.days * scenario.farm.flights_per_day > 1:
        msg = "--connect does one flight: batteries are not changed by a program; leave out days and flights"
        raise LiveFlightError(msg)
    for name in scenario.vehicle.fleet:
        if get_vehicle(name).is_ideal:
            msg = f"vehicle {name} is no real one: name what flies, such as quad"
            raise LiveFlightError(msg)


def wanted_vehicles(
    urls: Sequence[str], system_ids: Sequence[int], named: int
) -> tuple[tuple[str, int | None], ...]:
    """Return link and system id of each vehicle; an id of None accepts any vehicle.

    A single link serves all vehicles, and so does a single name in the scenario. Raises LiveFlightError if
    the counts do not match, or a vehicle is named twice.

    Examples
    --------
    >>> wanted_vehicles(["tcp:a:1"], [3, 5], 1), wanted_vehicles(["tcp:a:1", "tcp:b:1"], [], 2)
    ((('tcp:a:1', 3), ('tcp:a:1', 5)), (('tcp:a:1', None), ('tcp:b:1', None)))
    """
    count = max(len(urls), len(system_ids), named)
    if len(urls) not in (1, count) or len(system_ids) not in (0, count) or named not in (1, count):
        msg = (
            f"{named} vehicles, {len(urls)} links and {len(system_ids)} system ids do not fit: give --connect"
            " once or for each vehicle, --system-id for each or not at all"
        )
        raise LiveFlightError(msg)
    if count > MOST_VEHICLES:
        msg = f"{count} vehicles: at most {MOST_VEHICLES} fly together"
        raise LiveFlightError(msg)
    links = list(urls) if len(urls) > 1 else [*urls] * count
    ids: Sequence[int | None] = system_ids or [None] * count
    found = tuple(zip(links, ids, strict=True))
    for url, system_id in found:
        if system_id is not None and found.count((url, system_id)) > 1:
            msg = f"{url}: system {system_id} is named twice; name each vehicle once"
            raise LiveFlightError(msg)
    return found


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
