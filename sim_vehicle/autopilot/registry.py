"""Autopilots by name, found through the entry point group ``wbf_mission.autopilots``."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from geo.installed import entry_points
from sim_vehicle.airframe.autopilot_names import (
    AUTOPILOT_GROUP,
    DEFAULT_AUTOPILOT,
    NO_AUTOPILOT,
    autopilot_names,
)
from sim_vehicle.airframe.parameters import ParameterSpec, check_parameters
from sim_vehicle.autopilot.autopilot import Autopilot, Firmware
from sim_vehicle.autopilot.fixed_wing import FixedWingProcedures
from sim_vehicle.autopilot.generic import GENERIC
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.flight_procedures import FlightProcedures

__all__ = [
    "adapt_vehicle",
    "autopilot_of_number",
    "estimate_errs",
    "firmware_of",
    "fixed_wing_procedures",
    "flight_procedures",
    "forget_autopilots",
    "get_autopilot",
    "name_of_number",
    "with_autopilot",
    "with_return_margin",
]

# Of what an estimate's errors carry a vehicle aside: so many are its margin to a step of the return altitude.
_RETURN_DEVIATIONS = 3.0
_NOT_INSTALLED = f"no package gives any in the entry points {AUTOPILOT_GROUP}: install wbf-mission again"


def get_autopilot(name: str = DEFAULT_AUTOPILOT) -> Autopilot:
    """Autopilot of that name; case does not matter.

    Raises
    ------
    VehicleError
        If there is no autopilot of that name, or its package does not give one.

    Examples
    --------
    >>> get_autopilot("ardupilot").for_vehicle("fixed-wing").title
    'ArduPlane'
    """
    return _load(name.strip().lower())


@cache
def _load(name: str) -> Autopilot:
    entry = next((e for e in entry_points(group=AUTOPILOT_GROUP) if e.name.lower() == name), None)
    if entry is None:
        known = ", ".join(autopilot_names())
        msg = f"unknown autopilot {name!r}: " + (f"choose {known}" if known else _NOT_INSTALLED)
        raise VehicleError(msg)
    try:
        autopilot = entry.load()
    except (ImportError, AttributeError) as error:
        msg = f"autopilot {entry.name} ({entry.value}) cannot be loaded: {error}"
        raise VehicleError(msg) from error
    if not isinstance(autopilot, Autopilot):
        msg = f"autopilot {entry.name} ({entry.value}) is no sim_vehicle.autopilot.autopilot.Autopilot"
        raise VehicleError(msg)
    if autopilot.name != entry.name:
        msg = f"autopilot {entry.name} ({entry.value}) calls itself {autopilot.name}: the names must be equal"
        raise VehicleError(msg)
    return autopilot


def autopilot_of_number(mav_autopilot: int) -> Autopilot:
    """Autopilot whose MAV_AUTOPILOT a heartbeat has; the default one when none of the installed has it.

    Examples
    --------
    >>> autopilot_of_number(3).title, autopilot_of_number(0).title
    ('ArduPilot', 'PX4')
    """
    name = name_of_number(mav_autopilot)
    return get_autopilot() if name is None else get_autopilot(name)


def name_of_number(mav_autopilot: int) -> str | None:
    """Name of the autopilot whose MAV_AUTOPILOT a heartbeat has; None when none of the installed has it."""
    for name in autopilot_names():
        firmwares = get_autopilot(name).firmwares.values()
        if mav_autopilot in {firmware.mavlink.identity.mav_autopilot for firmware in firmwares}:
            return name
    return None


def forget_autopilots() -> None:
    """Find the installed autopilots again, after a package was installed while the program runs."""
    autopilot_names.cache_clear()
    _load.cache_clear()


def firmware_of(spec: VehicleSpec) -> Firmware | None:
    """Firmware whose procedures move a vehicle; None for a vehicle of no autopilot in particular.

    There is no generic fixed wing or rover: the default autopilot's procedures move them.
    """
    if spec.is_ideal:
        return None
    if spec.autopilot != NO_AUTOPILOT:
        return get_autopilot(spec.autopilot).for_vehicle(spec.kind)
    return None if spec.kind == "multirotor" else get_autopilot().for_vehicle(spec.kind)


def flight_procedures(spec: VehicleSpec) -> FlightProcedures:
    """Procedures that move a vehicle."""
    firmware = firmware_of(spec)
    return GENERIC if firmware is None else firmware.procedures


def estimate_errs(spec: VehicleSpec) -> bool:
    """Whether a vehicle can be flown by an estimate that errs as its autopilot's does: PX4's multirotors."""
    firmware = firmware_of(spec)
    return firmware is not None and firmware.strays_m is not None


def with_return_margin(spec: VehicleSpec) -> VehicleSpec:
    """Vehicle as its way home is priced when its estimate errs: by the dearer side of a step near home.

    PX4 returns at ``RTL_RETURN_ALT`` from beyond ``RTL_MIN_DIST``, and lower from nearer: who is carried over
    that edge climbs and sinks 20 m more. ArduCopter's return altitude (``RTL_CONE_SLOPE``, ``RTL_CLIMB_MIN``)
    grows steadily with the distance, and its estimate is exact.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> flown = [with_autopilot(get_vehicle("quad"), name) for name in ("px4", "ardupilot")]
    >>> [round(with_return_margin(one).return_margin_m, 2) for one in flown]
    [0.64, 0.0]
    """
    firmware = firmware_of(spec)
    if firmware is None or firmware.strays_m is None:
        return spec
    return replace(spec, return_margin_m=_RETURN_DEVIATIONS * firmware.strays_m(spec))


def fixed_wing_procedures(spec: VehicleSpec) -> FixedWingProcedures:
    """Procedures that move a fixed wing.

    Raises
    ------
    VehicleError
        If the vehicle is none, or its autopilot's procedures are not those of a fixed wing.
    """
    procedures = flight_procedures(spec)
    if not isinstance(procedures, FixedWingProcedures):
        msg = f"vehicle {spec.name}: {procedures.name} has no procedures of a fixed wing for kind {spec.kind}"
        raise VehicleError(msg)
    return procedures


def with_autopilot(
    spec: VehicleSpec, name: str, parameters: Mapping[str, float] | None = None
) -> VehicleSpec:
    """Vehicle as an autopilot flies it, with further parameters of that autopilot.

    The ideal vehicle has no autopilot and is returned as it is; a fixed wing or rover of no autopilot in
    particular is flown as the default autopilot does it. The vehicle's own parameters of that autopilot hold
    unless others are given.

    Raises
    ------
    VehicleError
        An unknown autopilot, one that does not fly such a vehicle, a parameter that it has not, a value
        outside its range, or any parameter for the ideal vehicle.
    """
    if spec.is_ideal:
        if parameters:
            msg = (
                f"vehicle {spec.name}: the ideal vehicle has no autopilot and no parameter "
                f"{next(iter(parameters))}: leave the parameters out or choose another vehicle"
            )
            raise VehicleError(msg)
        return spec
    if name == NO_AUTOPILOT and spec.kind != "multirotor":
        name = DEFAULT_AUTOPILOT
    before = spec.parameters if spec.autopilot == name else ()
    merged = {**dict(spec.parameters_for(name)), **dict(before), **(parameters or {})}
    flown = replace(spec, autopilot=name, parameters=tuple(merged.items()))
    procedures = flight_procedures(flown)
    check_parameters(flown, {**procedures.parameters, **_card_parameters(flown)})
    return procedures.fit(flown)


def _card_parameters(spec: VehicleSpec) -> dict[str, ParameterSpec]:
    """Return the parameters that give room for plans, as far as the vehicle's autopilot has them."""
    firmware = firmware_of(spec)
    cards = () if firmware is None else firmware.profile.cards.values()
    text = "room on the SD card"
    return {c.parameter: ParameterSpec(0.0, 0.0, c.largest_kib, "KiB", text, integer=True) for c in cards}


def adapt_vehicle(spec: VehicleSpec, autopilot: Autopilot) -> VehicleSpec:
    """Vehicle as it moves when ``autopilot`` shows itself to peers.

    A multirotor stays as it is: its dynamics may be another autopilot's, or none's in particular.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> adapt_vehicle(get_vehicle("wing"), get_autopilot("ardupilot")).autopilot
    'ardupilot'
    """
    if spec.kind in ("multirotor", "ideal") or spec.autopilot == autopilot.name:
        return spec
    return with_autopilot(replace(spec, parameters=()), autopilot.name)
