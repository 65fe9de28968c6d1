"""Commands ``wbf-mission vehicle list`` and ``show``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.output import Output, filled

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_vehicle.airframe.spec import VehicleSpec

VehicleArgument = Annotated[
    str,
    typer.Argument(help="Name or TOML file of a vehicle.", autocompletion=options.complete("vehicle")),
]


@options.speaks()
def list_command(output: Output) -> None:
    """List the vehicles that are known by name, with the endurance at cruise speed."""
    from sim_vehicle.airframe.catalog import get_vehicle, vehicle_names

    vehicles = [get_vehicle(name) for name in vehicle_names()]
    values = [_summary(vehicle) for vehicle in vehicles]
    rows = [[filled(form, listed) for form in _COLUMNS.values()] for listed in values]
    output.table(values, list(_COLUMNS), rows)


_COLUMNS = {
    "vehicle": "{name}",
    "kind": "{kind}",
    "mass": "{mass_kg:.3g} kg",
    "battery": "{battery_wh:.4g} Wh",
    "cruise": "{cruise_speed_m_s:g} m/s",
    "lasts": "{cruise_endurance_min:.0f} min",
    "what it is": "{description}",
}


@options.speaks()
def show_command(output: Output, vehicle: VehicleArgument) -> None:
    """Show a vehicle's limits, battery, power and endurance."""
    from sim_vehicle.airframe.catalog import get_vehicle

    spec = get_vehicle(vehicle)
    values = _summary(spec)
    rows = {
        "what": spec.description or "-",
        "kind": spec.kind,
        "speeds": f"{spec.cruise_speed_m_s:g} m/s cruise, "
        f"{_by_autopilot(spec, lambda flown: flown.fastest_m_s)} at most; "
        f"{spec.climb_speed_m_s:g} m/s up, {spec.descent_speed_m_s:g} m/s down",
    }
    if not spec.is_ideal:
        rows["wind"] = f"below {_by_autopilot(spec, lambda flown: flown.airspeed_limit_m_s)}"
    if spec.power is not None:
        rows["mass"] = f"{spec.power.mass_kg:g} kg"
    if spec.battery is not None and spec.power is not None:
        _add_endurance(spec, values, rows)
    for name, table in spec.autopilot_parameters:
        if table:
            rows[f"parameters for {name}"] = ", ".join(f"{key}={value:g}" for key, value in table)
    output.result(values, rows, title=spec.name)


def _by_autopilot(spec: VehicleSpec, speed: Callable[[VehicleSpec], float]) -> str:
    """Return a speed in words: one value, or the value with each autopilot if they differ."""
    from sim_vehicle.autopilot import autopilot_names, with_autopilot

    speeds: dict[str, list[str]] = {}
    for name in autopilot_names():
        speeds.setdefault(f"{speed(with_autopilot(spec, name)):.3g} m/s", []).append(name)
    if len(speeds) == 1:
        return next(iter(speeds))
    return ", ".join(f"{speed} ({', '.join(names)})" for speed, names in speeds.items())


def _add_endurance(spec: VehicleSpec, values: dict[str, Any], rows: dict[str, str]) -> None:
    """Add endurance and range on one battery to `values` and `rows`: predicted, and as published."""
    from sim_vehicle.energy.power import best_speeds, endurance_s, flight_power_w

    battery, power = spec.battery, spec.power
    assert battery is not None
    assert power is not None
    best = best_speeds(spec, least_airspeed_m_s=_least_airspeed_m_s(spec))
    values |= {
        "best_endurance_min": best.endurance_s / 60.0,
        "best_endurance_speed_m_s": best.endurance_speed_m_s,
        "best_range_m": best.range_m,
        "best_range_speed_m_s": best.range_speed_m_s,
    }
    rows["battery"] = (
        f"{battery.capacity_wh:g} Wh, {battery.cells} cells, {battery.capacity_mah:.0f} mAh; "
        f"low at {battery.reserve_fraction:.0%}, critical at {battery.critical_fraction:.0%}"
    )
    cruise_w = flight_power_w(power, spec.cruise_speed_m_s, battery=battery)
    rows["cruise"] = f"{cruise_w:.0f} W, {values['cruise_endurance_min']:.1f} min until empty"
    if spec.hovers:
        values["hover_power_w"] = flight_power_w(power, battery=battery)
        rows["hover"] = (
            f"{values['hover_power_w']:.0f} W, {endurance_s(spec, 0.0) / 60.0:.1f} min until empty"
        )
    rows["longest"] = f"{best.endurance_s / 60.0:.1f} min at {best.endurance_speed_m_s:.1f} m/s"
    rows["farthest"] = f"{best.range_m / 1000.0:.1f} km at {best.range_speed_m_s:.1f} m/s"
    if (maker := spec.published) is not None:
        model_s = endurance_s(spec, maker.airspeed_m_s, used_fraction=maker.used_fraction)
        values |= {
            "published_endurance_min": maker.endurance_min,
            "published_condition": maker.condition,
            "published_source": maker.source,
            "model_endurance_min": model_s / 60.0,
        }
        rows["published"] = f"{maker.endurance_min:g} min ({maker.condition}; {maker.source})"
        rows["as modelled"] = f"{model_s / 60.0:.1f} min"


def _least_airspeed_m_s(spec: VehicleSpec) -> float | None:
    """Return the minimum airspeed in a fixed wing's parameters (default autopilot); None if unset."""
    from sim_vehicle.airframe.kind import DEFAULT_AUTOPILOT
    from sim_vehicle.autopilot import fixed_wing_procedures

    if not spec.circles:
        return None
    own = dict(spec.parameters_for(DEFAULT_AUTOPILOT))
    return own.get(fixed_wing_procedures(spec).least_airspeed)


def _summary(spec: VehicleSpec) -> dict[str, Any]:
    from sim_vehicle.energy.power import endurance_s

    endless = spec.battery is None or spec.power is None
    return {
        "name": spec.name,
        "kind": spec.kind,
        "description": spec.description,
        "mass_kg": None if spec.power is None else spec.power.mass_kg,
        "battery_wh": None if spec.battery is None else spec.battery.capacity_wh,
        "cruise_speed_m_s": spec.cruise_speed_m_s,
        "cruise_endurance_min": None if endless else endurance_s(spec, spec.cruise_speed_m_s) / 60.0,
    }


LIST = Command(list_command, "")
SHOW = Command(show_command, "Example\nwbf-mission vehicle show quad")
