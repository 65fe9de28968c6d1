"""The autopilots: how each of them makes a vehicle move (`autopilot_of`)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.model import Autopilot

__all__ = ["autopilot_of", "with_autopilot"]


def autopilot_of(spec: VehicleSpec) -> Autopilot:
    """Return what flies a vehicle; modules are imported only when they are needed."""
    if spec.kind == "ideal" or (spec.kind == "multirotor" and spec.autopilot == "generic"):
        from sim_vehicle.autopilot.generic import GENERIC

        return GENERIC
    if spec.kind == "fixed-wing":
        from sim_vehicle.autopilot.plane import plane_of

        return plane_of(spec.autopilot)
    if spec.kind == "rover":
        from sim_vehicle.autopilot.rover import rover_of

        return rover_of(spec.autopilot)
    if spec.autopilot == "px4":
        from sim_vehicle.autopilot.px4.copter import PX4_MULTIROTOR

        return PX4_MULTIROTOR
    from sim_vehicle.autopilot.ardupilot.copter import ARDUCOPTER

    return ARDUCOPTER


def with_autopilot(
    spec: VehicleSpec,
    name: Literal["px4", "ardupilot", "generic"],
    parameters: Mapping[str, float] | None = None,
) -> VehicleSpec:
    """Return a vehicle as an autopilot flies it, with further parameters of that autopilot.

    The ideal vehicle has no autopilot and is returned as it is; a fixed wing or rover of no autopilot in
    particular is flown as PX4 does it. The vehicle's own parameters of that autopilot hold unless others are
    given.

    Raises
    ------
    VehicleError
        A parameter that the autopilot has not, or a value outside its range.
    """
    if spec.is_ideal:
        return spec
    from sim_vehicle.airframe.parameters import check_parameters

    if name == "generic" and spec.kind != "multirotor":
        name = "px4"
    own = {"px4": spec.px4, "ardupilot": spec.ardupilot}.get(name, ())
    before = spec.parameters if spec.autopilot == name else ()
    merged = {**dict(own), **dict(before), **(parameters or {})}
    flown = replace(spec, autopilot=name, parameters=tuple(merged.items()))
    autopilot = autopilot_of(flown)
    check_parameters(flown, autopilot.parameters)
    return autopilot.fit(flown)
