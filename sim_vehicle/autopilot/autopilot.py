"""Autopilots: each is one value, found by its name, with a firmware for each kind of vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pkgutil import resolve_name
from typing import TYPE_CHECKING, TypeVar

from geo.imports import entry_points, load_entry
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
from sim_vehicle.airframe.parameters import ParameterSpec, check_parameters
from sim_vehicle.autopilot.behaviour import MissionBehaviour
from sim_vehicle.autopilot.parameters import MavParameter
from sim_vehicle.autopilot.procedures import FixedWingProcedures, FlightProcedures
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from mission.autopilots.profile import Profile
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.behaviour import ColdBoot, FailsafeRules
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile
    from sim_vehicle.autopilot.stick_rules import StickRules

# Return-altitude margin, in standard deviations of lateral drift.
_RETURN_DEVIATIONS = 3.0
_Brought = TypeVar("_Brought")
_NOT_INSTALLED = f"no package gives any in the entry points {AUTOPILOT_GROUP}: install wbf-mission again"


@dataclass(frozen=True, slots=True)
class Firmware:
    """An autopilot on one kind of vehicle: ArduCopter, ArduPlane, PX4 on a rover."""

    title: str
    """Its name for readers."""
    mavlink: MavlinkProfile
    """Its identity, modes and rates on MAVLink."""
    rules: FailsafeRules
    """Its failsafes."""
    profile: Profile
    """Its behaviour in the mission protocol."""
    parameter_table: Callable[[VehicleSpec, int], Sequence[MavParameter]]
    """Given the vehicle and its MAVLink system id, its parameters without those of the procedures."""
    procedures: FlightProcedures
    """Parameters of the motion, take-off, return, landing."""
    takes_off: bool = False
    """A mission that begins on the ground needs no take-off item."""
    behaviour: MissionBehaviour = field(default_factory=MissionBehaviour)
    """Its behaviour when a mission is changed in flight."""
    cold_boot: ColdBoot | None = None
    """Stages of its start, where they are known."""
    cornering: Cornering = field(default_factory=Cornering)
    """Corners of its paths, and the acceptance radius that it can hold."""
    sticks: StickRules | None = None
    """Its flight by sticks; without, sticks do nothing."""
    strays_m: Callable[[VehicleSpec], float] | None = None
    """Given the vehicle, the standard deviation of how far the errors of its estimate carry it aside, along a
    horizontal axis; without, its estimate is exact (`sim_vehicle.airframe.estimate_errors`)."""
    return_height: tuple[str, float] | None = None
    """Parameter of the least height of its return above home, and its unit in metres: vehicles that fly in
    layers return in theirs. None leaves the return as it is."""
    reference: Callable[[], Sequence[MavParameter]] = tuple
    """Returns all parameters that the real firmware has; those not named otherwise are only kept."""

    def parameters(self, spec: VehicleSpec, system_id: int) -> tuple[MavParameter, ...]:
        """Parameters of a vehicle over MAVLink, sorted by name.

        Those of the flight procedures are among them if the vehicle moves by these procedures; otherwise they
        are only kept, like the rest of what the real firmware has.
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
    """An autopilot, found by its name in the entry point group ``wbf_mission.autopilots``."""

    name: str
    """Its name on the command line, in scenarios and in vehicle files; that of the entry point."""
    title: str
    """Its name for readers."""
    firmwares: Mapping[str, Firmware]
    """Those of its own, by kind of vehicle; kinds bring others (`VehicleKind.firmwares`)."""
    simulator_urls: Callable[[int], tuple[str, ...]]
    """Given the number of a vehicle (from 0), the ports at which the autopilot's own simulator is found, as
    URLs of links."""
    link_names: tuple[str, ...] = ()
    """Names of these links, where the messages differ between them (`MavlinkProfile.link_rates_hz`)."""

    def for_vehicle(self, kind: str) -> Firmware:
        """Firmware for a kind of vehicle, or for the one as which it is shown to peers.

        Raises
        ------
        VehicleError
            If the autopilot does not fly such a vehicle.
        """
        shown_as = get_kind(kind).shown_as
        firmware = self.firmware(kind) or (self.firmware(shown_as) if shown_as else None)
        if firmware is None:
            flown = ", ".join(name for name in kind_names() if self.firmware(name))
            raise VehicleError(f"autopilot {self.name} flies no {kind}: choose a vehicle of kind {flown}")
        return firmware

    def firmware(self, kind: str) -> Firmware | None:
        """Firmware for a kind of vehicle, its own or the one that the kind brings; None if it flies none."""
        brought = "" if kind in self.firmwares else get_kind(kind).firmwares.get(self.name, "")
        return _brought(brought, kind, Firmware) if brought else self.firmwares.get(kind)


def get_autopilot(name: str = DEFAULT_AUTOPILOT) -> Autopilot:
    """Autopilot of that name; case does not matter.

    Raises
    ------
    VehicleError
        If there is no autopilot of that name, or its package does not give one.

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
        known = ", ".join(autopilot_names())
        msg = f"unknown autopilot {name!r}: " + (f"choose {known}" if known else _NOT_INSTALLED)
        raise VehicleError(msg)
    autopilot = load_entry(entry, f"autopilot {entry.name}", VehicleError)
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
    _brought.cache_clear()


def firmware_of(spec: VehicleSpec) -> Firmware | None:
    """Firmware whose procedures move a vehicle; None for a vehicle of no autopilot in particular.

    The default autopilot moves vehicles of kinds without procedures, such as fixed wings and rovers.
    """
    kind = spec.vehicle_kind
    if spec.autopilot == NO_AUTOPILOT:
        return None if kind.procedures else get_autopilot().for_vehicle(kind.name)
    if _moves_itself(kind, spec.autopilot):
        return None
    return get_autopilot(spec.autopilot).for_vehicle(kind.name)


def _moves_itself(kind: VehicleKind, autopilot: str) -> bool:
    """Whether vehicles of a kind move by its own procedures when that autopilot shows them to peers."""
    if not (kind.procedures and kind.shown_as):
        return False
    return get_autopilot(autopilot).firmware(kind.name) is None


def flight_procedures(spec: VehicleSpec) -> FlightProcedures:
    """Procedures that move a vehicle."""
    firmware = firmware_of(spec)
    if firmware is not None:
        return firmware.procedures
    own: FlightProcedures = _brought(spec.vehicle_kind.procedures, spec.kind, FlightProcedures)
    return own


@cache
def _brought(target: str, kind: str, wanted: type[_Brought]) -> _Brought:
    """Load the object that a kind of vehicle names as ``module:NAME``."""
    try:
        found = resolve_name(target)
    except (ImportError, AttributeError, ValueError) as error:
        raise VehicleError(f"{target} of kind {kind} cannot be loaded: {error}") from error
    if not isinstance(found, wanted):
        raise VehicleError(f"{target} of kind {kind} is no {wanted.__name__}")
    return found


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
    >>> [round(with_return_margin(vehicle).return_margin_m, 2) for vehicle in flown]
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
    particular is flown as the default autopilot does it, and one of a kind that the autopilot only shows to
    peers by the procedures of its kind. The vehicle's own parameters of that autopilot hold
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
    if name == NO_AUTOPILOT and not spec.vehicle_kind.procedures:
        name = DEFAULT_AUTOPILOT
    elif name != NO_AUTOPILOT and _moves_itself(spec.vehicle_kind, name):
        name = NO_AUTOPILOT
    before = spec.parameters if spec.autopilot == name else ()
    merged = {**dict(spec.parameters_for(name)), **dict(before), **(parameters or {})}
    flown = replace(spec, autopilot=name, parameters=tuple(merged.items()))
    procedures = flight_procedures(flown)
    check_parameters(flown, {**procedures.parameters, **_card_parameters(flown)})
    return procedures.fit(flown)


def _card_parameters(spec: VehicleSpec) -> dict[str, ParameterSpec]:
    """Return the parameters of the vehicle's autopilot that give room for plans."""
    firmware = firmware_of(spec)
    cards = () if firmware is None else firmware.profile.cards.values()
    text = "room on the SD card"
    return {c.parameter: ParameterSpec(0.0, 0.0, c.largest_kib, "KiB", text, integer=True) for c in cards}


def adapt_vehicle(spec: VehicleSpec, autopilot: Autopilot) -> VehicleSpec:
    """Vehicle as it moves when ``autopilot`` shows itself to peers.

    A kind with procedures of its own, such as a multirotor, stays as it is: its dynamics may be another
    autopilot's, or none's in particular.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> adapt_vehicle(get_vehicle("quad"), get_autopilot("ardupilot")).autopilot
    'generic'
    """
    if spec.vehicle_kind.procedures or spec.autopilot == autopilot.name:
        return spec
    return with_autopilot(replace(spec, parameters=()), autopilot.name)
