"""Autopilots, and their firmwares for the kinds of vehicles.

Each autopilot is a package with an `Autopilot` object; `get_autopilot` returns it by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pkgutil import resolve_name
from typing import TYPE_CHECKING, TypeVar

from geo.imports import entry_points, load_entry
from geo.texts import unknown
from mission.planners.cornering import Cornering
from sim_vehicle.airframe.kind import (
    AUTOPILOT_GROUP,
    DEFAULT_AUTOPILOT,
    NO_AUTOPILOT,
    VehicleKind,
    autopilot_names,
    get_kind,
    kind_names,
)
from sim_vehicle.autopilot.behaviour import MissionBehaviour
from sim_vehicle.autopilot.parameters import MavParameter, ParameterSpec, check_parameters
from sim_vehicle.autopilot.procedures import FixedWingProcedures, FlightProcedures
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from mission.autopilots.profile import Profile
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.behaviour import ColdBoot, FailsafeRules
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile
    from sim_vehicle.autopilot.stick_rules import StickRules

__all__ = [
    "DEFAULT_AUTOPILOT",
    "Autopilot",
    "Firmware",
    "adapt_vehicle",
    "autopilot_names",
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

# Return-altitude margin, in standard deviations of lateral drift.
_RETURN_DEVIATIONS = 3.0
_T = TypeVar("_T")
_NOT_INSTALLED = f"no package registers an autopilot in {AUTOPILOT_GROUP}: install wbf-mission again"


@dataclass(frozen=True, slots=True)
class Firmware:
    """An autopilot on one kind of vehicle, such as ArduCopter, ArduPlane or PX4 on a rover."""

    title: str
    """Name for messages and reports."""
    mavlink: MavlinkProfile
    """Identity, modes and message rates on MAVLink."""
    rules: FailsafeRules
    """Failsafes."""
    profile: Profile
    """Behaviour in the mission protocol."""
    parameter_table: Callable[[VehicleSpec, int], Sequence[MavParameter]]
    """Function that returns the parameters of a vehicle with a system id, except those in `procedures`."""
    procedures: FlightProcedures
    """Motion, take-off, return and landing, with their parameters."""
    takes_off: bool = False
    """Whether a mission can start on the ground without a take-off item."""
    behaviour: MissionBehaviour = field(default_factory=MissionBehaviour)
    """Behaviour of missions in flight, and of changes to them."""
    cold_boot: ColdBoot | None = None
    """Stages of the boot; None if they are unknown."""
    cornering: Cornering = field(default_factory=Cornering)
    """Turns at waypoints: the acceptance radius that the firmware can hold, and whether legs overshoot."""
    sticks: StickRules | None = None
    """Flight by sticks; None if sticks have no effect."""
    strays_m: Callable[[VehicleSpec], float] | None = None
    """Function that returns a vehicle's lateral drift due to estimate errors, as the standard deviation per
    horizontal axis (`sim_vehicle.airframe.navigation_errors`). None if the estimate is exact."""
    return_height: tuple[str, float] | None = None
    """Name of the parameter for the minimum return altitude above home, and its unit in metres. A fleet in
    altitude layers sets the parameter for each vehicle. None if fleets do not change return altitudes."""
    reference: Callable[[], Sequence[MavParameter]] = tuple
    """Function that returns all parameters of the real firmware; unsupported parameters are only stored."""

    def parameters(self, spec: VehicleSpec, system_id: int) -> tuple[MavParameter, ...]:
        """Return the parameters of a vehicle on MAVLink, sorted by name.

        Parameters of the flight procedures have an effect only if the vehicle moves by these procedures. For
        other vehicles these parameters are only stored, like the other parameters of the real firmware.
        """
        table = {parameter.name: parameter for parameter in self.reference()}
        units = {name: parameter.unit for name, parameter in table.items()}
        for parameter in self.parameter_table(spec, system_id):
            table[parameter.name] = replace(parameter, unit=units.get(parameter.name, ""))
        if spec.autopilot == self.procedures.name:
            for name, known in self.procedures.parameters.items():
                table[name] = MavParameter(
                    name,
                    integer=known.integer,
                    low=known.low,
                    high=known.high,
                    value=known.default,
                    motion=True,
                    unit=units.get(name, ""),
                )
        return tuple(table[name] for name in sorted(table))


@dataclass(frozen=True, slots=True)
class Autopilot:
    """An autopilot, registered by name in the entry point group ``wbf_mission.autopilots``."""

    name: str
    """Name of the entry point; also used on the command line, in scenarios and in vehicle files."""
    title: str
    """Name for messages and reports."""
    firmwares: Mapping[str, Firmware]
    """Firmwares by kind of vehicle; a kind can add its own (`VehicleKind.firmwares`)."""
    simulator_urls: Callable[[int], tuple[str, ...]]
    """Function that takes a vehicle number (from 0), and returns the URLs of the links of the autopilot's own
    simulator."""
    link_names: tuple[str, ...] = ()
    """Names of the simulator's links, if messages differ between links (`MavlinkProfile.link_rates_hz`)."""

    def for_vehicle(self, kind: str) -> Firmware:
        """Return the firmware for a kind of vehicle, or else the firmware for `VehicleKind.shown_as`.

        Raises
        ------
        VehicleError
            If the autopilot has no firmware for the kind.
        """
        shown_as = get_kind(kind).shown_as
        firmware = self.firmware(kind) or (self.firmware(shown_as) if shown_as else None)
        if firmware is None:
            flown = ", ".join(name for name in kind_names() if self.firmware(name))
            raise VehicleError(f"autopilot {self.name} flies no {kind}: choose a vehicle of kind {flown}")
        return firmware

    def firmware(self, kind: str) -> Firmware | None:
        """Return the firmware for a kind of vehicle, from this autopilot or the kind itself; None if none."""
        target = "" if kind in self.firmwares else get_kind(kind).firmwares.get(self.name, "")
        return _load_object(target, kind, Firmware) if target else self.firmwares.get(kind)


def get_autopilot(name: str = DEFAULT_AUTOPILOT) -> Autopilot:
    """Return the autopilot with this name, in upper or lower case.

    Raises
    ------
    VehicleError
        If the autopilot does not exist, or its entry point is not an autopilot.

    Examples
    --------
    >>> get_autopilot("ardupilot").for_vehicle("multirotor").title
    'ArduCopter'
    """
    return _load(name.strip().lower())


@cache
def _load(name: str) -> Autopilot:
    entry = next((e for e in entry_points(group=AUTOPILOT_GROUP) if e.name.lower() == name), None)
    if entry is None:
        known = autopilot_names()
        raise VehicleError(unknown("autopilot", name, known, "" if known else f"; {_NOT_INSTALLED}"))
    autopilot = load_entry(entry, f"autopilot {entry.name}", VehicleError)
    if not isinstance(autopilot, Autopilot):
        raise VehicleError(f"autopilot {entry.name} ({entry.value}) is not a sim_vehicle.autopilot.Autopilot")
    if autopilot.name != entry.name:
        msg = f"autopilot {entry.name} ({entry.value}) calls itself {autopilot.name}: the names must be equal"
        raise VehicleError(msg)
    return autopilot


def autopilot_of_number(mav_autopilot: int) -> Autopilot:
    """Return the installed autopilot with this MAV_AUTOPILOT, else the default autopilot.

    Examples
    --------
    >>> autopilot_of_number(3).title, autopilot_of_number(0).title
    ('ArduPilot', 'PX4')
    """
    name = name_of_number(mav_autopilot)
    return get_autopilot() if name is None else get_autopilot(name)


def name_of_number(mav_autopilot: int) -> str | None:
    """Return the name of the installed autopilot with this MAV_AUTOPILOT, or None."""
    for name in autopilot_names():
        firmwares = get_autopilot(name).firmwares.values()
        if mav_autopilot in {firmware.mavlink.identity.mav_autopilot for firmware in firmwares}:
            return name
    return None


def forget_autopilots() -> None:
    """Clear the caches of autopilots, so that a package installed at run time is found."""
    autopilot_names.cache_clear()
    _load.cache_clear()
    _load_object.cache_clear()


def firmware_of(spec: VehicleSpec) -> Firmware | None:
    """Return the firmware with the procedures that move a vehicle; None for the generic motion.

    Without an autopilot, a kind that has no procedures, such as a rover, is moved by the default autopilot.
    """
    kind = spec.vehicle_kind
    if spec.autopilot == NO_AUTOPILOT:
        return None if kind.procedures else get_autopilot().for_vehicle(kind.name)
    if _moves_itself(kind, spec.autopilot):
        return None
    return get_autopilot(spec.autopilot).for_vehicle(kind.name)


def _moves_itself(kind: VehicleKind, autopilot: str) -> bool:
    """Return whether the procedures of a kind of vehicle, and not the autopilot, move the vehicle."""
    if not (kind.procedures and kind.shown_as):
        return False
    return get_autopilot(autopilot).firmware(kind.name) is None


def flight_procedures(spec: VehicleSpec) -> FlightProcedures:
    """Return the procedures that move a vehicle."""
    firmware = firmware_of(spec)
    if firmware is not None:
        return firmware.procedures
    return _load_object(spec.vehicle_kind.procedures, spec.kind, FlightProcedures)


@cache
def _load_object(target: str, kind: str, wanted: type[_T]) -> _T:
    """Load the object that a kind of vehicle names as ``module:NAME``."""
    try:
        found = resolve_name(target)
    except (ImportError, AttributeError, ValueError) as error:
        raise VehicleError(f"{target} of kind {kind} cannot be loaded: {error}") from error
    if not isinstance(found, wanted):
        raise VehicleError(f"{target} of kind {kind} is no {wanted.__name__}")
    return found


def estimate_errs(spec: VehicleSpec) -> bool:
    """Return whether estimate errors are modelled for a vehicle (PX4 multirotors only)."""
    firmware = firmware_of(spec)
    return firmware is not None and firmware.strays_m is not None


def with_return_margin(spec: VehicleSpec) -> VehicleSpec:
    """Return a vehicle with the return margin that predictions need because of estimate errors.

    PX4 returns at ``RTL_RETURN_ALT`` if the distance from home exceeds ``RTL_MIN_DIST``, otherwise lower. If
    drift carries a vehicle beyond this distance, the return climbs and descends 20 m more. Predictions
    therefore add the margin to each distance. ArduCopter needs no margin: its return altitude varies
    continuously with the distance (``RTL_CONE_SLOPE``, ``RTL_CLIMB_MIN``), and its estimate is exact.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> flown = [with_autopilot(get_vehicle("quad"), name) for name in ("px4", "ardupilot")]
    >>> [round(with_return_margin(vehicle).return_margin_m, 2) for vehicle in flown]
    [0.64, 0.0]
    """
    firmware = firmware_of(spec)
    if firmware is None or firmware.strays_m is None:
        return spec
    return replace(spec, return_margin_m=_RETURN_DEVIATIONS * firmware.strays_m(spec))


def fixed_wing_procedures(spec: VehicleSpec) -> FixedWingProcedures:
    """Return the flight procedures of a fixed-wing aircraft.

    Raises
    ------
    VehicleError
        If the vehicle is not a fixed-wing aircraft, or its autopilot has no procedures for one.
    """
    procedures = flight_procedures(spec)
    if not isinstance(procedures, FixedWingProcedures):
        msg = f"vehicle {spec.name}: {procedures.name} has no fixed-wing procedures for kind {spec.kind}"
        raise VehicleError(msg)
    return procedures


def with_autopilot(
    spec: VehicleSpec, name: str, parameters: Mapping[str, float] | None = None
) -> VehicleSpec:
    """Return a vehicle that an autopilot with these `parameters` controls.

    The ideal vehicle has no autopilot and is returned unchanged. A fixed wing or rover without an autopilot
    gets the default autopilot. A vehicle moves by the procedures of its kind if the autopilot has no firmware
    for the kind. `parameters` override the parameters that the vehicle sets for the autopilot.

    Raises
    ------
    VehicleError
        If the autopilot is unknown or has no firmware for the vehicle, a parameter is unknown or out of
        range, or the ideal vehicle is given parameters.
    """
    if spec.is_ideal:
        if parameters:
            raise VehicleError(
                f"vehicle {spec.name}: the ideal vehicle has no autopilot and no parameter "
                f"{next(iter(parameters))}: leave the parameters out or choose another vehicle"
            )
        return spec
    if name == NO_AUTOPILOT and not spec.vehicle_kind.procedures:
        name = DEFAULT_AUTOPILOT
    elif name != NO_AUTOPILOT and _moves_itself(spec.vehicle_kind, name):
        name = NO_AUTOPILOT
    before = spec.parameters if spec.autopilot == name else ()
    merged = {**dict(spec.parameters_for(name)), **dict(before), **(parameters or {})}
    flown = replace(spec, autopilot=name, parameters=tuple(merged.items()))
    procedures, firmware = flight_procedures(flown), firmware_of(flown)
    cards = () if firmware is None else firmware.profile.cards.values()
    text = "room on the SD card"
    room = {c.parameter: ParameterSpec(0.0, 0.0, c.largest_kib, "KiB", text, integer=True) for c in cards}
    check_parameters(flown, {**procedures.parameters, **room})
    return procedures.fit(flown)


def adapt_vehicle(spec: VehicleSpec, autopilot: Autopilot) -> VehicleSpec:
    """Return the vehicle to simulate behind the MAVLink interface of ``autopilot``.

    A vehicle whose kind has procedures, such as a multirotor, is returned unchanged: its motion may be
    generic or that of another autopilot.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> adapt_vehicle(get_vehicle("quad"), get_autopilot("ardupilot")).autopilot
    'generic'
    """
    if spec.vehicle_kind.procedures or spec.autopilot == autopilot.name:
        return spec
    return with_autopilot(replace(spec, parameters=()), autopilot.name)
