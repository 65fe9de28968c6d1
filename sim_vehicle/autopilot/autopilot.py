"""An autopilot as one value: all that makes PX4 differ from ArduPilot, per kind of vehicle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from mission.planners.turns import Turns
from sim_vehicle.autopilot.mav_parameter import MavParameter
from sim_vehicle.autopilot.mission_behaviour import MissionBehaviour
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from mission.autopilots.profile import Profile
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.cold_boot import ColdBoot
    from sim_vehicle.autopilot.failsafe_rules import FailsafeRules
    from sim_vehicle.autopilot.flight_procedures import FlightProcedures
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile
    from sim_vehicle.autopilot.stick_rules import StickRules

__all__ = ["Autopilot", "Firmware"]


@dataclass(frozen=True, slots=True)
class Firmware:
    """An autopilot on one kind of vehicle: ArduCopter, ArduPlane, PX4 on a rover."""

    title: str
    """Its name for readers."""
    mavlink: MavlinkProfile
    """How it shows itself on MAVLink."""
    rules: FailsafeRules
    """What it does when something goes wrong."""
    profile: Profile
    """How it speaks the mission protocol."""
    parameter_table: Callable[[VehicleSpec, int], Sequence[MavParameter]]
    """Given the vehicle and its MAVLink system id, the parameters besides those of the procedures."""
    procedures: FlightProcedures
    """How it moves the vehicle: parameters of the motion, take-off, return, landing."""
    takes_off: bool = False
    """A mission that begins on the ground needs no take-off item."""
    behaviour: MissionBehaviour = field(default_factory=MissionBehaviour)
    """How it takes a mission that is changed while it flies."""
    cold_boot: ColdBoot | None = None
    """How it comes up, where that is known."""
    turns: Turns = field(default_factory=Turns)
    """How it takes the corners of a path, and the acceptance radius that it can hold."""
    sticks: StickRules | None = None
    """How it flies by sticks; without them they do nothing."""
    strays_m: Callable[[VehicleSpec], float] | None = None
    """Given the vehicle, the standard deviation of how far the errors of its estimate carry it aside, along a
    horizontal axis; without, its estimate is exact (`sim_vehicle.airframe.estimate_errors`)."""
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
    """By kind of vehicle (`sim_vehicle.airframe.spec.KINDS`); without those that it does not fly."""
    simulator_urls: Callable[[int], tuple[str, ...]]
    """Given the number of a vehicle (from 0), the ports at which the autopilot's own simulator is found, as
    URLs of links."""

    def for_vehicle(self, kind: str) -> Firmware:
        """Firmware for a kind of vehicle; the ideal vehicle is shown to peers as a multirotor.

        Raises
        ------
        VehicleError
            If the autopilot does not fly such a vehicle.
        """
        firmware = self.firmwares.get("multirotor" if kind == "ideal" else kind)
        if firmware is None:
            msg = (
                f"autopilot {self.name} flies no {kind}: choose a vehicle of kind {', '.join(self.firmwares)}"
            )
            raise VehicleError(msg)
        return firmware
