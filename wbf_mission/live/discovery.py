"""What the vehicle at the other end of a link means for a run."""

from __future__ import annotations

from geo.errors import WbfMissionError
from mission.link.codec.dialect import mavlink as m
from mission.transfer.vehicles import Vehicle
from sim_vehicle.airframe.catalog import get_vehicle
from wbf_mission.scenario import Scenario, scenario_with

__all__ = ["LiveFlightError", "fitted_to", "require_single_flight", "typical_vehicle"]

_AUTOPILOTS = {int(m.MAV_AUTOPILOT_PX4): "px4", int(m.MAV_AUTOPILOT_ARDUPILOTMEGA): "ardupilot"}
_KINDS = {int(m.MAV_TYPE_FIXED_WING): "fixed-wing", int(m.MAV_TYPE_GROUND_ROVER): "rover"}
_TYPICAL = {"multirotor": "quad", "fixed-wing": "fixed-wing", "rover": "rover"}


class LiveFlightError(WbfMissionError, ValueError):
    """A run that a vehicle behind a link cannot do."""


def require_single_flight(scenario: Scenario) -> None:
    """Refuse what needs hands or several links: more vehicles than one, more flights, robots of no size.

    Raises
    ------
    LiveFlightError
        If the scenario asks for it.
    """
    if len(scenario.vehicle.fleet) > 1:
        msg = f"{len(scenario.vehicle.fleet)} vehicles: --connect flies the one behind its link"
        raise LiveFlightError(msg)
    if scenario.farm.days * scenario.farm.flights_per_day > 1:
        msg = "--connect does one flight: batteries are not changed by a program; leave out days and flights"
        raise LiveFlightError(msg)
    if get_vehicle(scenario.vehicle.fleet[0]).is_ideal:
        msg = f"vehicle {scenario.vehicle.fleet[0]} is no real one: name what flies, such as quad"
        raise LiveFlightError(msg)


def fitted_to(scenario: Scenario, vehicle: Vehicle) -> Scenario:
    """Return a scenario as the vehicle that was heard flies it: by the rules of its autopilot.

    Those of the scenario hold for an autopilot of which no rules are known.

    Raises
    ------
    LiveFlightError
        If the scenario's vehicle is one of another kind.
    """
    name = scenario.vehicle.fleet[0]
    planned, heard = get_vehicle(name).kind, _kind_of(vehicle)
    if planned != heard:
        msg = f"vehicle {name} is a {planned}, but a {heard} is heard; name one of its kind with --vehicle"
        raise LiveFlightError(msg)
    autopilot = _AUTOPILOTS.get(vehicle.autopilot)
    return scenario if autopilot is None else scenario_with(scenario, {"autopilot": autopilot})


def typical_vehicle(vehicle: Vehicle) -> str:
    """Return the name of a vehicle of the kind that was heard, for who does not say which it is.

    Examples
    --------
    >>> typical_vehicle(Vehicle(1, 1, 12, 1))
    'fixed-wing'
    """
    return _TYPICAL[_kind_of(vehicle)]


def _kind_of(vehicle: Vehicle) -> str:
    return _KINDS.get(vehicle.vehicle_type, "multirotor")
