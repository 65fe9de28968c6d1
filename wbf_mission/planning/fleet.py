"""Vehicles of a run, with start position, flight height and task."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geo import Farm
from geo.seeds import child_seed
from geo.texts import is_number
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.navigation_errors import SensorNoise
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.mavlink.fleet import SPACING_M
from sim_vehicle.weather.wind import Wind
from wbf_mission.planning.assignment import SortieNumber, VehicleAssignment
from wbf_mission.planning.builder import MissionBuilder
from wbf_mission.planning.conditions import (
    ground_separation_margin_m,
    height_error_m,
    noise_of,
    separation_margin_m,
    wind_of,
)
from wbf_mission.planning.imaging import require_flight
from wbf_mission.progress import Progress, silent
from wbf_mission.scenario import (
    CameraOptions,
    MissionOptions,
    ScenarioError,
    VehicleOptions,
    WeatherOptions,
)
from wbf_mission.scenario.parts import VehicleParts
from wbf_mission.scenario.values import DISTANCE, LAYERS


@dataclass(frozen=True, slots=True)
class SingleVehicle:
    """Options of one vehicle of a run."""

    vehicle: VehicleOptions
    """Options of the run, with this vehicle's name and the parameters of its layer."""
    mission: MissionOptions
    """Options of the mission, with the height of the vehicle's layer."""
    weather: WeatherOptions
    camera: CameraOptions


@dataclass(frozen=True, slots=True)
class Vehicle(SingleVehicle):
    """A vehicle of a run, with its task."""

    task: VehicleAssignment

    def wind(self, number: SortieNumber) -> Wind:
        """Return the wind of a flight of the vehicle, with gusts."""
        seed = child_seed(self.task.seed, *number.stream_names("wind"))
        return wind_of(self.weather, self.task.builder.level, seed)

    def noise(self, number: SortieNumber) -> SensorNoise:
        """Return the vehicle's position errors in a flight."""
        return noise_of(self.vehicle, self.task.seed, number.stream_names("navigation"))

    def starting_at(self, home_m: tuple[float, float]) -> Vehicle:
        """Return the vehicle with this home position."""
        builder = MissionBuilder.of(self, self.task.builder.farm, home_m)
        return replace(self, task=self.task.moved(self.mission, builder))


def vehicles_of(
    options: VehicleParts, farm: Farm, *, seed: int, first_day: int, progress: Progress = silent
) -> tuple[Vehicle, ...]:
    """Return the vehicles of a run, each with its task.

    The first vehicle starts at the farm's home. The other vehicles start behind it, in a row that leads away
    from the farm. Ideal robots have no size and all start at home, as in the paper.
    """
    if len(options.vehicle.fleet) > 1 and options.mission.height_above_ground_m is not None:
        msg = "height above ground: a fleet is separated by heights above home; plan for one vehicle"
        raise ScenarioError(msg)
    vehicles = []
    for number, one in enumerate(single_vehicles(options), start=1):
        together = number == 1 or get_vehicle(one.vehicle.name).is_ideal
        home_m = None if together else _start_m(options.vehicle, farm, number)
        task = VehicleAssignment.of(
            one.mission,
            MissionBuilder.of(one, farm, home_m),
            footprint=one.camera.footprint,
            seed=seed,
            number=SortieNumber.first(first_day, number),
            progress=progress,
        )
        vehicles.append(Vehicle(one.vehicle, one.mission, one.weather, one.camera, task))
    _check_radio(options.vehicle.radio_range_m, farm, vehicles)
    _check_extent(options.mission, farm, vehicles)
    return tuple(vehicles)


_LONGEST_H = 24.0  # Longest survey (h); longer flights cannot be predicted.


def _check_extent(mission: MissionOptions, farm: Farm, vehicles: Sequence[Vehicle]) -> None:
    """Raise ScenarioError for a survey of more than 24 hours, instead of planning it for minutes."""
    if mission.file is not None or mission.planner.chosen != "survey":
        return
    for vehicle in vehicles:
        builder, request = vehicle.task.builder, vehicle.task.request
        over, speed_m_s = builder.imaging, builder.level.speed_m_s
        own: Any = mission.planner.params.get("spacing_m")
        wanted = is_number(own) and own > 0.0
        spacing_m = float(own) if wanted else request.row_spacing_m or request.footprint_m
        if over is None:
            look, remedy = f"the leaf camera, which sees {request.footprint_m:.2g} m", "take a mapping camera"
        else:
            look = f"camera {over.camera.name} at {over.height_m:.3g} m ({100.0 * over.gsd_m:.2g} cm a pixel)"
            remedy = "take a larger spacing_m" if wanted else "fly higher"
        rows_m = farm.scouted_area.area / spacing_m / len(vehicles)
        hours = rows_m / speed_m_s / 3600.0
        if hours > _LONGEST_H and not (over is None and builder.vehicle.is_ideal):
            each = "" if len(vehicles) == 1 else f" for each of {len(vehicles)} vehicles"
            raise ScenarioError(
                f"{look}: rows {spacing_m:.2g} m apart over farm {farm.name} are {rows_m / 1000.0:.0f} km"
                f" long{each}, {hours:.0f} hours in the air at {speed_m_s:.2g} m/s; {remedy}, or scout less"
                " of the farm"
            )


def _check_radio(range_m: float | None, farm: Farm, vehicles: Sequence[Vehicle]) -> None:
    """Raise ScenarioError if a vehicle starts beyond radio range, where no command reaches it."""
    for vehicle in vehicles:
        away_m = math.dist(vehicle.task.builder.home_m, farm.home_m)
        if range_m is not None and away_m >= range_m:
            raise ScenarioError(
                f"radio range {range_m:g} m: vehicle {vehicle.task.system_id} starts {away_m:.1f} m from the"
                f" ground station; give more than {math.ceil(away_m)} m, or fewer vehicles"
            )


def single_vehicles(options: VehicleParts) -> tuple[SingleVehicle, ...]:
    """Return the options of each vehicle of a run, in the order of their system ids.

    With separation by layers, each flying vehicle flies and returns higher than the vehicle before it. The
    distance of two layers is the scenario's separation plus a margin for both vehicles' height errors. A
    vehicle therefore passes over a lower vehicle's start position above that vehicle's layer.
    """
    asked, mission, separation = options.vehicle, options.mission, options.vehicle.keeps
    vehicles = [
        replace(asked, name=name, autopilot=autopilot, vehicles=None)
        for name, autopilot in zip(asked.fleet, asked.autopilots, strict=True)
    ]
    for vehicle in vehicles:
        require_flight(options.camera, get_vehicle(vehicle.name))
    missions = [mission] * len(vehicles)
    if separation.kind == LAYERS and len(vehicles) > 1:
        if options.camera.gsd_cm is not None and sum(flies(get_vehicle(one.name)) for one in vehicles) > 1:
            raise ScenarioError(
                f"gsd {options.camera.gsd_cm:g} cm: {len(vehicles)} vehicles fly in layers, but only"
                " one height has this gsd; give the altitude of the lowest layer, or separate by distance"
            )
        below_m, below_error_m = -math.inf, 0.0
        for k, one in enumerate(vehicles):
            spec = get_vehicle(one.name)
            if not flies(spec):
                continue
            error_m = height_error_m(one, spec)
            lowest_m = below_m + separation.metres + separation_margin_m(below_error_m, error_m)
            height_m = max(mission.altitude_m or spec.takeoff_altitude_m, round(lowest_m, 2))
            if height_m > mission.max_altitude_m:
                raise ScenarioError(
                    f"separation layers: vehicle {k + 1} would fly at {height_m:g} m, above"
                    f" {mission.max_altitude_m:g} m; give thinner layers or a lower altitude"
                )
            below_m, below_error_m = height_m, error_m
            missions[k] = replace(mission, altitude_m=height_m)
            vehicles[k] = replace(one, parameters=_parameters(one, spec, height_m))
    return tuple(
        SingleVehicle(one, flown, options.weather, options.camera)
        for one, flown in zip(vehicles, missions, strict=True)
    )


def flies(spec: VehicleSpec) -> bool:
    """Return whether a vehicle can change its height; rovers and the paper's robot cannot."""
    return spec.hovers or spec.circles


def _parameters(vehicle: VehicleOptions, spec: VehicleSpec, height_m: float) -> dict[str, float]:
    """Return a vehicle's parameters with the return altitude of its layer, unless the user has set it."""
    given = vehicle.parameters
    firmware = get_autopilot(vehicle.autopilot).firmware(spec.kind)
    if firmware is None or firmware.return_height is None:
        return given
    name, unit_m = firmware.return_height
    return {name: round(height_m / unit_m), **given} if unit_m < 1.0 else {name: height_m, **given}


# Distance between the start positions of two vehicles, in multiples of the required separation.
_ROW_FACTOR = 1.5


def _start_m(options: VehicleOptions, farm: Farm, number: int) -> tuple[float, float]:
    """Return a vehicle's start position: in a row behind home, as seen from the farm."""
    separation = options.keeps
    spacing_m = SPACING_M
    if separation.kind in (LAYERS, DISTANCE):
        spacing_m = max(SPACING_M, _ROW_FACTOR * separation.metres)
        spacing_m += ground_separation_margin_m(options)
    home = np.asarray(farm.home_m)
    centre = farm.without_obstacles(farm.owner_area).centroid
    away = home - (centre.x, centre.y)
    length = math.hypot(*away)
    away = away / length if length > 0.0 else np.array([-1.0, 0.0])
    x, y = home + (number - 1) * spacing_m * away
    return float(x), float(y)
